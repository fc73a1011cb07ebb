"""``stancekit bench room``: how much room for learning the best unlearned control leaves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

from .bench_planner import WIDTH
from .console import as_options, emit, make_folder, out, stages

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.learners.evaluation.room import Room, Share

METHODS = ("random", "noise", "noise-again", "rule-tuned", "farkas", "finder")
QUICK = 40
"""Scenes of a quick look."""


@dataclass
class BenchRoom:
    """Measure how much room for learning LeapChoice-v0 leaves: what any method finds, less what the
    best unlearned one finds.

    One line per budget, one try and so many convex problems: random choices, the best unlearned control, the
    learned scores where files of them are given, and the oracle, which is the union of all methods at a larger budget.
    The oracle with another seed stands beside it: where both agree, room is no luck. Rows are kept in a folder, and a
    run that is stopped goes on. Intervals are of 95 %; the gain of learned scores is paired over the scenes.
    """

    scorer: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = ()
    """Files of `stancekit fit` from labelled tries of leaps; of several, as of training seeds, the mean is taken."""
    distribution: str = "leap-hard"
    """Class of leaps."""
    scenes: int = 300
    """Scenes, from number 0 on; fewer than 300 decide nothing."""
    seed: int = 4900
    """Seed of the scenes; data sets to learn from have another one."""
    solves: Annotated[tuple[int, ...], tyro.conf.arg(metavar="INT ...")] = (12, 25)
    """Budgets in convex problems, beside that of one try."""
    oracle_solves: int = 50
    """Convex problems of the oracle, per method and scene."""
    quick: bool = False
    """A look at 40 scenes, in a minute or two."""
    out: Path = Path("out/bench-room")
    """Folder for the rows."""
    json: bool = False
    """One JSON object per budget."""

    def run(self) -> int:
        """Measure what is missing, and print the table."""
        from stancekit.learners.evaluation import leap_bench
        from stancekit.learners.evaluation.room import leap_room

        with as_options("distribution", "scenes", "seed"):
            settings = leap_bench.LeapBenchSettings(
                distribution=self.distribution,
                scenes=min(self.scenes, QUICK) if self.quick else self.scenes,
                seed=self.seed,
                methods=(*METHODS, *map(str, self.scorer)),
                solves=self.oracle_solves,
                proof=0,
            )
        make_folder(self.out)
        with stages("bench room") as on_progress:
            rows = leap_bench.run(settings, self.out, on_progress)
        budgets = [{"tries": 1}, *({"solves": each} for each in self.solves)]
        found = [leap_room(rows, self.distribution, self.oracle_solves, **budget) for budget in budgets]
        if self.json:
            for line in found:
                emit(line.to_json())
            return 0
        Console(width=max(out.width, WIDTH), soft_wrap=True).print(_table(found))
        out.print(f"rows: {self.out}")
        return 0


def _table(lines: list[Room]) -> Table:
    """The lines as a table, in percent and points, with 95 % intervals."""
    from rich.table import Table

    first = lines[0]
    found = Table(
        title=f"{first.environment}, {first.scenes} scenes",
        caption="shares of all scenes in percent, gain and room in points; oracle: " + first.oracle_budget,
        box=None,
    )
    for name in ("budget", "random", "control", "", "learned", "", "gain", "oracle", "again", "room"):
        found.add_column(name, justify="left" if name in ("budget", "") else "right")
    for line in lines:
        found.add_row(
            line.budget, _percent(line.random), _percent(line.control), line.controlled_by, _percent(line.learned),
            line.learned_by, _points(line.gain), _percent(line.oracle), _percent(line.again), f"{line.room:.0f}",
        )  # fmt: skip
    return found


def _percent(value: Share | None) -> str:
    return "–" if value is None else "{:.0f} [{:.0f}, {:.0f}]".format(*(100.0 * part for part in value))


def _points(value: Share | None) -> str:
    return "–" if value is None else "{:+.1f} [{:+.1f}, {:+.1f}]".format(*value)
