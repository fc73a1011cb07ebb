"""The ways to trip a stop latch: signal, file, key, a terminal that is gone, any callable."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

from .latch import Source, StopLatch

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
    """Stop where nobody reads any more what is written to one of these: a closed terminal, or the
    end of a pipe.

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
