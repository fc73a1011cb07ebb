"""A clock that goes faster than the computer's: most of a test with a device is waiting."""

from __future__ import annotations

import time

PACE = 3.0
"""So many times as fast, where a test says nothing else."""


class FastTime:
    """What a module calls ``time``. pace: so many times as fast."""

    def __init__(self, pace: float = PACE) -> None:
        self._begin_s, self._pace = time.monotonic(), pace

    def monotonic(self) -> float:
        """The time [s]."""
        return self._begin_s + self._pace * (time.monotonic() - self._begin_s)

    def sleep(self, seconds: float) -> None:
        """Let so much of it pass."""
        time.sleep(seconds / self._pace)
