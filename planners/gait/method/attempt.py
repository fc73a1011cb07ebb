"""One attempt at a gait task: a chart, a homotopy in the terrain's height, an initial guess, the
budget of its solves, the smoothing of what it finds, and the verifier's word.

What a portfolio is made of, and what ``stancekit/WarpedGait-v0`` chooses among. Every solve of a
plan goes through one budget, which records it, holds it to its caps and shows it. A motion that is
feasible is then made smooth.
"""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, Unpack

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import STEP_S, Trajectory
from ...equilibrium.programs import Programs
from ...errors import InvalidInput, PlanningFailed
from ...files.arrays import Array, checked
from ...problem.walk import Walk
from ...verify.trajectories import check_trajectory
from ...warp.spline_map import SplineMap
from ..charts import CHARTS
from ..gait_program import Costs, GaitProgram, GaitSolution, SolveOptions, formulate, sure
from ..settings import GaitSettings
from .subprocess import solve_in_subprocess

Progress = Callable[["Attempt", int, float, float, str], "bool | None"]
"""Called at every iteration with the attempt, the iteration over all its solves, the largest
violation, the cost and the phase, ``feasible``, ``smooth`` or ``densify``, after "piece 2 of 9, "
where there are some; may return True to stop."""
Homotopy = Literal["height", "smoothing"]
"""Way to make a terrain gentler: lower heights, or a Gaussian."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Method of solving a task.

    Arguments:
        chart: a name of ``charts.CHARTS`` or ``FILE.py:NAME``.
        heights: factors on the terrain's gradients, solved one after another, the last is 1.
        by: whether factors below 1 scale the heights, or are what a Gaussian leaves of the steepest
            gradient.
        noise: deviation of what is added to every variable of the terrain-following guess [m, rad,
            m·g].
    """

    chart: str = "decoupled"
    heights: tuple[float, ...] = (1.0,)
    by: Homotopy = "height"
    noise: float = 0.0
    seed: int = 0

    def perturbed(self, seed: int, noise: float = 0.02) -> Attempt:
        """Attempt from a perturbed guess."""
        return replace(self, seed=seed, noise=noise)

    def guess(self, program: GaitProgram) -> Array:
        """Guess for a program, shape (size,): the terrain-following one, with noise where there is
        any.
        """
        if not self.noise:
            return program.guess
        return program.perturbed(np.random.default_rng(self.seed), self.noise)

    @property
    def name(self) -> str:
        """Name in tables and files."""
        words = [self.chart]
        if len(self.heights) > 1:
            words.append(
                f"{len(self.heights)} {'heights' if self.by == 'height' else 'smoothings'}"
            )
        if self.noise:
            words.append(f"seed {self.seed}")
        return ", ".join(words)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempted:
    """Result of an attempt.

    Arguments:
        solution: of its last stage.
        iterations, seconds: of all stages, CPU time.
        history: the largest violation at every iterate.
        trajectory, report: of the point it ended at, feasible or not.
    """

    attempt: Attempt
    solution: GaitSolution
    trajectory: Trajectory
    report: Report[Trajectory]
    iterations: int
    seconds: float
    history: Array

    @property
    def verified(self) -> bool:
        """Tell whether the solve succeeded and the verifier accepted."""
        return self.solution.success and self.report.accepted


class Workbench:
    """A task with what has been written down for it: a program a chart, and the map of the terrain.

    One thread at a time may use it. A copy (deepcopy, pickle) has the map, and writes its own
    programs.

    Arguments:
        kept: as of ``formulate``.
    """

    def __init__(
        self,
        task: Walk,
        settings: GaitSettings | None = None,
        warp: SplineMap | None = None,
        kept: Programs | None = None,
    ) -> None:
        self.task, self.settings, self.warp = task, sure(task, settings or GaitSettings()), warp
        self._kept = kept
        self._programs: dict[str, GaitProgram] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_programs": {}}

    def program(self, chart: str) -> GaitProgram:
        """The task in this chart, written down once.

        Raises InvalidInput, and PlanningFailed for a map that folds.
        """
        if chart not in self._programs:
            self._programs[chart] = formulate(
                self.task, replace(self.settings, chart=chart), self._flattened, self._kept
            )
        return self._programs[chart]

    def _flattened(self) -> SplineMap:
        """The terrain's map, made once for all charts that need it."""
        if self.warp is None:
            from ...warp.conformal import flatten  # of charts with a map alone

            self.warp = flatten(self.task.terrain)
        return self.warp

    def run(self, attempt: Attempt, progress: Progress | None = None) -> Attempted:
        """Solve stage by stage, each from the last one's point, and verify what comes out. A chart
        with a map has no heights but 1, and no Gaussian is used here.
        """
        program = self.program(attempt.chart)
        heights = (
            attempt.heights
            if CHARTS.get(attempt.chart).scales and attempt.by == "height"
            else (1.0,)
        )
        x = attempt.guess(program)
        history: list[float] = []
        seconds, stages, stopped = 0.0, 0, False

        def on_iterate(_iteration: int, violation: float, cost: float) -> bool:
            nonlocal stopped
            history.append(violation)
            stopped = bool(
                progress and progress(attempt, len(history) - 1, violation, cost, "feasible")
            )
            return stopped

        for factor in heights:
            solution = program.solve(x, on_iterate, height_factor=factor)
            x, seconds, stages = solution.x, seconds + solution.seconds, stages + 1
            if stopped:
                break
        solution = solution if solution.height_factor == 1.0 else solution.on(program)
        provenance = self.provenance(attempt, solution, iterations=solution.iterations)
        trajectory = replace(solution.trajectory(STEP_S), provenance=provenance)
        return Attempted(
            attempt=attempt,
            solution=solution,
            trajectory=trajectory,
            report=check_trajectory(trajectory),
            iterations=max(len(history) - stages, 0),
            seconds=seconds,
            history=np.array(history),
        )

    def provenance(
        self, attempt: Attempt, solution: GaitSolution, iterations: int
    ) -> dict[str, Any]:
        """Provenance that a trajectory carries, without clock times."""
        return {
            "chart": attempt.chart,
            "heights": " ".join(f"{factor:g}" for factor in attempt.heights),
            "noise": attempt.noise,
            "seed": float(attempt.seed),
            "gait": self.task.gait,
            "timings": self.task.timings,
            "dynamics": self.settings.dynamics,
            "hessian": self.settings.hessian,
            "footing": float(self.settings.footing or 0.0),
            "largest_violation": solution.violation,
            "iterations": float(iterations),
        }


LOG = logging.getLogger(__name__)
_FIRST_S, _LEAST_S = 1.0, 0.1
"""The first solve, and each one that is begun after it, has at least this time [s]."""
_VERDICT_S = 0.5
"""Time that is left for the verdict on the point that the last solve ends at [s]."""
_PATIENCE = 10.0
"""A child process may take this many times the CPU time of a solve by the clock."""


@dataclass(frozen=True, kw_only=True)
class SolveRecord:
    """One solve.

    Arguments:
        phase: ``feasible``, ``smooth`` or ``densify``.
        factor: on the terrain's heights.
        iterations, success, status: of the solver.
        violations: the largest at every iterate.
        seconds: CPU time in all, in functions and derivatives, in the solver with its linear
            algebra.
    """

    attempt: str
    chart: str
    phase: str
    factor: float
    iterations: int
    success: bool
    status: str
    violations: tuple[float, ...]
    seconds: float
    seconds_evaluating: float
    seconds_linear: float


class SolveBudget:
    """Solves programs on one budget of CPU time and of iterations; called like
    ``GaitProgram.solve``. The time is all that passes from its beginning on, whatever it passes
    with.

    solves: every one in its order; stopped: the caller's progress said so; phase: the name of the
    next solves.
    """

    def __init__(
        self,
        *,
        solve_s: float = 60.0,
        total_s: float = 240.0,
        iterations: float = math.inf,
        in_subprocess: bool = False,
        progress: Progress | None = None,
    ) -> None:
        self._solve_s, self._total_s, self._in_subprocess, self._progress = (
            solve_s,
            total_s,
            in_subprocess,
            progress,
        )
        self._began = cpu_s()
        self._attempt, self._iterations, self._left = Attempt(), 0, iterations
        self.solves: list[SolveRecord] = []
        self.stopped, self.phase = False, "feasible"

    def begin(self, attempt: Attempt) -> None:
        """The next solves are this attempt's."""
        self._attempt, self._iterations, self.phase = attempt, 0, "feasible"

    @property
    def seconds(self) -> float:
        """CPU time of all solves [s]."""
        return sum(one.seconds for one in self.solves)

    @property
    def spent_s(self) -> float:
        """CPU time since its beginning, also that of programs that were written down and of
        verdicts [s].
        """
        return max(cpu_s() - self._began, self.seconds)

    @property
    def left_s(self) -> float:
        """CPU time that is left [s]."""
        return self._total_s - self.spent_s

    @property
    def exhausted(self) -> bool:
        """Tell whether there is nothing left to spend, or the caller asked to stop."""
        return self.stopped or self.left_s <= _VERDICT_S or self._left <= 0

    def __call__(
        self, program: GaitProgram, guess: Array, /, **options: Unpack[SolveOptions]
    ) -> GaitSolution:
        """Solve within what is left; a solver that hangs or dies has found nothing."""
        program.build(**options)
        limit_s = min(
            self._solve_s, max(self.left_s - _VERDICT_S, _LEAST_S if self.solves else _FIRST_S)
        )
        if self._in_subprocess:
            solution = self._in_child(program, guess, limit_s, options)
        else:
            until = _TimeLimit(time.process_time() + limit_s, self._on_iterate)
            solution = program.solve(guess, until, **options)
        self.solves.append(self._record(program, solution))
        LOG.info(
            "walk: %s, %s: %d iterations, %s, largest violation %.1e, %.1f CPU-s so far",
            *(
                self._attempt.name,
                self.phase,
                solution.iterations,
                solution.status,
                solution.violation,
                self.seconds,
            ),
        )
        return solution

    def _in_child(
        self, program: GaitProgram, guess: Array, limit_s: float, options: SolveOptions
    ) -> GaitSolution:
        try:
            return solve_in_subprocess(
                program,
                guess,
                time_limit_s=_PATIENCE * limit_s,
                on_iterate=self._on_iterate,
                callback=_TimeLimit(limit_s),
                **options,  # the clock of a child begins at 0
            )
        except PlanningFailed as error:
            return _nothing(program, guess, limit_s, str(error))

    def _on_iterate(self, _iteration: int, violation: float, cost: float) -> bool:
        self._iterations += 1
        self._left -= 1
        if self._progress is not None and self._progress(
            self._attempt, self._iterations - 1, violation, cost, self.phase
        ):
            self.stopped = True
        return self.stopped or self._left <= 0

    def _record(self, program: GaitProgram, solution: GaitSolution) -> SolveRecord:
        return SolveRecord(
            attempt=self._attempt.name,
            chart=program.settings.chart,
            phase=self.phase,
            factor=solution.height_factor,
            iterations=solution.iterations,
            success=solution.success,
            status=solution.status,
            violations=tuple(violation for violation, _ in solution.history),
            seconds=solution.seconds,
            seconds_evaluating=solution.seconds_evaluating,
            seconds_linear=solution.seconds_linear,
        )


def cpu_s() -> float:
    """CPU time of this process and of its children that have ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class _TimeLimit:
    """Ends a solve at a CPU time of its process [s], or when on_iterate says so."""

    def __init__(
        self, end_s: float, on_iterate: Callable[[int, float, float], bool] | None = None
    ) -> None:
        self._end_s, self._on_iterate = end_s, on_iterate

    def __call__(self, iteration: int, violation: float, cost: float) -> bool:
        stop = self._on_iterate is not None and self._on_iterate(iteration, violation, cost)
        return stop or time.process_time() > self._end_s


def _nothing(program: GaitProgram, guess: Array, seconds: float, status: str) -> GaitSolution:
    return GaitSolution(
        program=program,
        success=False,
        iterations=0,
        history=(),
        x=guess,
        violations=program.violations(guess),
        status=status,
        seconds=seconds,
        seconds_evaluating=0.0,
        seconds_linear=0.0,
    )


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
    """Rounds from a feasible solution on, each from the last that ended feasible: a motion with
    modest peaks, which stays feasible.

    One long solve on the cost does not work. What does: a few iterations of the solver on the cost,
    kept near the last feasible point, and then a solve for feasibility alone that stops at its first
    feasible iterate; and again.

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
