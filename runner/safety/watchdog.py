"""The host's own watchdog: a loop that falls silent is stopped, whatever it hangs in.

A thread trips the latch; that is enough for a loop that is late. A process that hangs altogether no
thread of its own can help: there the device's bus watchdog stops it (``worlds.dynamixel``), or
another process (``heartbeat``). Where a process goes on (SIGCONT), its first look at the clock
trips the latch, before anything is sent.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from .heartbeat import HeartbeatMonitor
from .latch import StopLatch


class Watchdog:
    """Trips the latch where ``kick`` was not called for ``limit_s``; begins with the first kick.

    A context manager.

    While it is entered, and from ``guard`` on, it does so where the process stood still for so
    long, kicked or not.

    Arguments:
        clock: in seconds, never set back; what the wall clock does is no matter. A limit of
            infinity watches nothing.
        monitor: gets the same.
    """

    def __init__(
        self,
        latch: StopLatch,
        limit_s: float,
        clock: Callable[[], float] = time.monotonic,
        monitor: HeartbeatMonitor | None = None,
    ) -> None:
        self.limit_s = limit_s
        self._monitor = monitor
        self._latch, self._clock = latch, clock
        self._last: float | None = None
        self._pulse: float | None = None  # when its thread ran last
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def kick(self) -> None:
        """The loop lives.

        One that comes too late trips the latch itself.
        """
        self.look()
        self._last = self._clock()
        if self._monitor is not None:
            self._monitor.beat()

    def guard(self) -> None:
        """Watch from now on that the process does not stand still, whatever the loop waits for."""
        self._pulse = None if self._thread is None else self._clock()

    def rest(self) -> None:
        """Watch nothing until the next kick, or ``guard``."""
        self._last = self._pulse = None
        if self._monitor is not None:
            self._monitor.rest()

    def look(self) -> None:
        """Trip the latch where the last kick, or the last sign of life of the process, is too long
        ago.
        """
        for last, who in (
            (self._last, "the loop was silent"),
            (self._pulse, "the process stood still"),
        ):
            if (
                last is not None
                and not self._latch.tripped
                and (silent := self._clock() - last) > self.limit_s
            ):
                self._latch.trip(
                    f"host watchdog: {who} for {silent:.3f} s, limit {self.limit_s:g} s"
                )

    def __enter__(self) -> Self:
        if self.limit_s < float("inf"):
            self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(0.2 * self.limit_s):
            self.look()
            if self._pulse is not None:
                self._pulse = self._clock()
