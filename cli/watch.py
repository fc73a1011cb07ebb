"""What a long solve shows while it runs, and how it is asked to end."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from .console import err


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Yields what says whether Ctrl-C or a polite kill came, so that work can be kept; a second one ends at once."""
    came: list[int] = []

    def note(number: int, _frame: Any) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def shown(name: str) -> Iterator[Callable[..., None]]:
    """Yields what shows an iteration (attempt, number, violation, cost) on standard error, where it is a terminal."""
    if not err.is_terminal:
        yield lambda *at: None
        return
    with err.status(f"{name}: written down") as status:

        def show(_attempt: object, iteration: int, violation: float, cost: float) -> None:
            status.update(f"{name}: iteration {iteration}, violation {violation:.1e}, cost {cost:.3g}")

        yield show
