"""The ways to trip a stop latch: signal, file, key, a terminal that is gone, any callable."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

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
        clock: in seconds, never set back; CLOCK_MONOTONIC unless another is given, which all
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


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1)
JOIN_S = 1.0
"""A source that hangs is not waited for longer: its thread ends with the process."""


def file_source(path: Path) -> Source:
    """Stop where this file is there.

    Its folder may be a network's, so that others can stop the robot.
    """
    return lambda: f"stop file {path.name} is there" if os.path.lexists(path) else None


def key_source(stream: int | None = None) -> Source:
    """Stop at any key, and where the terminal is gone.

    Arguments:
        stream: file descriptor of a terminal, standard input's where None; where that is no
            terminal nothing is ever read.
    """
    number = (
        sys.stdin.fileno()
        if stream is None and sys.stdin is not None and sys.stdin.isatty()
        else stream
    )

    def pressed() -> str | None:
        if number is None or not select.select([number], [], [], 0.0)[0]:
            return None
        return "a key was pressed" if os.read(number, 64) else "the terminal is gone"

    return pressed


def reader_source(*streams: int) -> Source:
    """Stop when one of these streams lost its reader: a closed terminal, or the end of a pipe.

    Arguments:
        streams: file descriptors. Nothing is written, so that a stop does not wait for the next
            line.
    """
    watch = select.poll()
    for stream in streams:
        watch.register(stream, 0)  # what is gone is always told
    return lambda: "the terminal is gone, or whoever read the output" if watch.poll(0) else None


@contextmanager
def raw_keys(stream: int) -> Iterator[None]:
    """Let a terminal give every key at once, not only whole lines; Ctrl-C stays a signal."""
    import termios
    import tty

    before = termios.tcgetattr(stream)
    tty.setcbreak(stream)
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(stream, termios.TCSADRAIN, before)


@contextmanager
def on_signals(latch: StopLatch, signals: Sequence[signal.Signals] = SIGNALS) -> Iterator[None]:
    """Let these signals trip the latch in place of ending the process; those before come back
    afterwards.

    A hang-up that is ignored stays so: that is what ``nohup`` asks for. Does nothing outside the
    main thread, where Python takes no handlers.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def trip(number: int, frame: FrameType | None) -> None:
        latch.trip(f"signal {signal.Signals(number).name}")

    watched = [
        each
        for each in signals
        if (each, signal.getsignal(each)) != (signal.SIGHUP, signal.SIG_IGN)
    ]
    before = dict[signal.Signals, Any]()
    try:
        for each in watched:
            before[each] = signal.signal(each, trip)
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def watched(latch: StopLatch, period_s: float = 0.005) -> Iterator[None]:
    """Ask the latch's sources in a thread of its own, so that a loop that waits for a device delays
    no stop.
    """
    over = threading.Event()

    def ask() -> None:
        while not over.wait(period_s) and not latch.tripped:
            latch.poll()

    thread = threading.Thread(target=ask, name="stops", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(JOIN_S)


def is_open(stream: int) -> bool:
    """Tell whether the process began with this file descriptor."""
    try:
        os.fstat(stream)
    except OSError:
        return False
    return True
