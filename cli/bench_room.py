"""``stancekit bench room``: how much room for learning the best unlearned control leaves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console

from stancekit.planners.errors import InvalidInput

from .bench_planner import WIDTH
from .console import as_options, emit, make_folder, out, stages

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.learners.evaluation.room import Room, Share

METHODS = ("random", "noise", "noise-again", "rule-tuned", "farkas", "finder", "finder-tuned")
LEAPS = "LeapChoice-v0"
QUICK = 40
"""Scenes of a quick look."""


@dataclass
class BenchRoom:
    """Measure how much room for learning an environment leaves: what any method finds, less what
    the best unlearned one finds.

    One line per budget, one try and so many convex problems: random choices, the best unlearned
    control, the learned scores where files of them are given, and the oracle, which is the union of
    all methods at a larger budget. The oracle with another seed stands beside it: where both agree,
    room is no luck. Rows are kept in a folder, and a run that is stopped goes on. All shares have
    intervals of 95 %; the gain of learned scores is paired over the scenes.
    """

    scorer: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE ...")] = ()
    """Files of `stancekit fit` from labelled tries of leaps, or a name that ships; of several, as
    of training seeds, the mean is taken. Scenes that they learned from are refused."""
    method: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = METHODS
    """Methods that learn nothing: random, noise, rule-tuned, farkas, finder, finder-tuned; the best
    within a budget is its control. noise-again draws with another seed."""
    environment: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = (LEAPS,)
    """Some of LeapChoice-v0, EnvelopeSelection-v0, EnvelopeRefinement-v0, Traverse-v0,
    WarpedGait-v0. Of all but the first the budget is that of an episode, and a planner beside the
    environment is a control, too. A walk takes a minute of the processor for all policies."""
    distribution: str = "leap-hard"
    """Class of leaps."""
    scenes: int = 300
    """Scenes, from number 0 on; fewer than 300 decide nothing."""
    seed: int = 4900
    """Seed of the scenes; data sets to learn from have another one."""
    solves: Annotated[tuple[int, ...], tyro.conf.arg(metavar="INT ...")] = (12, 25)
    """Budgets in convex problems, beside that of one try."""
    cpu_s: Annotated[tuple[float, ...], tyro.conf.arg(metavar="FLOAT ...")] = ()
    """Budgets in CPU time, the network's own counted [s]; one process alone on the computer
    measures them."""
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
        if not self.environment:
            with as_options("environment"):
                raise InvalidInput("environment: expected one or more, got none")
        if others := [name for name in self.environment if name != LEAPS]:
            from stancekit.learners.evaluation.env_room import ENVIRONMENTS
            from stancekit.planners.files.arrays import checked_choice

            with as_options("environment"):
                for name in others:
                    checked_choice(name, "environment", (LEAPS, *ENVIRONMENTS))
        rooms = [
            line
            for name in self.environment
            for line in (self._leaps() if name == LEAPS else [self._other(name)])
        ]
        if self.json:
            for line in rooms:
                emit(line.to_json())
            return 0
        Console(width=max(out.width, WIDTH), soft_wrap=True).print(_table(rooms))
        out.print(f"rows: {self.out}")
        return 0

    def _other(self, name: str) -> Room:
        """Another environment."""
        from stancekit.learners.evaluation.env_room import environment_room

        with as_options("environment", "scenes", "seed"), stages("bench room") as on_progress:
            make_folder(self.out)
            scenes = min(self.scenes, QUICK) if self.quick else self.scenes
            return environment_room(
                name, self.out / name, scenes=scenes, seed=self.seed, on_progress=on_progress
            )

    def _leaps(self) -> list[Room]:
        """LeapChoice-v0, a line per budget."""
        from stancekit.learners.evaluation import leap_bench
        from stancekit.learners.evaluation.room import leap_room
        from stancekit.learners.zoo import shipped
        from stancekit.planners.files.arrays import checked, checked_int

        with as_options(
            "distribution",
            "scenes",
            "seed",
            "method",
            "scorer",
            "solves",
            "cpu_s",
            "oracle_solves",
        ):
            checked_int(self.oracle_solves, "oracle_solves", least=1)
            for path in self.scorer:
                if not leap_bench.is_scorer(path):
                    names = ", ".join(shipped("scorers"))
                    raise InvalidInput(
                        f"scorer: expected a file of leaps' scores, or one of {names}, got {path}"
                    )
            for solves in self.solves:
                checked_int(solves, "solves", least=1, most=self.oracle_solves)
            for seconds in self.cpu_s:
                checked(seconds, "cpu_s", above=0.0)
            settings = leap_bench.LeapBenchSettings(
                distribution=self.distribution,
                scenes=min(self.scenes, QUICK) if self.quick else self.scenes,
                seed=self.seed,
                methods=(*self.method, *self.scorer),
                solves=self.oracle_solves,
            )
            if not {*leap_bench.FINDERS, *leap_bench.TUNED} & {*settings.methods}:
                raise InvalidInput(
                    f"method: expected a control among them, got {', '.join(self.method) or 'none'}"
                )
        make_folder(self.out)
        with stages("bench room") as on_progress:
            rows = leap_bench.run(settings, self.out, on_progress)
        budgets: list[dict[str, Any]] = [{"tries": 1}, *({"solves": each} for each in self.solves)]
        budgets += [{"cpu_s": each} for each in self.cpu_s]
        return [
            leap_room(rows, self.distribution, self.oracle_solves, **budget) for budget in budgets
        ]


def _table(lines: list[Room]) -> Table:
    """The lines as a table, in percent and points, with 95 % intervals."""
    from rich.table import Table

    remarks = dict.fromkeys(
        f"{line.environment}: {line.scenes} scenes, oracle: {line.oracle_budget}" for line in lines
    )
    grid = Table(
        title="; ".join(remarks),
        caption="shares of all scenes in percent, gain and room in points",
        box=None,
    )
    for name in (
        "environment",
        "budget",
        "random",
        "control",
        "",
        "learned",
        "",
        "gain",
        "oracle",
        "again",
        "room",
    ):
        grid.add_column(name, justify="left" if name in ("environment", "budget", "") else "right")
    for line in lines:
        shares = [
            _percent(each)
            for each in (line.random, line.control, line.learned, line.oracle, line.again)
        ]
        names = (
            line.environment,
            line.budget,
            shares[0],
            shares[1],
            line.controlled_by,
            shares[2],
            line.learned_by,
        )
        grid.add_row(*names, _points(line.gain), *shares[3:], f"{line.room:.0f}")
    return grid


def _percent(value: Share | None) -> str:
    return (
        "–"
        if value is None
        else "{:.0f} [{:.0f}, {:.0f}]".format(*(100.0 * part for part in value))
    )


def _points(value: Share | None) -> str:
    return "–" if value is None else "{:+.1f} [{:+.1f}, {:+.1f}]".format(*value)
