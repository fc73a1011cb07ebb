"""The emergency stop: one latch that anybody may trip, and the ways to trip it: signal, file, key, callable."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from stancekit.planners.outcome import StancekitError

Source = Callable[[], str | None]
"""Asked again and again; says why to stop, or None."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)


class Stopped(StancekitError):
    """The stop was tripped: nothing more is sent. The message says why."""


class StopLatch:
    """Once tripped it stays so; the first reason counts. For any thread, and for signal handlers.

    clock: in seconds, never set back.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._first: list[tuple[float, str]] = []

    def trip(self, reason: str) -> None:
        """Stop. Takes no lock, which a signal handler could wait for for ever: appending to a list is atomic."""
        self._first.append((self._clock(), reason))

    @property
    def tripped(self) -> bool:
        """Whether it was."""
        return bool(self._first)

    @property
    def reason(self) -> str:
        """Why; empty before."""
        return self._first[0][1] if self._first else ""

    @property
    def time_s(self) -> float:
        """When, on the latch's clock; NaN before."""
        return self._first[0][0] if self._first else float("nan")

    def check(self) -> None:
        """Raise Stopped once it is tripped."""
        if self._first:
            raise Stopped(self.reason)

    def poll(self, sources: Sequence[Source]) -> None:
        """Ask the sources. One that fails trips it, too: a stop button that cannot be read is no stop button."""
        for source in sources:
            try:
                reason = source()
            except Exception as error:
                reason = f"a source of stops failed: {type(error).__name__}: {error}"
            if reason and not self._first:
                self.trip(reason)


def file_source(path: Path) -> Source:
    """Stop where this file is there. Its folder may be a network's, so that others can stop the robot."""
    return lambda: f"stop file {path.name} is there" if os.path.lexists(path) else None


def key_source(stream: int | None = None) -> Source:
    """Stop at any key. stream: file descriptor of a terminal, standard input's where None; where that is no terminal
    nothing is ever read."""
    number = sys.stdin.fileno() if stream is None and sys.stdin is not None and sys.stdin.isatty() else stream

    def pressed() -> str | None:
        if number is None or not select.select([number], [], [], 0.0)[0]:
            return None
        return "a key was pressed" if os.read(number, 64) else None

    return pressed


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
        termios.tcsetattr(stream, termios.TCSADRAIN, before)


@contextmanager
def on_signals(latch: StopLatch, signals: Sequence[signal.Signals] = SIGNALS) -> Iterator[None]:
    """Let these signals trip the latch in place of ending the process; those before come back afterwards.

    Does nothing outside the main thread, where Python takes no handlers.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def trip(number: int, frame: FrameType | None) -> None:
        latch.trip(f"signal {signal.Signals(number).name}")

    before = [(each, signal.signal(each, trip)) for each in signals]
    try:
        yield
    finally:
        for each, handler in before:
            signal.signal(each, handler)


@contextmanager
def watched(latch: StopLatch, sources: Sequence[Source], period_s: float = 0.005) -> Iterator[None]:
    """Ask the sources in a thread of their own, so that a loop that waits for a device does not delay a stop."""
    over = threading.Event()

    def ask() -> None:
        while not over.wait(period_s) and not latch.tripped:
            latch.poll(sources)

    thread = threading.Thread(target=ask, name="stops", daemon=True)
    if sources:
        thread.start()
    try:
        yield
    finally:
        over.set()
        if sources:
            thread.join()
