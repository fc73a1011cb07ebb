"""What a planner counts while it works on one course."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass
class Clock:
    """Wall time [s], the share of it spent on compiling models, convex solves and the time in the solver itself [s]."""

    begin: float
    compile_s: float = 0.0
    solver_s: float = 0.0
    solves: int = 0

    @classmethod
    def start(cls) -> Clock:
        """Begin now."""
        return cls(time.perf_counter())

    def elapsed(self) -> float:
        """Seconds since the beginning, compiling included [s]."""
        return time.perf_counter() - self.begin

    def count(self, solves: int, solver_s: float) -> None:
        """Note solves."""
        self.solves += solves
        self.solver_s += solver_s

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """What happens here is compiling."""
        begin = time.perf_counter()
        yield
        self.compile_s += time.perf_counter() - begin
