"""A product's answer: charts tried in turn under caps, then smoothed, then densified until the
verifier accepts.

DESIGN of the order: decoupled first, which needs the fewest iterations; then the exact warped
chart; then the world's own coordinates with the terrain growing. Where walls are steep the world's
own coordinates come first, on walls that are widened and get steep from solution to solution: a
shear sends a foot up a wall as fast as the wall is steep. The first that the verifier accepts is
the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ...answer.answer import Answer, Effort, Status
from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...errors import InvalidInput, PlanningFailed
from ...files.arrays import Array, checked, checked_int
from ...problem.walk import Walk
from ...verify.trajectories import check_trajectory, with_body
from ..forbidden import forbidden
from ..gait_program import GaitSolution
from ..task import GaitSettings
from .attempt import Attempt, Attempted, Progress, Workbench
from .budget import SolveBudget, SolveRecord
from .checkpoint import FAILED, Checkpoint
from .densification import densified
from .homotopy import follow_homotopy, heights_for
from .smoothing import Smoothing, peak_g, smoothed

STEEP = 6.0
"""Gradient (81°) beyond which walls are widened first, and feet swing in the world's own
coordinates."""
WIDENED = 4.0
"""Gradient of the first stage then."""


@dataclass(frozen=True, kw_only=True)
class Caps:
    """Caps on the cost of a plan.

    Arguments:
        iterations: of one solve that looks for a feasible point.
        solve_s, total_s: CPU time of one solve, and of all that is done, verdicts between solves
            among it [s].
        total_iterations: of all solves, None for no such limit; with times that are never met, a
            walk is the same on a busy computer.
        densifications: how often rows are added.
        smoothing: of the second phase.
        in_subprocess: solves in child processes that are ended at ten times solve_s by the clock,
            since a solver may hang.
    """

    iterations: int = 80
    solve_s: float = 60.0
    total_s: float = 240.0
    total_iterations: int | None = None
    densifications: int = 6
    smoothing: Smoothing = field(default_factory=Smoothing)
    in_subprocess: bool = False

    @property
    def phases(self) -> dict[str, Any]:
        """Settings of the phases after a feasible point, as JSON-ready values."""
        return {"smoothing": asdict(self.smoothing), "densifications": self.densifications}

    def __post_init__(self) -> None:
        for name, least in (("iterations", 1), ("densifications", 0)):
            if getattr(self, name) < least:
                raise InvalidInput(f"{name}: expected {least} or more, got {getattr(self, name)}")
        for name in ("solve_s", "total_s"):
            checked(getattr(self, name), name, above=0.0)
        if self.total_iterations is not None:
            checked_int(self.total_iterations, "total_iterations", least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempts:
    """The attempts at a walk, in their order.

    Arguments:
        walk: that was asked for.
        attempts: with the best trajectory of each, accepted or not.
        feasible: the verifier's report on the first feasible point of each, before the second
            phase, None for none.
        solves: every one in its order.
        failures: of attempts that could not begin, for example for a terrain that no map fits.
        stopped: the caller asked it to end.
    """

    walk: Walk
    attempts: tuple[Attempted, ...]
    feasible: tuple[Report[Trajectory] | None, ...]
    solves: tuple[SolveRecord, ...]
    failures: tuple[str, ...] = ()
    stopped: bool = False

    @property
    def answer(self) -> Answer[Trajectory]:
        """The smoothest walk that the verifier accepts; where there is none, undecided, with the
        best walk that it refuses, and with none where no attempt came to a feasible point.
        """
        best, names = self.best, [one.attempt.name for one in self.attempts]
        if best is not None and not best.solution.success:
            best = None
        return Answer(
            status=Status.FEASIBLE if self.verified else Status.UNDECIDED,
            method=", ".join(names) if best is None else best.attempt.name,
            problem=self.walk,
            solution=None if best is None else best.trajectory,
            report=None if best is None else best.report,
            residual=math.nan if best is None else best.report.worst,
            effort=Effort(solves=len(self.solves), tries=len(self.attempts), seconds=self.seconds),
            message=self.message,
            details={"iterations": float(sum(one.iterations for one in self.solves))},
        )

    @property
    def verified(self) -> bool:
        """Tell whether there is a walk that the verifier accepts."""
        return self.best is not None and self.best.verified

    @property
    def best(self) -> Attempted | None:
        """The best attempt, accepted or not; verified before feasible before the rest; None where
        none began.
        """
        return min(self.attempts, key=_merit, default=None)

    @property
    def seconds(self) -> float:
        """CPU time of all solves [s]."""
        return sum(one.seconds for one in self.solves)

    @property
    def message(self) -> str:
        """One line: the verifier's verdict on the best attempt, or the reason why there is no
        walk.
        """
        best = self.best
        if best is None:
            return "no walk: " + ("; ".join(self.failures) or "every attempt had failed before")
        if best.verified:
            return best.report.message
        if best.solution.success:
            return f"no walk that the verifier accepts: {best.report.message}"
        return f"no feasible walk: largest violation {best.solution.violation:.1e}"


def plan_gait(
    task: Walk,
    settings: GaitSettings | None = None,
    progress: Progress | None = None,
    *,
    caps: Caps | None = None,
    attempts: Sequence[Attempt] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Attempts:
    """Find a walk: try attempts in their order until the verifier accepts one, smoothed and
    densified.

    Arguments:
        task: robot, terrain, start and goal.
        settings: of every attempt but for its chart; the usual ones if missing.
        progress: called at every iteration, see ``attempt.Progress``; may return True to stop.
        caps: what the plan may cost, and what comes after a feasible point.
        attempts: ``default_attempts(task)`` if missing. Those in a row that differ in their guess
            alone are all tried, and the smoothest is the answer.
        checkpoint: takes up and keeps where attempts stand.

    Returns:
        The ``Attempts``. ``best`` is the best of them, accepted or not, ``message`` says what it
        was refused for, and ``answer`` is what ``stancekit.walk`` returns.

    Raises:
        InvalidInput: for settings that do not fit the task, and for an unknown chart.
    Source:
        W1 and W7, for a first feasible point; the order of charts, the second phase and
        densification are the house's.
    """
    settings = settings or GaitSettings()
    if reason := forbidden(task, settings):
        return Attempts(walk=task, attempts=(), feasible=(), solves=(), failures=(reason,))
    todo = default_attempts(task) if attempts is None else list(attempts)
    caps = caps or Caps()
    checkpoint = checkpoint or Checkpoint(None, task, settings, todo)
    run = PortfolioRun(Workbench(task, settings), caps, progress, checkpoint)
    walks, failures = list[Attempted](), list[str]()
    for index, attempt in enumerate(todo):
        if any(one.verified for one in walks) and _unperturbed(attempt) != _unperturbed(
            todo[index - 1]
        ):
            break
        if checkpoint.begin(index)[1] == FAILED:
            continue
        try:
            walks.append(run.run(index, attempt))
        except PlanningFailed as error:
            failures.append(f"{attempt.name}: {error}")
            continue
        checkpoint.keep(index, walks[-1])
        if run.budget.exhausted:
            break
    return Attempts(
        walk=task,
        attempts=tuple(walks),
        feasible=tuple(run.feasible),
        solves=tuple(run.budget.solves),
        failures=tuple(failures),
        stopped=run.budget.stopped,
    )


def default_attempts(task: Walk) -> list[Attempt]:
    """The charts in the order in which they are worth trying on a task's terrain."""
    if task.terrain.steepest > STEEP and task.terrain.even:
        widened = heights_for(task.terrain, gentle=WIDENED)
        return [
            Attempt(chart="ambient", heights=widened, by="smoothing"),
            Attempt(chart="decoupled", heights=widened, by="smoothing"),
            Attempt(chart="warped-exact"),
        ]
    return [
        Attempt(chart="decoupled"),
        Attempt(chart="warped-exact"),
        Attempt(chart="ambient", heights=heights_for(task.terrain)),
    ]


class PortfolioRun:
    """Attempts at one task on one budget. feasible: the verifier's word on the first feasible point
    of each.
    """

    def __init__(
        self, bench: Workbench, caps: Caps, progress: Progress | None, checkpoint: Checkpoint
    ) -> None:
        self.bench, self.caps, self._checkpoint = bench, caps, checkpoint
        self.feasible: list[Report[Trajectory] | None] = []
        self.budget = SolveBudget(
            solve_s=caps.solve_s,
            total_s=caps.total_s,
            iterations=math.inf if caps.total_iterations is None else caps.total_iterations,
            in_subprocess=caps.in_subprocess,
            progress=progress,
        )

    def run(self, index: int, attempt: Attempt) -> Attempted:
        """A feasible point; if there is one, the second phase and densification; the best of what
        came out.

        Arguments:
            index: by which the checkpoint knows the attempt; one that is done is only verified
                again.
        """
        budget, began = self.budget, len(self.budget.solves)
        guess, stage = self._checkpoint.begin(index)
        budget.begin(attempt)
        path = follow_homotopy(
            self.bench,
            attempt,
            guess,
            stage=stage,
            solve=budget,
            stop=lambda: budget.exhausted,
            max_iterations=min(self.caps.iterations, self.bench.settings.max_iterations),
        )
        solution, heights = path.solutions[-1], attempt.heights[stage:]
        if path.factors[-1] != 1.0:
            solution = solution.on(self.bench.program(attempt.chart))
        searched = len(budget.solves)
        refines = solution.success and not self._checkpoint.done(index)
        worth = (
            solution.success or not budget.exhausted
        )  # bodies on no walk's way take longer to judge than on one's
        best = _verified(solution, body=worth and not refines)
        self.feasible.append(best[1] if solution.success else None)
        if refines:
            best = self._refined(
                best, lambda x: self._checkpoint.note(index, len(attempt.heights) - 1, x)
            )
        solves = budget.solves[began:]
        provenance = self.bench.provenance(attempt, best[0], sum(one.iterations for one in solves))
        trajectory = replace(
            best[1].answer,
            provenance={**provenance, "heights_by": attempt.by, "solves": float(len(solves))},
        )
        return Attempted(
            attempt=attempt,
            solution=best[0],
            trajectory=trajectory,
            report=replace(best[1], answer=trajectory),
            iterations=sum(one.iterations for one in budget.solves[began:searched]),
            seconds=sum(one.seconds for one in solves),
            history=np.array(
                [violation for one in budget.solves[began:searched] for violation in one.violations]
            ),
            stage=stage + min(sum(height <= path.reached for height in heights), len(heights) - 1),
            stopped=budget.exhausted,
        )

    def _refined(self, start: _Verified, note: Callable[[Array], None]) -> _Verified:
        """Dense enough for the verifier, smooth, and dense enough again, now for the robot's own
        body, too, which takes the verifier long; the best so far is noted.
        """
        best = self._dense(start, body=False)
        note(best[0].x)
        self.budget.phase = "smooth"
        rounds = smoothed(
            best[0],
            self.caps.smoothing,
            report=best[1],
            solve=self.budget,
            stop=lambda: self.budget.exhausted,
        )
        for one in rounds:
            if one.solution.success:
                best = _better(best, (one.solution, one.report))
                note(best[0].x)
        return self._dense((best[0], with_body(best[1])), body=True)

    def _dense(self, best: _Verified, *, body: bool) -> _Verified:
        """Rows where the verifier finds fault, until it finds none or the cap is reached."""
        self.budget.phase = "densify"
        at = best
        for _ in range(self.caps.densifications):
            if best[1].accepted or self.budget.exhausted:
                break
            program = densified(at[0].program, at[1])
            if program is None:
                break
            solution = self.budget(program, at[0].x, max_iterations=self.caps.iterations)
            if not solution.success:
                break
            at = _verified(solution, body=body)
            best = _better(best, at)
        return best


_Verified = tuple[GaitSolution, Report[Trajectory]]


def _unperturbed(attempt: Attempt) -> Attempt:
    """The attempt without what is its guess's."""
    return replace(attempt, noise=0.0, seed=0)


def _verified(solution: GaitSolution, *, body: bool) -> _Verified:
    trajectory: Trajectory = solution.trajectory()
    return solution, check_trajectory(trajectory, body=body)


def _better(before: _Verified, after: _Verified) -> _Verified:
    """Accepted before refused, then what misses its limits by less, or peaks lower."""
    return min(before, after, key=lambda one: _rank(one[1]))


def _rank(report: Report[Trajectory]) -> tuple[bool, float]:
    if report.accepted:
        return False, peak_g(report)
    return True, max(
        (group.value / max(group.limit, 1e-3) for group in report.refused), default=float("inf")
    )


def _merit(one: Attempted) -> tuple[bool, bool, float]:
    """Verified before feasible before the rest."""
    return not one.solution.success, *_rank(one.report)
