"""Budget of a plan: every solve goes through one budget, which records it, holds it to its caps and
shows it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ...errors import PlanningFailed
from ...files.arrays import Array, archive_of, read_archive
from ...files.writing import remove_leftovers, write_bytes
from ...problem.walk import Walk
from ..gait_program import GaitProgram, GaitSolution, SolveOptions
from ..settings import GaitSettings
from .attempt import Attempt, Attempted, Progress
from .subprocess import solve_in_subprocess

DONE, CUT, ROUND = "done", "cut", "round"
"""What became of a piece of a walk: it was planned, it was cut in two, or the walk goes another way
from there on."""
FAILED = -1
"""Stage of an attempt that came to its end without success."""


class Checkpoint:
    """Points that attempts reached, in NAME.partial.npz; it belongs to one task, its settings and
    attempts.

    A walk that is planned piece by piece keeps ``pieces``, what became of each (``DONE``, ``CUT``,
    ``ROUND``), and ``samples`` of all that are done as one walk, by name.

    Arguments:
        out: the file of the run, None keeps nothing.
        phases: what else is done with the points (``Caps.phases``). What stands there already is
            taken up if it is of the same task, settings, attempts and phases, and ignored if not.
    """

    def __init__(
        self,
        out: Path | None,
        task: Walk,
        settings: GaitSettings,
        attempts: Sequence[Attempt],
        phases: Mapping[str, Any] | None = None,
    ) -> None:
        self.path = None if out is None else out.with_suffix(".partial.npz")
        self._digest, self._own = _digest(task, settings, attempts, phases or {}), False
        self._points: dict[int, tuple[int, Array]] = {}
        self._done: set[int] = set()
        self.pieces: tuple[str, ...] = ()
        self.samples: Mapping[str, Array] = {}
        if self.path is not None and self.path.exists():
            self._read(self.path)

    @property
    def begun(self) -> bool:
        """Tell whether something is known of any attempt or piece."""
        return bool(self._points or self.pieces)

    def keep_pieces(self, pieces: Sequence[str], samples: Mapping[str, Array]) -> None:
        """Record the results of all pieces so far, and write them."""
        self.pieces, self.samples = tuple(pieces), samples
        self._write()

    def begin(self, index: int) -> tuple[Array | None, int]:
        """Beginning of this attempt: a point, None for its own guess, and the stage; ``FAILED`` for
        one that did.
        """
        stage, point = self._points.get(index, (0, np.zeros(0)))
        return (point if point.size else None), stage

    def done(self, index: int) -> bool:
        """Tell whether this attempt came to its end with success."""
        return index in self._done

    def keep(self, index: int, found: Attempted) -> None:
        """Note where an attempt was stopped, or how it ended, and write all of it."""
        if found.solution.success and not found.stopped:
            self._done.add(index)
        keeps = found.stopped or found.solution.success
        self.note(index, *((found.stage, found.solution.x) if keeps else (FAILED, np.zeros(0))))

    def note(self, index: int, stage: int, point: Array) -> None:
        """Note a point that an attempt came to on its way, and write all of it."""
        self._points[index] = stage, point
        self._write()

    def _write(self) -> None:
        if self.path is None:
            return
        arrays: dict[str, Any] = {f"x_{k}": point for k, (_, point) in self._points.items()}
        arrays |= {f"stage_{k}": np.array(stage) for k, (stage, _) in self._points.items()}
        arrays |= {f"walk_{name}": array for name, array in self.samples.items()}
        arrays["pieces"] = np.array(self.pieces, dtype=np.str_)
        arrays["digest"] = self._digest
        arrays["done"] = np.array(sorted(self._done), dtype=np.intp)
        write_bytes(self.path, archive_of(arrays))
        self._own = True

    def remove(self) -> None:
        """The run is done: nothing is left of it here, and of killed writers; what others left
        whole stays.
        """
        if self.path is None:
            return
        if self._own:
            with suppress(OSError):
                self.path.unlink(missing_ok=True)
        remove_leftovers(self.path.parent, self.path.name.__eq__)

    def _read(self, path: Path) -> None:
        """Take up what a run of the same task left; a file that cannot be read counts for
        nothing.
        """
        with suppress(ValueError, KeyError, TypeError):
            packed = read_archive(path)
            if str(packed["digest"]) == self._digest:
                names = [int(name.removeprefix("x_")) for name in packed if name.startswith("x_")]
                self.pieces = tuple(str(each) for each in packed.get("pieces", ()))
                walk = {name: array for name, array in packed.items() if name.startswith("walk_")}
                self.samples = {name.removeprefix("walk_"): array for name, array in walk.items()}
                points = {k: (int(packed[f"stage_{k}"]), packed[f"x_{k}"]) for k in names}
                self._done, self._points, self._own = {int(k) for k in packed["done"]}, points, True


def _digest(
    task: Walk, settings: GaitSettings, attempts: Sequence[Attempt], phases: Mapping[str, Any]
) -> str:
    content = hashlib.sha256()
    for array in task.terrain.to_arrays().values():
        content.update(np.ascontiguousarray(array).tobytes())
    question = {
        "robot": task.robot.to_json(),
        "start": task.start.tolist(),
        "goal": task.goal.tolist(),
        "rest": [*task.yaws(), task.duration_s, task.friction, task.adhesive, task.timings],
        "gait": [task.gait, task.cycle_s],
        "suction_n": task.suction_n,
        "settings": asdict(settings),
        "attempts": [asdict(attempt) for attempt in attempts],
        "phases": dict(phases),
    }
    content.update(json.dumps(question, sort_keys=True).encode())
    return content.hexdigest()


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
