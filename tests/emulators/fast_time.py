"""Clocks for tests with a device: one that goes faster than the computer's, as most of a test is
waiting, and the device's own.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

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


class RobotTime:
    """A clock for the host: the emulated robot's, which stands still while the machine does not run
    the robot.

    Arguments:
        now_s: that time [s].
        runs: whether the robot runs; the machine's time counts where it does not any more.
    """

    def __init__(self, now_s: Callable[[], float], runs: Callable[[], bool]) -> None:
        self._now_s, self._runs = now_s, runs

    def monotonic(self) -> float:
        """The robot's time [s]."""
        return self._now_s() if self._runs() else time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let so much of it pass."""
        until_s = self.monotonic() + seconds
        while self.monotonic() < until_s:
            time.sleep(0.001)


@contextmanager
def on_robot_time(
    device: str, now_s: Callable[[], float], runs: Callable[[], bool] = lambda: True
) -> Iterator[None]:
    """Let a host of such a device live by the robot's clock meanwhile: a busy machine makes both
    slow, and neither late.
    """
    timed = [
        module
        for name, module in sys.modules.items()
        if re.match(rf"stancekit\.runner\.worlds\.({device}\.|hardware)", name)
        and hasattr(module, "time")
    ]
    assert len(timed) > 3
    with pytest.MonkeyPatch.context() as patched:
        for module in timed:
            patched.setattr(module, "time", RobotTime(now_s, runs))
        yield
