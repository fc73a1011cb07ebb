"""Tasks for executors: what they answer, how they fail, and how their worker dies; with nothing to
import first.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

from stancekit.planners.errors import InvalidInput


def square(x: int) -> int:
    """Answer."""
    return x * x


def fail(x: int) -> int:
    """Fail for 3."""
    if x == 3:
        raise InvalidInput(f"x: expected another number than {x}")
    return x


def die_once(mark: Path, x: int) -> int:
    """Kill the process that runs this, unless the mark is there."""
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return x
    os.kill(os.getpid(), signal.SIGKILL)
    return -1


def die(x: int) -> int:
    """Kill the process that runs this."""
    os.kill(os.getpid(), signal.SIGKILL)
    return x
