"""The time and the solves of a planner at work on one course, and where they end."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass
class Clock:
    """Wall time, convex solves, and the limits of both.

    Arguments:
        begin: of the work, ``time.perf_counter()`` [s].
        time_limit_s: after which it ends [s].
        max_solves: likewise, a number of solves; with no limit of time, results are the same on a
            busy computer.
        compile_s: time spent on compiling models [s].
        solver_s: time in the solver itself [s].
        solves: so far.
    """

    begin: float
    time_limit_s: float = math.inf
    max_solves: float = math.inf
    compile_s: float = 0.0
    solver_s: float = 0.0
    solves: int = 0

    @classmethod
    def start(cls, time_limit_s: float = math.inf, max_solves: float | None = None) -> Clock:
        """Begin now; no limit of solves where None."""
        return cls(
            time.perf_counter(), time_limit_s, math.inf if max_solves is None else max_solves
        )

    def elapsed(self) -> float:
        """Seconds since the beginning, compiling included [s]."""
        return time.perf_counter() - self.begin

    def ended(self, share: float = 1.0) -> bool:
        """Tell whether this share of one of the limits is used up."""
        return self.elapsed() > share * self.time_limit_s or self.solves >= share * self.max_solves

    def left(self, share: float = 1.0) -> tuple[float, float]:
        """Time [s] and solves that are left of this share."""
        return max(share * self.time_limit_s - self.elapsed(), 0.0), max(
            share * self.max_solves - self.solves, 0.0
        )

    @property
    def limit(self) -> str:
        """The limit that was met, in words."""
        return f"{self.max_solves:g} solves" if self.solves >= self.max_solves else "its time limit"

    def count(self, solves: int, solver_s: float) -> None:
        """Note solves."""
        self.solves += solves
        self.solver_s += solver_s

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Count the time spent inside as compiling."""
        begin = time.perf_counter()
        yield
        self.compile_s += time.perf_counter() - begin
