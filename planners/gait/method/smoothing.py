"""The second phase: a motion that is feasible is made smooth, with modest peaks, and stays
feasible.

One long solve on the cost does not work. What does: a few iterations of the solver on the cost,
kept near the last feasible point, and then a solve for feasibility alone that stops at its first
feasible iterate; and again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, Unpack

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...errors import InvalidInput
from ...files.arrays import Array, checked
from ...verify.trajectories import check_trajectory
from ..gait_program import Costs, GaitProgram, GaitSolution, SolveOptions


class Solver(Protocol):
    """Solver of a program from a guess, here or elsewhere."""

    def __call__(
        self, program: GaitProgram, guess: Array, /, **options: Unpack[SolveOptions]
    ) -> GaitSolution:
        """Solve it, with the options of ``GaitProgram.solve``."""


@dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Settings of smoothing.

    Arguments:
        rounds: most rounds.
        iterations: the solver's iterations on the cost in each.
        repair: the solver's iterations to become feasible again.
        costs: weights of the distance from the feasible point, of acceleration and force rate.
        enough_g: a peak acceleration that needs no more rounds [g].
        gain: least share by which a round has to lower the peak for another one to follow, which
            takes about as long as the first feasible point did.
    """

    rounds: int = 4
    iterations: int = 8
    repair: int = 40
    costs: Costs = (0.1, 0.3, 0.03)
    enough_g: float = 0.35
    gain: float = 0.15

    def __post_init__(self) -> None:
        for name, least in (("rounds", 0), ("iterations", 1), ("repair", 1)):
            if getattr(self, name) < least:
                raise InvalidInput(f"{name}: expected {least} or more, got {getattr(self, name)}")
        checked(self.enough_g, "enough_g", least=0.0)
        checked(self.gain, "gain", least=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Round:
    """One round: the solve on the cost, what made its point feasible again, and the verifier's
    word.

    solution is ``lowered`` itself where that was feasible.
    """

    lowered: GaitSolution
    solution: GaitSolution
    report: Report[Trajectory]

    @property
    def seconds(self) -> float:
        """CPU time of both solves."""
        return self.lowered.seconds + (
            self.solution.seconds if self.solution is not self.lowered else 0.0
        )

    @property
    def peak_g(self) -> float:
        """Peak acceleration of the torso [g]."""
        return peak_g(self.report)


def peak_g(report: Report[Trajectory]) -> float:
    """Peak acceleration of the torso [g], infinite where it could not be measured."""
    return report.figures.get("peak_acceleration_g", float("inf"))


def smoothed(
    start: GaitSolution,
    settings: Smoothing | None = None,
    *,
    report: Report[Trajectory] | None = None,
    solve: Solver = GaitProgram.solve,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[_Round]:
    """Rounds from a feasible solution on, each from the last that ended feasible.

    A round that ends infeasible is the last, and so is one that gains too little to be worth
    another.

    Arguments:
        report: the verifier's on the start, where it has judged it.
        solve: in place of the program's own, e.g. in a child process.
        stop: asked between solves.
    """
    settings, program, x = settings or Smoothing(), start.program, start.x
    last = peak_g(report or check_trajectory(start.trajectory(), body=False))
    for _ in range(settings.rounds):
        if stop() or last <= settings.enough_g:
            return
        lowered = solve(
            program,
            x,
            costs=settings.costs,
            reference=x,
            max_iterations=settings.iterations,
            stop_when_feasible=False,
        )
        solution = (
            lowered
            if lowered.success
            else solve(program, lowered.x, max_iterations=settings.repair)
        )
        stage = _Round(
            lowered=lowered,
            solution=solution,
            report=check_trajectory(solution.trajectory(), body=False),
        )
        yield stage
        if not solution.success or stage.peak_g > (1.0 - settings.gain) * last:
            return
        x, last = solution.x, stage.peak_g
