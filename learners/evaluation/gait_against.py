"""Walks of other programs, judged by the check that ours are judged by, beside the walks that we
have.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_json
from stancekit.planners.gait.walk_table import read_walk, walk_names
from stancekit.planners.verify.trajectories import check_trajectory

OURS = ("portfolio", "decoupled", "warped", "ambient")
"""Methods of ``bench gait`` whose cells are shown beside other programs' walks."""
SHOWN = ("peak_acceleration_g", "force_rms", "friction_needed", "outside_cone")


def judged(
    folder: Path, on_progress: Callable[[str, int, int], None] | None = None
) -> Iterator[dict[str, Any]]:
    """The row of every walk of a folder, in order of their names.

    Raises InvalidInput for a walk that is none.
    """
    paths = walk_names(folder)
    for index, path in enumerate(paths):
        if on_progress is not None:
            on_progress(path.stem, index, len(paths))
        walk = read_walk(path)
        report, keys = check_trajectory(walk.trajectory), walk.keys
        yield {
            "walk": walk.name,
            "program": keys.program,
            "robot": walk.trajectory.robot.name,
            "terrain": keys.terrain,
            "task": keys.task,
            "verified": report.accepted,
            "message": report.message,
            "refused": [group.name for group in report.refused],
            "cpu_process_s": keys.cpu_process_s,
            "cpu_solver_s": keys.cpu_solver_s,
            "duration_s": walk.trajectory.duration_s,
            "figures": {name: _finite(value) for name, value in report.figures.items()},
        }
    if on_progress is not None:
        on_progress("done", len(paths), len(paths))


def ours(rows: list[dict[str, Any]], folder: Path) -> list[dict[str, Any]]:
    """Rows of this kind for every task that the rows name, from the cells in a folder of ``bench
    gait``.
    """
    rows_of_ours = []
    for terrain, task in dict.fromkeys(
        (row["terrain"], row["task"]) for row in rows if row["task"] is not None
    ):
        for method in OURS:
            path = folder / f"{terrain}-{task:02d}-0-{method}.json"
            if path.exists():
                rows_of_ours.append(_of_cell(path, terrain, task, method))
    return rows_of_ours


def _of_cell(path: Path, terrain: str, task: int, method: str) -> dict[str, Any]:
    content = read_json(path)
    row = content.get("row") if isinstance(content, dict) else None
    if not isinstance(row, dict):
        raise InvalidInput(f"{path}: expected a cell of bench gait, got another file")
    return {
        "walk": path.stem,
        "program": f"stancekit, {method}",
        "robot": "anymal",
        "terrain": terrain,
        "task": task,
        "verified": bool(row.get("verified")),
        "message": str(row.get("message", "")),
        "refused": list(row.get("refused", [])),
        "cpu_process_s": None,
        "cpu_solver_s": row.get("cpu_s"),
        "duration_s": None,
        "figures": {name: row.get(name) for name in SHOWN},
    }


def by_program(rows: list[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Results by program: walks, the number verified, medians of CPU time and figures over those."""
    lines = []
    for program in dict.fromkeys(row["program"] for row in rows):
        rows_of_program = [row for row in rows if row["program"] == program]
        good = [row for row in rows_of_program if row["verified"]]
        medians = {
            name: _median([row[name] for row in good]) for name in ("cpu_process_s", "cpu_solver_s")
        }
        medians |= {name: _median([row["figures"].get(name) for row in good]) for name in SHOWN}
        lines.append(
            {"program": program, "walks": len(rows_of_program), "verified": len(good), **medians}
        )
    return lines


def as_json(rows: list[dict[str, Any]]) -> str:
    """All rows, and what they come to, as a document."""
    return json.dumps({"walks": rows, "programs": by_program(list(rows))}, indent=1) + "\n"


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
