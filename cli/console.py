"""Where the command line prints: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

out = Console(soft_wrap=True)
err = Console(stderr=True, soft_wrap=True, highlight=False)


def emit(record: Mapping[str, Any]) -> None:
    """Print one JSON object on one line of standard output, at once."""
    sys.stdout.write(json.dumps(record, allow_nan=False) + "\n")
    sys.stdout.flush()


def complain(message: str) -> None:
    """Print one plain line on standard error."""
    err.print(" ".join(message.split()), markup=False)


def percent(value: float | None, interval: tuple[float, float] | None = None) -> str:
    """A share as text, with its interval where there is one."""
    if value is None or value != value:
        return "–"
    text = f"{100.0 * value:.1f}"
    return text if interval is None else f"{text} [dim]{100.0 * interval[0]:.0f}–{100.0 * interval[1]:.0f}[/dim]"


@contextmanager
def progress(title: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error; call it with (done, total). Silent where standard error is no terminal."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
