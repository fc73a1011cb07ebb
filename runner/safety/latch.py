"""The stop latch: every world has one, and whatever moves a robot leaves through it or not at all.

Asking whether to stop and sending are one thing, under one lock (``sending``). To trip takes no
lock, so that signal handlers may do it, also one that runs while its own thread sends.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from stancekit.planners.errors import StancekitError

Source = Callable[[], str | None]
"""Asked again and again; says why to stop, or None."""
_PATIENCE_S = 0.25
"""A source that answers no faster is none."""


class Stopped(StancekitError):
    """The stop was tripped: nothing more is sent.

    The message says why.
    """


class StopLatch:
    """Once tripped it stays so; the first reason counts.

    Arguments:
        clock: in seconds, never set back; CLOCK_MONOTONIC unless told otherwise, which all
            processes of a machine share.

    sent_s: when the last write had returned, NaN before the first. after, after_s: writes that
    returned after it was tripped, which were on their way then or landed a leap, and how long after
    the last of them did. lands: a leap is under way in a simulation, and a stop is obeyed when it
    has landed.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._first: list[tuple[float, str]] = []
        self._sources: tuple[Source, ...] = ()
        self._sending, self._asking = threading.RLock(), threading.Lock()
        self.sent_s, self.after, self.after_s = float("nan"), 0, 0.0
        self.lands = False
        self._at_once = False

    def trip(self, reason: str, *, at_once: bool = False) -> None:
        """Stop.

        Takes no lock, which a signal handler could wait for for ever: appending to a list is
        atomic.

        Arguments:
            at_once: also where a leap is in the air, which else lands first.
        """
        self._at_once = self._at_once or at_once
        self._first.append((self._clock(), reason))

    @property
    def stops(self) -> bool:
        """Tell whether nothing may be sent any more: it was tripped, and no leap is to land
        first.
        """
        return bool(self._first) and not (self.lands and not self._at_once)

    @property
    def tripped(self) -> bool:
        """Tell whether it was tripped."""
        return bool(self._first)

    @property
    def reason(self) -> str:
        """Why; empty before."""
        return self._first[0][1] if self._first else ""

    @property
    def time_s(self) -> float:
        """When, on the latch's clock; NaN before."""
        return self._first[0][0] if self._first else float("nan")

    def listen(self, *sources: Source) -> None:
        """Add sources of stops, to be asked from now on."""
        self._sources += sources

    def poll(self) -> None:
        """Ask the sources of stops, and trip if one of them asks for a stop.

        A source that raises an error trips the latch, too: a stop button that cannot be read is no
        stop button.
        """
        if self._first or not self._sources:
            return
        if not self._asking.acquire(
            timeout=_PATIENCE_S
        ):  # another thread asks, and waits for an answer
            self.trip(f"a source of stops did not answer for {_PATIENCE_S:g} s")
            return
        try:
            for source in self._sources:
                try:
                    reason = source()
                except Exception as error:  # a source that fails is a reason to stop
                    reason = f"a source of stops failed: {type(error).__name__}: {error}"
                if reason and not self._first:
                    self.trip(reason)
        finally:
            self._asking.release()

    def check(self) -> None:
        """Ask the sources, and raise Stopped once it is tripped."""
        self.poll()
        if self.stops:
            raise Stopped(self.reason)

    @contextmanager
    def sending(self) -> Iterator[None]:
        """Within, one write of something that moves the robot: let through, or refused with
        Stopped.
        """
        self.poll()
        with self._sending:
            if self.stops:
                raise Stopped(self.reason)
            try:
                yield
            finally:
                self.sent_s = self._clock()
                if self._first:
                    self.after, self.after_s = self.after + 1, self.sent_s - self.time_s

    def settle(self) -> None:
        """Wait until what is being sent has left.

        After ``trip`` and this nothing does. Not for signal handlers.
        """
        with self._sending:
            pass
