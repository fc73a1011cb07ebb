"""``stancekit bench leaps``: planners of leaps on scenes of a class."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console

from .bench_planner import WIDTH
from .console import as_options, emit, make_folder, out, stages

if TYPE_CHECKING:
    from rich.table import Table


@dataclass
class BenchLeaps:
    """Planners of leaps on scenes of a class: how many each finds within 12 and 25 convex problems,
    and in what time.

    Methods: random; noise, the rule with noise, and single changes; rule, the hand rule as first
    written; rule-tuned, its constants chosen on training scenes; farkas, with cuts that prove;
    finder, with cuts that guide, too; ipopt, a nonlinear program on the tuned rule's choices. Of
    scenes that nobody solves a proof is sought. Rows are kept in a folder: a run that is stopped
    goes on where it was, and more scenes or methods are measured beside them.
    """

    distribution: str = "leap-hard"
    """Class of leaps: leap-base, leap-hard, leap-long, or another one of configs/leaps.yaml."""
    scenes: int = 1000
    """Scenes, from number 0 on."""
    seed: int = 4400
    """Seed of the scenes."""
    method: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Some of random, noise, rule, rule-tuned, farkas, finder, ipopt; all where there is none.
    noise-again draws with another seed; finder-tuned has constants of its own for leap-hard; a file
    of `stancekit fit` from labelled tries, or the name of one that ships, is the finder with
    learned scores."""
    solves: int = 50
    """Convex problems at most per method and scene."""
    ipopt_s: float = 4.0
    """CPU time at most of IPOPT per scene [s]."""
    proof: int = 200
    """Convex problems at most in search of a proof; 0 for none."""
    out: Path = Path("out/bench-leaps")
    """Folder for the rows."""
    json: bool = False
    """One JSON object per method, and one of proofs."""

    def run(self) -> int:
        """Measure what is missing, and print the table."""
        from stancekit.learners.evaluation import leap_bench

        with as_options("distribution", "scenes", "seed", "method", "solves", "ipopt_s", "proof"):
            settings = leap_bench.LeapBenchSettings(
                distribution=self.distribution,
                scenes=self.scenes,
                seed=self.seed,
                methods=self.method or leap_bench.METHODS,
                solves=self.solves,
                ipopt_s=self.ipopt_s,
                proof=self.proof,
            )
        make_folder(self.out)
        with stages("bench leaps") as on_progress:
            rows = leap_bench.run(settings, self.out, on_progress)
        lines, proofs = leap_bench.table(rows, self.distribution), leap_bench.proofs(rows)
        if self.json:
            for line in (*lines, {"distribution": self.distribution, **proofs}):
                emit(line)
            return 0
        Console(width=max(out.width, WIDTH), soft_wrap=True).print(_table(lines, self.distribution))
        out.print(
            f"of {proofs['unsolved']} scenes that nobody solves {proofs['proved']} are proved "
            "infeasible"
        )
        out.print(f"rows: {self.out}")
        return 0


COLUMNS = ("first_try", "within_12_solves", "within_25_solves", "solved", "share_of_union")


def _table(lines: list[dict[str, Any]], distribution: str) -> Table:
    """The lines as a table, shares in percent with 95 % intervals."""
    from rich.table import Table

    most = max((line["scenes"] for line in lines), default=0)
    caption = "shares of all scenes in percent, with 95 % intervals; of union: within 25 solves, of the scenes that "
    grid = Table(
        title=f"{distribution}, {most} scenes", caption=caption + "anybody solves", box=None
    )
    for name in (
        "method",
        "first try",
        "≤ 12 solves",
        "≤ 25 solves",
        "solved",
        "of union",
        "CPU s",
    ):
        grid.add_column(name, justify="left" if name == "method" else "right")
    for line in lines:
        cpu_s = "–" if line["cpu_s"] is None else f"{line['cpu_s']:.3f}"
        grid.add_row(line["method"], *(_share(line[name]) for name in COLUMNS), cpu_s)
    return grid


def _share(value: tuple[float, float, float] | None) -> str:
    if value is None:
        return "–"
    middle, low, high = (100.0 * part for part in value)
    return f"{middle:.0f} [{low:.0f}, {high:.0f}]"
