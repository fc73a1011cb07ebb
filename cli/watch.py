"""What a long solve shows while it runs, and how it is asked to end."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from .console import Lines, err


class Named(Protocol):
    """What is tried."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...


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
def watching(title: str) -> Iterator[Callable[[Named, int, float, float, str], None]]:
    """Yields what shows an iteration (attempt, number, violation, cost, phase) on standard error.

    One line with the time that has passed, or one now and then where standard error is no terminal.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        line, lines = bar.add_task(title, total=None), Lines(title)

        def show(attempt: Named, iteration: int, violation: float, cost: float, phase: str) -> None:
            said = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}, cost {cost:.3g}"
            bar.update(line, description=said)
            lines.say(said)

        yield show
