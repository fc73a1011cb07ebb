"""``stancekit bench gait --against FOLDER``: walks of other programs, judged as ours are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import emit, make_folder, out, stages

if TYPE_CHECKING:
    from rich.table import Table


def judge(walks: Path, folder: Path, *, as_json: bool) -> int:
    """Judge every walk of a folder, and write against.json where the cells are; exit code 0
    whatever the verdicts.
    """
    from rich.console import Console

    from stancekit.learners.evaluation import gait_against
    from stancekit.planners.files.writing import write_text

    rows: list[dict[str, Any]] = []
    with stages("bench gait") as on_progress:
        for row in gait_against.judged(walks, on_progress):
            rows.append(row)
            if as_json:
                emit(row)
    rows += gait_against.ours(rows, folder)
    make_folder(folder)
    write_text(folder / "against.json", gait_against.as_json(rows))
    if not as_json:
        wide = out if out.is_terminal else Console(width=180)
        wide.print(walk_table(rows))
        wide.print(_program_table(gait_against.by_program(list(rows))))
        out.print(f"all figures: {folder / 'against.json'}")
    return 0


def walk_table(rows: list[dict[str, Any]]) -> Table:
    """A line a walk, and what the verifier says of it."""
    from rich.table import Table

    grid = Table(title="walks")
    for name in ("walk", "program", "terrain", "verified", "CPU s", "solver s", "verifier"):
        grid.add_column(name, justify="right" if name.endswith(" s") else "left", overflow="fold")
    for row in rows:
        grid.add_row(
            row["walk"],
            row["program"],
            row["terrain"],
            "yes" if row["verified"] else "no",
            _figure(row["cpu_process_s"]),
            _figure(row["cpu_solver_s"]),
            row["message"],
        )
    return grid


def _program_table(sums: list[dict[str, Any]]) -> Table:
    """A line a program."""
    from rich.table import Table

    grid = Table(title="programs", caption="medians of the walks that are verified")
    names = {
        "walks": "walks",
        "verified": "verified",
        "cpu_process_s": "CPU s",
        "cpu_solver_s": "solver s",
        "peak_acceleration_g": "peak g",
        "force_rms": "force rms m·g",
        "friction_needed": "friction needed",
        "outside_cone": "outside cone",
    }
    grid.add_column("program")
    for name in names.values():
        grid.add_column(name, justify="right")
    for one in sums:
        grid.add_row(one["program"], *(_figure(one[name]) for name in names))
    return grid


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
