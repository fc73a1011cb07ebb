"""``stancekit bench planner``: Lin et al.'s Table II, solve times and sizes of the planners of
courses.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console

from .console import emit, make_folder, out, stages
from .options import OptionalFloat, OptionalPath

if TYPE_CHECKING:
    from rich.table import Table

WIDTH = 150
"""Width of the table, in letters, also where a terminal is narrower: it folds lines, and a file
keeps them."""


@dataclass
class BenchPlanner:
    """Lin et al.'s Table II: how long planning two-wall climbs takes, and how large the programs
    are.

    One run and one thread each: the two-stage planners with compiling and re-solving apart, and
    MICP without and with an envelope under a time limit, the paper's own times beside them. A run
    that is stopped goes on with the next cell.
    """

    quick: bool = False
    """Few key frames and a short time limit."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of the mixed-integer programs."""
    cap: OptionalFloat = None
    """Time limit of a mixed-integer program [s]; 120, or 20 with --quick, where there is none."""
    out: OptionalPath = None
    """Folder for the cells and the table; out/bench-planner, or out/bench-planner-quick, where
    there is none."""
    json: bool = False
    """One JSON object a cell."""

    def run(self) -> int:
        """Measure what is missing, and print the table."""
        from dataclasses import replace

        from stancekit.learners.evaluation import planner_bench
        from stancekit.planners.files.arrays import checked
        from stancekit.planners.files.writing import write_text

        settings = (
            planner_bench.PlannerBenchSettings.quick()
            if self.quick
            else planner_bench.PlannerBenchSettings()
        )
        settings = replace(settings, solver=self.solver)
        if self.cap is not None:
            settings = replace(settings, cap_s=checked(self.cap, "cap", above=0.0))
        folder = self.out or Path("out/bench-planner-quick" if self.quick else "out/bench-planner")
        make_folder(folder)
        rows: list[dict[str, Any]] = []
        with stages("bench planner") as on_progress:
            for row in planner_bench.run(settings, folder, on_progress):
                rows.append(row)
                if self.json:
                    emit(row)
        write_text(folder / "table.json", json.dumps(rows, indent=1) + "\n")
        if not self.json:
            Console(width=max(out.width, WIDTH), soft_wrap=True).print(table(rows))
            for method in dict.fromkeys(row["method"] for row in rows if "over_solver" in row):
                out.print(f"{method}: CPU s ~ M^{planner_bench.growth(rows, method):.2f}")
            for line in speed_ups(rows):
                out.print(line)
            out.print(f"cells and table: {folder}")
        return 0


def table(rows: list[dict[str, Any]]) -> Table:
    """The rows as a table."""
    from rich.table import Table

    grid = Table(
        title="Table II",
        caption="* to a relative gap, the others to the first point; / solver: planning, without verifying, over "
        "Clarabel's own time; |m-pf|: most in a cell of the grid; moments: what the grid's point "
        "leaves of them",
    )
    names = (
        "method",
        "M",
        "columns",
        "binary",
        "rows",
        "compile s",
        "solve s",
        "CPU s",
        "/ solver",
        "|m-pf|",
        "moments",
        "answer",
    )
    for name in (*names, "paper s"):
        grid.add_column(
            name, justify="left" if name in ("method", "answer") else "right", no_wrap=True
        )
    for row in rows:
        paper = row.get("paper", {})
        theirs = (
            f"> {paper['more_than']}" if "more_than" in paper else _figure(paper.get("seconds"))
        )
        grid.add_row(
            row["method"] + (" *" if row["optimised"] else ""),
            str(row["frames"]),
            str(row["variables"]),
            str(row["binaries"]),
            str(row["constraints"]),
            _figure(row["compile_s"]),
            ("> " if row.get("capped") else "") + _figure(row["seconds"]),
            _figure(row["cpu_s"]),
            _figure(row.get("over_solver")),
            _figure(row.get("cell_error")),
            _figure(row.get("claimed_residual")),
            row["status"],
            theirs,
        )
    return grid


def speed_ups(rows: list[dict[str, Any]]) -> list[str]:
    """Factor by which MICP takes less CPU time than over [−1, 1] with as many intervals, per number
    of key frames.
    """
    from stancekit.learners.evaluation.planner_bench import FORMS

    by_cell = {(row["method"], row["frames"], row["optimised"]): row for row in rows}
    lines = []
    for (method, frames, optimised), row in by_cell.items():
        plain = by_cell.get((method.rpartition(", ")[0], frames, optimised))
        if plain is None or plain["method"] not in (FORMS["unit-4"], FORMS["unit-2"]):
            continue
        sign = {(False, False): "", (True, False): "≥ ", (False, True): "≤ "}.get(
            (plain["capped"], row["capped"])
        )
        if sign is not None:
            message = " *" if optimised else ""
            lines.append(
                f"{method}{message}, M = {frames}: "
                f"{sign}{plain['cpu_s'] / max(row['cpu_s'], 1e-9):.1f} ×"
            )
    return lines


def _figure(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.3g}"
