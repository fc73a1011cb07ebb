"""Clocks for tests with a device: one that goes faster than the computer's, as most of a test is
waiting, and the device's own.
"""

from __future__ import annotations

import re
import select
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from stancekit.runner.worlds.dynamixel import port

from . import servo_bus
from .servo_bus import EmulatedBus

PACE = 6.0
"""So many times as fast, where a test says nothing else."""
POLL_S = 0.0005
"""Who sleeps by the robot's clock looks at it so often, by the computer's."""
AWAY_S = 0.1
"""A host that has not looked for so long by the computer's clock does something else."""


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
            time.sleep(POLL_S)


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


class LockStep:
    """The clock of a device that has no other than its host's: it goes on while the host waits, as
    fast as the computer can, and not while the host works, however long the computer keeps it.
    """

    def __init__(self) -> None:
        self._now_s, self._looked = time.monotonic(), threading.Event()

    def look(self) -> float:
        """The time [s] for the host, which waits and lets it go on."""
        self._looked.set()
        return self._now_s

    def monotonic(self) -> float:
        """The time [s]."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let so much of it pass, in steps that the host sees one by one; one that is away has its
        time nevertheless.
        """
        until_s = self._now_s + seconds
        while self._now_s < until_s:
            seen = self._looked.wait(AWAY_S)
            self._looked.clear()
            self._now_s = min(self._now_s + servo_bus.IDLE_S, until_s) if seen else until_s

    def select(self, read: Any, write: Any, other: Any, seconds: float) -> Any:
        """``select.select``, in that time."""
        self._looked.wait(AWAY_S)
        ready = select.select(read, write, other, 0.0)
        if not ready[0]:
            self.sleep(seconds)
        return ready


@contextmanager
def fast_bus(*servos: Any, **settings: Any) -> Iterator[EmulatedBus]:
    """A bus that lives by its host's clock."""
    clock = LockStep()
    with pytest.MonkeyPatch.context() as patched:
        for name in ("time", "select"):
            patched.setattr(servo_bus, name, clock)
        patched.setattr(port, "_WAIT_S", 0.0002)
        with (
            EmulatedBus(*servos, **settings) as bus,
            on_robot_time("dynamixel", clock.look, bus.is_alive),
        ):
            yield bus
