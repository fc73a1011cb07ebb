"""Protocol of a process with an emulated device: a line where it is, then lines of faults and of
its state.
"""

from __future__ import annotations

import json
import os
import signal
import stat
import sys
from collections.abc import Callable, Iterator
from typing import Any

LONGEST = 32
"""A list of more is of no use to people: the joints of a robot are fewer."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def converse(
    where: dict[str, Any], inject: Callable[[str], None], state: Callable[[], dict[str, Any]]
) -> int:
    """Say where the device is, then take faults and tell its state, line by line, until somebody
    ends it; 0.

    On a terminal a state is short. A background process of a terminal, which may not read from it,
    and one with nothing to read are ended by a signal.
    """
    for number in SIGNALS:
        signal.signal(number, _end)
    _say(where)
    try:
        for line in _lines():
            answer: dict[str, Any] = {}
            if line.strip():
                try:
                    inject(line.strip())
                except ValueError as error:
                    answer = {"error": str(error)}
            _say(answer if answer and sys.stdout.isatty() else state() | answer)
    except KeyboardInterrupt:
        pass
    return 0


def _end(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _lines() -> Iterator[str]:
    """Lines of standard input while there are any; then, where that is no pipe, nothing until a
    signal.
    """
    if sys.stdin is not None and not (sys.stdin.isatty() and os.tcgetpgrp(0) != os.getpgrp()):
        yield from sys.stdin
        if stat.S_ISFIFO(os.fstat(sys.stdin.fileno()).st_mode) or sys.stdin.isatty():
            return
    while True:
        signal.pause()


def short(value: Any) -> Any:
    """A value as people read it: numbers to three digits after the point, and long lists as their
    length.
    """
    if isinstance(value, dict):
        return {key: short(each) for key, each in value.items()}
    if isinstance(value, list):
        return [short(each) for each in value] if len(value) <= LONGEST else f"{len(value)} of them"
    return round(value, 3) if isinstance(value, float) else value


def _say(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(short(message) if sys.stdout.isatty() else message) + "\n")
    sys.stdout.flush()
