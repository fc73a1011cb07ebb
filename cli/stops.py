"""Stops of a run from outside: keys, a file, a topic."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .console import as_options, err

if TYPE_CHECKING:
    from stancekit.runner.safety.latch import Source
    from stancekit.runner.worlds.settings import EstopCheck


@contextmanager
def stop_sources(
    stack: ExitStack,
    stop_file: Path | None,
    stop_topic: str | None,
    *,
    armed: bool,
    check: EstopCheck,
) -> Iterator[list[Source]]:
    """Keys, the stop file, the stop topic; of what is armed also a terminal that is gone.

    Arguments:
        check: how the stop topic is known to work, where something is armed.
    """
    from stancekit.runner.safety.estop import (
        file_source,
        is_open,
        key_source,
        raw_keys,
        reader_source,
    )

    sources: list[Source] = [] if stop_file is None else [file_source(stop_file)]
    if armed:
        sources.append(reader_source(*(stream for stream in (1, 2) if is_open(stream))))
    if stop_topic is not None:
        from stancekit.runner.safety.stop_topic import StopTopic

        with as_options():
            topic = StopTopic(stop_topic, check=check if armed else None)
        sources.append(stack.enter_context(topic))
    if sys.stdin is None or not sys.stdin.isatty():
        yield sources
        return
    err.print("any key stops the robot")
    with raw_keys(sys.stdin.fileno()):
        yield [*sources, key_source(sys.stdin.fileno())]
