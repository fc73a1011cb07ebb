"""Progress of a long solve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from .console import Lines, err

if TYPE_CHECKING:
    from stancekit.planners.gait.method.attempt import Attempt


@contextmanager
def watching(title: str) -> Iterator[Callable[[Attempt, int, float, float, str], None]]:
    """Yields what shows an iteration (attempt, number, violation, cost, phase) on standard error.

    One line with the time that has passed, or one now and then where standard error is no terminal.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        line, lines = bar.add_task(title, total=None), Lines(title)

        def show(
            attempt: Attempt, iteration: int, violation: float, cost: float, phase: str
        ) -> None:
            text = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}, cost {cost:.3g}"
            bar.update(line, description=text)
            lines.say(text)

        yield show
