"""Progress of a long solve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from .console import Lines, err


class Named(Protocol):
    """Item that has a name, such as a method to try."""

    @property
    def name(self) -> str:
        """Name of the item."""
        ...


@contextmanager
def watching(title: str) -> Iterator[Callable[[Named, int, float, float, str], None]]:
    """Yields what shows an iteration (attempt, number, violation, cost, phase) on standard error.

    One line with the time that has passed, or one now and then where standard error is no terminal.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        line, lines = bar.add_task(title, total=None), Lines(title)

        def show(attempt: Named, iteration: int, violation: float, cost: float, phase: str) -> None:
            text = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}, cost {cost:.3g}"
            bar.update(line, description=text)
            lines.say(text)

        yield show
