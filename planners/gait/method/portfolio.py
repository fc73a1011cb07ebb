"""A product's answer: charts tried in turn under caps, then smoothed, then densified until the verifier accepts.

DESIGN of the order: decoupled first, which needs the fewest iterations; then the exact warped chart; then the world's
own coordinates with the terrain growing. Where walls are steep the world's own coordinates come first, on walls that
are widened and get steep from solution to solution: a shear sends a foot up a wall as fast as the wall is steep.
The first that the verifier accepts is the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidInput, PlanningFailed
from ...files.arrays import Array, checked
from ...verify.trajectories import GaitReport, check_trajectory
from ..formulation import GaitProgram
from ..solution import GaitSolution
from ..task import GaitSettings, GaitTask
from ..trajectory import Trajectory
from .attempt import Attempt, Attempted, Progress, Workbench
from .budget import Account, Step
from .checkpoint import FAILED, Partial
from .densification import densified
from .homotopy import climb, heights_for, steepest
from .smoothing import Smoothing, peak_g, smoothed

if TYPE_CHECKING:
    from ...warp.spline_map import SplineMap


STEEP = 6.0
"""Gradient (81°) beyond which walls are widened first, and feet swing in the world's own coordinates."""
WIDENED = 4.0
"""Gradient of the first stage then."""


@dataclass(frozen=True, kw_only=True)
class Caps:
    """What a plan may cost. iterations: of one solve that looks for a feasible point; solve_s, total_s: CPU time of
    one solve and of all [s]; densifications: how often rows are added; smoothing: of the second phase.

    apart: solves in child processes that are ended at ten times solve_s by the clock, since a solver may hang.
    """

    iterations: int = 80
    solve_s: float = 60.0
    total_s: float = 240.0
    densifications: int = 4
    smoothing: Smoothing = field(default_factory=Smoothing)
    apart: bool = False

    @property
    def phases(self) -> dict[str, Any]:
        """What comes after a feasible point, as JSON-ready values."""
        return {"smoothing": asdict(self.smoothing), "densifications": self.densifications}

    def __post_init__(self) -> None:
        for name, least in (("iterations", 1), ("densifications", 0)):
            if getattr(self, name) < least:
                raise InvalidInput(f"{name}: expected {least} or more, got {getattr(self, name)}")
        for name in ("solve_s", "total_s"):
            checked(getattr(self, name), name, above=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitPlan:
    """A walk, or what kept it from being one.

    trajectory, report: what the verifier accepts, the smoothest that was found; None where there is nothing, unless
    the caller asked for what it refuses. attempts: with the best trajectory of each, accepted or not; feasible: the
    verifier's word on the first feasible point of each, before the second phase, None for none; steps: every solve in
    its order; failures: of attempts that could not begin, e.g. for a terrain that no map fits; stopped: the caller
    asked it to end.
    """

    trajectory: Trajectory | None
    report: GaitReport | None
    attempts: tuple[Attempted, ...]
    feasible: tuple[GaitReport | None, ...]
    steps: tuple[Step, ...]
    failures: tuple[str, ...] = ()
    stopped: bool = False

    @property
    def verified(self) -> bool:
        """Whether the verifier accepts the trajectory."""
        return self.report is not None and self.report.accepted

    @property
    def best(self) -> Attempted | None:
        """The best attempt, accepted or not: verified before feasible before the rest; None where none began."""
        return min(self.attempts, key=_merit, default=None)

    @property
    def seconds(self) -> float:
        """CPU time of all solves [s]."""
        return sum(step.seconds for step in self.steps)

    @property
    def message(self) -> str:
        """One line: the verdict, or what the best attempt was refused for."""
        if self.report is not None:
            return self.report.message
        best = self.best
        if best is None:
            return "no walk: " + ("; ".join(self.failures) or "every attempt had failed before")
        if best.solution.success:
            return f"no walk that the verifier accepts: {best.report.message}"
        return f"no feasible walk: largest violation {best.solution.violation:.1e}"


def plan_gait(
    task: GaitTask,
    settings: GaitSettings | None = None,
    progress: Progress | None = None,
    *,
    caps: Caps | None = None,
    attempts: Sequence[Attempt] | None = None,
    warp: SplineMap | None = None,
    guess: Array | None = None,
    partial: Partial | None = None,
    unverified: bool = False,
) -> GaitPlan:
    """Try attempts in their order until the verifier accepts one, smoothed and densified.

    progress: at every iteration; may return True to stop. attempts: ``ways(task)`` if missing; those in a row that
    differ in their guess alone are all tried, and the smoothest is the answer. warp: the terrain's map, if it is there.
    guess: a point to begin the first attempt from in its chart. partial: takes up and keeps where attempts stand.
    unverified: return the best feasible trajectory even if the verifier refuses it.
    Raises InvalidInput for settings that do not fit the task.
    """
    settings = settings or GaitSettings()
    todo = ways(task) if attempts is None else list(attempts)
    caps = caps or Caps()
    partial = partial or Partial(None, task, settings, todo)
    pursuit = Pursuit(Workbench(task, settings, warp), caps, progress, partial)
    found, failures = list[Attempted](), list[str]()
    for index, attempt in enumerate(todo):
        if any(one.verified for one in found) and _guessed(attempt) != _guessed(todo[index - 1]):
            break
        if partial.begin(index)[1] == FAILED:
            continue
        try:
            found.append(pursuit.run(index, attempt, guess if index == 0 else None))
        except PlanningFailed as error:
            failures.append(f"{attempt.name}: {error}")
            continue
        partial.keep(index, found[-1])
        if pursuit.account.over:
            break
    best = min(found, key=_merit, default=None)
    shown = best is not None and best.solution.success and (best.report.accepted or unverified)
    return GaitPlan(
        trajectory=best.trajectory if best is not None and shown else None,
        report=best.report if best is not None and shown else None,
        attempts=tuple(found),
        feasible=tuple(pursuit.feasible),
        steps=tuple(pursuit.account.steps),
        failures=tuple(failures),
        stopped=pursuit.account.stopped,
    )


def ways(task: GaitTask) -> list[Attempt]:
    """The charts in the order in which they are worth trying on a task's terrain."""
    if steepest(task.terrain) > STEEP and task.terrain.even:
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


class Pursuit:
    """Attempts at one task on one account. feasible: the verifier's word on the first feasible point of each."""

    def __init__(self, bench: Workbench, caps: Caps, progress: Progress | None, partial: Partial) -> None:
        self.bench, self.caps, self._partial = bench, caps, partial
        self.feasible: list[GaitReport | None] = []
        self.account = Account(solve_s=caps.solve_s, total_s=caps.total_s, apart=caps.apart, progress=progress)

    def run(self, index: int, attempt: Attempt, guess: Array | None = None) -> Attempted:
        """A feasible point; if there is one, the second phase and densification; the best of what came out.

        index: by which the partial result knows the attempt; one that is done is only judged again.
        """
        account, began = self.account, len(self.account.steps)
        point, stage = self._partial.begin(index)
        guess = point if point is not None else guess
        account.begin(attempt)
        heights = attempt.heights[stage:]
        limit = min(self.caps.iterations, self.bench.settings.max_iterations)
        climbed = climb(
            self.bench, attempt.chart, heights, _guess(attempt) if guess is None else guess, by=attempt.by,
            solve=account, max_iterations=limit, begun=attempt.heights[stage - 1] if stage else 0.0,
            stop=lambda: account.over,
        )  # fmt: skip
        solution, reached = climbed.solutions[-1], climbed.reached
        if climbed.factors[-1] != 1.0:
            solution = solution.on(self.bench.program(attempt.chart))
        searched = len(account.steps)
        best = _judged(solution)
        self.feasible.append(best[1] if solution.success else None)
        if self.feasible[-1] is not None and not self._partial.done(index):
            best = self._refined(best, lambda x: self._partial.note(index, len(attempt.heights) - 1, x))
        steps = account.steps[began:]
        trajectory = replace(best[1].trajectory, provenance=self._provenance(attempt, best[0], steps))
        return Attempted(
            attempt=attempt,
            solution=best[0],
            trajectory=trajectory,
            report=replace(best[1], trajectory=trajectory),
            iterations=sum(step.iterations for step in account.steps[began:searched]),
            seconds=sum(step.seconds for step in steps),
            history=np.array([violation for step in account.steps[began:searched] for violation in step.violations]),
            stage=stage + min(sum(height <= reached for height in heights), len(heights) - 1),
            stopped=account.over,
        )

    def _refined(self, start: _Judged, note: Callable[[Array], None]) -> _Judged:
        """Dense enough for the verifier, smooth, and dense enough again; the best so far is noted."""
        best = self._dense(start)
        note(best[0].x)
        self.account.phase = "smooth"
        for one in smoothed(best[0], self.caps.smoothing, solve=self.account, stop=lambda: self.account.over):
            if one.solution.success:
                best = _better(best, (one.solution, one.report))
                note(best[0].x)
        return self._dense(best)

    def _dense(self, best: _Judged) -> _Judged:
        """Rows where the verifier finds fault, until it finds none or the cap is reached."""
        self.account.phase = "densify"
        at = best
        for _ in range(self.caps.densifications):
            if best[1].accepted or self.account.over:
                break
            program = densified(at[0].program, at[1])
            if program is None:
                break
            solution = self.account(program, at[0].x, max_iterations=self.caps.iterations)
            if not solution.success:
                break
            at = _judged(solution)
            best = _better(best, at)
        return best

    def _provenance(self, attempt: Attempt, solution: GaitSolution, steps: Sequence[Step]) -> dict[str, str | float]:
        task, settings = self.bench.task, self.bench.settings
        return {
            "chart": attempt.chart,
            "heights": " ".join(f"{factor:g}" for factor in attempt.heights),
            "heights_by": attempt.by,
            "noise": attempt.noise,
            "seed": float(attempt.seed),
            "gait": task.gait,
            "timings": task.timings,
            "dynamics": settings.dynamics,
            "hessian": settings.hessian,
            "largest_violation": solution.violation,
            "iterations": float(sum(step.iterations for step in steps)),
            "solves": float(len(steps)),
        }


_Judged = tuple[GaitSolution, GaitReport]


def _guess(attempt: Attempt) -> Callable[[GaitProgram], Array]:
    """What makes an attempt's guess of its first program."""
    if not attempt.noise:
        return lambda program: program.guess
    return lambda program: program.perturbed(np.random.default_rng(attempt.seed), attempt.noise)


def _guessed(attempt: Attempt) -> Attempt:
    """The attempt without what is its guess's."""
    return replace(attempt, noise=0.0, seed=0)


def _judged(solution: GaitSolution) -> _Judged:
    trajectory: Trajectory = solution.trajectory()
    return solution, check_trajectory(trajectory)


def _better(before: _Judged, after: _Judged) -> _Judged:
    """Accepted before refused, then what misses its limits by less, or peaks lower."""
    return min(before, after, key=lambda one: _rank(one[1]))


def _rank(report: GaitReport) -> tuple[bool, float]:
    if report.accepted:
        return False, peak_g(report)
    return True, max((group.value / max(group.limit, 1e-3) for group in report.refused), default=float("inf"))


def _merit(one: Attempted) -> tuple[bool, bool, float]:
    """Verified before feasible before the rest."""
    return not one.solution.success, *_rank(one.report)
