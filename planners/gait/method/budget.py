"""Budget of a plan: every solve goes through one budget, which records it, holds it to its caps and
shows it.
"""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

from ...errors import PlanningFailed
from ...files.arrays import Array
from ..gait_program import GaitProgram, GaitSolution, SolveOptions
from .attempt import Attempt, Progress
from .subprocess import solve_in_subprocess

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
