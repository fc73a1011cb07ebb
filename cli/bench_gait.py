"""``stancekit bench gait``: Pan et al.'s four benchmarks, its Table I, every chart and the product
beside them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput

from .console import emit, grid, out, stages
from .options import OptionalFloat, OptionalInt, OptionalPath

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.learners.evaluation.gait_bench import GaitBenchSettings


def judge(walks: Path, folder: Path, *, as_json: bool) -> int:
    """Judge every walk of a folder, and write against.json where the cells are; exit code 0
    whatever the verdicts.
    """
    from rich.console import Console

    from stancekit.learners.evaluation import gait_bench
    from stancekit.planners.files.writing import make_folder, write_text

    rows: list[dict[str, Any]] = []
    with stages("bench gait") as on_progress:
        for row in gait_bench.judged(walks, on_progress):
            rows.append(row)
            if as_json:
                emit(row)
    rows += gait_bench.ours(rows, folder)
    make_folder(folder)
    write_text(folder / "against.json", gait_bench.as_json(rows))
    if not as_json:
        wide = out if out.is_terminal else Console(width=180)
        wide.print(walk_table(rows))
        wide.print(_program_table(gait_bench.by_program(list(rows))))
        out.print(f"all figures: {folder / 'against.json'}")
    return 0


def walk_table(rows: list[dict[str, Any]]) -> Table:
    """A line a walk, and what the verifier says of it."""
    names = ("walk", "program", "terrain", "verified", "CPU s", "solver s", "verifier")
    columns = {
        name: {"justify": "right" if name.endswith(" s") else "left", "overflow": "fold"}
        for name in names
    }
    cells = (
        (
            row["walk"],
            row["program"],
            row["terrain"],
            "yes" if row["verified"] else "no",
            _figure(row["cpu_process_s"]),
            _figure(row["cpu_solver_s"]),
            row["message"],
        )
        for row in rows
    )
    return grid(columns, cells, title="walks")


def _program_table(sums: list[dict[str, Any]]) -> Table:
    """A line a program."""
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
    return grid(
        {"program": {}, **{name: {"justify": "right"} for name in names.values()}},
        ((one["program"], *(_figure(one[name]) for name in names)) for one in sums),
        title="programs",
        caption="medians of the walks that are verified",
    )


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


_OPTIONS = {"every": "tasks", "cap_s": "cap", "terrains": "terrain", "methods": "chart"}
"""Settings by the options that give them."""

_WIDTH = 200
"""Width of tables where standard output is no terminal."""


@dataclass
class BenchGait:
    """Pan et al.'s benchmarks: 24 directions on ripple and cone, 15 targets on hill and pit, by
    every chart.

    Success is the paper's: a largest violation below 1e-4 within 200 iterations; verified success:
    the verifier accepts what the motion does between the knots. Each task from the
    terrain-following guess and from perturbed ones.

    All of it takes hours on one core. A run that is stopped goes on with the next cell.
    """

    quick: bool = False
    """One task a terrain by four methods: a few minutes on one core."""
    terrain: Annotated[str, tyro.conf.arg(metavar="NAMES")] = ""
    """Some of ripple, cone, hill, pit, pit-84, pit-87, with commas; the paper's four where there is
    none."""
    chart: Annotated[str, tyro.conf.arg(metavar="METHODS")] = ""
    """Some methods, with commas, e.g. ambient,warped,decoupled,portfolio,ambient-lbfgs; all where
    there is none."""
    tasks: OptionalInt = None
    """Every so-manieth task of a terrain: 1 is all of them, 4 every fourth."""
    seeds: OptionalInt = None
    """Perturbed guesses a task, besides the guess itself; 3 where there is none."""
    cap: OptionalFloat = None
    """CPU time at which a solve is cut off and counts as a failure [s]."""
    workers: int = 1
    """Processes."""
    out: OptionalPath = None
    """Folder for the cells and the tables; out/bench-gait, or out/bench-gait-quick, where there is
    none."""
    against: Annotated[OptionalPath, tyro.conf.arg(metavar="FOLDER")] = None
    """Walks of other programs, NAME.yaml with NAME.csv or NAME.npz (docs/formats.md): measure
    nothing, judge these by the same check, beside the cells that --out has of the same tasks."""
    tables_only: Annotated[bool, tyro.conf.arg(name="kept")] = False
    """Measure nothing: the tables of what the folder has."""
    json: bool = False
    """One JSON object a cell."""

    def run(self) -> int:
        """Measure what is missing, and print the tables."""
        from stancekit.planners.files.arrays import checked_int

        if self.against is not None:
            return judge(self.against, self.out or Path("out/bench-gait"), as_json=self.json)
        from rich.console import Console

        from stancekit.learners.evaluation import gait_bench
        from stancekit.planners.files.writing import make_folder, write_text

        settings = self._settings()
        checked_int(self.workers, "--workers", least=1)
        folder = self.out or Path("out/bench-gait-quick" if self.quick else "out/bench-gait")
        if not self.tables_only:
            make_folder(folder)
        elif not folder.is_dir():
            raise InvalidInput(
                f"{folder}: expected an existing folder with --kept, found none there"
            )
        rows: list[dict[str, Any]] = []
        with stages("bench gait") as on_progress:
            known = gait_bench.kept(settings, folder) if self.tables_only else None
            for row in (
                gait_bench.run(settings, folder, on_progress, self.workers)
                if known is None
                else known
            ):
                rows.append(row)
                if self.json:
                    emit(row)
        if not rows:
            raise InvalidInput(f"{folder}: expected cells of this protocol, got none")
        records = gait_bench.table(rows)
        write_text(folder / "table.json", json.dumps(records, indent=1) + "\n")
        if not self.json:
            wide = out if out.is_terminal else Console(width=_WIDTH)
            for made in (success_table(records), _speed_table(records), _motion_table(records)):
                wide.print(made)
            for line in (*_comparisons(rows), *products(records)):
                out.print(line, highlight=False)
        drawings = gait_bench.draw(rows, folder)
        if not self.json:
            names = ", ".join(sorted({path.stem.partition("-")[0] for path in drawings}))
            out.print(
                f"{folder}: cells, table.json" + (f", pictures ({names})" if drawings else "")
            )
        return 0

    def _settings(self) -> GaitBenchSettings:
        from dataclasses import replace

        from stancekit.learners.evaluation.gait_bench import GaitBenchSettings

        settings = GaitBenchSettings.quick() if self.quick else GaitBenchSettings()
        options: dict[str, Any] = {"every": self.tasks, "seeds": self.seeds, "cap_s": self.cap}
        options |= {"terrains": _names(self.terrain), "methods": _names(self.chart)}
        arguments = {name: value for name, value in options.items() if value not in (None, ())}
        try:
            return replace(settings, **arguments)
        except InvalidInput as error:
            name, colon, rest = str(error).partition(":")
            raise InvalidInput(f"--{_OPTIONS.get(name, name)}{colon}{rest}") from None


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def success_table(records: list[dict[str, Any]]) -> Table:
    """Pan et al.'s Table I: success, and what the verifier accepts of it."""
    terrains = list(dict.fromkeys(record["terrain"] for record in records))
    cells = {(record["label"], record["terrain"]): record for record in records}
    labels = dict.fromkeys(record["label"] for record in records)
    return grid(
        {"method": {"no_wrap": True}, **{terrain: {"justify": "right"} for terrain in terrains}},
        (
            (label, *(_rates(cells.get((label, terrain))) for terrain in terrains))
            for label in labels
        ),
        title="Table I",
        caption="success % / verified %, each with its 95 % interval, of as many cells; "
        "(% of Pan et al.); ! n: n cells were cut off by --cap; "
        "–: not measured",
    )


def _rates(record: dict[str, Any] | None) -> str:
    if record is None:
        return "–"
    text = " / ".join(_rate(record, name) for name in ("success", "verified"))
    text += f" of {record['cells']}"
    text += "" if record["paper"] is None else f" ({100 * record['paper']:.0f})"
    return text + (f" ! {record['capped']}" if record["capped"] else "")


def _rate(record: dict[str, Any], name: str) -> str:
    """A share in percent with its interval."""
    low, high = (100 * max(end, 0.0) for end in record[f"{name}_interval"])
    return f"{100 * record[name]:.0f} [{low:.0f}, {high:.0f}]"


def _speed_table(records: list[dict[str, Any]]) -> Table:
    """Iterations and CPU time of what succeeded."""
    return _table(
        records,
        "Iterations and CPU time",
        "of cells that succeeded: median, lower and upper quartile; solver: share of the CPU time "
        "in IPOPT and MUMPS, "
        "the rest is evaluation; a portfolio's time is of all its phases",
        {
            "iterations": "iterations",
            "cpu_s": "CPU s",
            "iteration_s": "s / iteration",
            "linear_share": "solver",
        },
        digits=3,
    )


def _motion_table(records: list[dict[str, Any]]) -> Table:
    """Table of what the motions do between the nodes."""
    return _table(
        records,
        "Between the nodes",
        "of cells that succeeded: median, lower and upper quartile; left cone: cells with standing "
        "samples outside the "
        "true cone; outside: their share; before: a portfolio's first feasible point",
        {
            "left_cone": "left cone",
            "outside_cone": "outside",
            "force_rms": "force rms m·g",
            "reach_mm": "reach mm",
            "penetration_mm": "depth mm",
            "peak_before_g": "before g",
            "peak_g": "peak g",
        },
        digits=2,
    )


def _table(
    records: list[dict[str, Any]], title: str, caption: str, columns: dict[str, str], digits: int
) -> Table:
    look = {"justify": "right", "overflow": "fold"}
    cells = (
        (
            record["label"],
            record["terrain"],
            *(_quartiles(record[name], digits) for name in columns),
        )
        for record in records
    )
    heads: dict[str, dict[str, Any]] = {"method": {"no_wrap": True}, "terrain": {"no_wrap": True}}
    return grid(heads | dict.fromkeys(columns.values(), look), cells, title=title, caption=caption)


def _quartiles(values: list[float] | float | None, digits: int) -> str:
    """Median and quartiles, or a share in percent."""
    if values is None:
        return ""
    if isinstance(values, float):
        return f"{100 * values:.0f} %"
    low, middle, high = (f"{value:.{digits}g}" if abs(value) >= 5e-4 else "0" for value in values)
    return f"{middle} ({low}–{high})" if low != high else middle


def _comparisons(rows: list[dict[str, Any]]) -> list[str]:
    """Iterations and times against the baseline, on the cells in which both succeeded."""
    from stancekit.learners.evaluation.gait_bench import BASELINE, METHODS, ratios

    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        if method == BASELINE or METHODS[method].portfolio:
            continue
        shares = {name: ratios(rows, method, name) for name in ("iterations", "cpu_s")}
        message = [
            f"{terrain} {shares['iterations'][terrain]:.2f} × iterations, "
            f"{shares['cpu_s'][terrain]:.2f} × time"
            for terrain in shares["iterations"]
        ]
        if message:
            lines.append(
                f"{METHODS[method].label} over {METHODS[BASELINE].label}: " + "; ".join(message)
            )
    return lines


def products(records: list[dict[str, Any]]) -> list[str]:
    """Cost of a verified walk, how much it is smoothed, and how many points verified success is
    below success.
    """
    from stancekit.learners.evaluation.gait_bench import METHODS

    lines = []
    for method in dict.fromkeys(record["method"] for record in records):
        successes = [
            record for record in records if record["method"] == method and record["success"]
        ]
        below = [
            f"{one['terrain']} {100 * (one['success'] - one['verified']):.0f}" for one in successes
        ]
        if below:
            lines.append(
                f"{METHODS[method].label}, verified below success: " + ", ".join(below) + " points"
            )
        if METHODS[method].portfolio:
            message = [
                f"{one['terrain']} {one['verified_cpu_s'][1]:.1f} CPU-s, peak "
                f"{one['peak_before_g'][1]:.2f} → "
                f"{one['peak_g'][1]:.2f} g"
                for one in successes
                if one["verified_cpu_s"] and one["peak_before_g"]
            ]
            lines += (
                [f"{METHODS[method].label}, medians of a verified walk: " + "; ".join(message)]
                if message
                else []
            )
    return lines
