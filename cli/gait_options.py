"""Options of ``stancekit gait``, read: places, headings and robots; and its messages in their
names.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from stancekit.planners.files.arrays import Array


def place(text: str, option: str) -> Array:
    """A place X,Y, shape (2,) [m]."""
    import numpy as np

    from stancekit.planners.files.documents import shown

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x, y = np.nan, np.nan
    if not (np.isfinite(x) and np.isfinite(y)):
        raise InvalidInput(f"{option}: expected a place X,Y in metres, got {shown(text)}")
    return np.array([x, y])


def heading(text: str, way: Array, option: str = "--heading") -> float:
    """An angle, or that of the way to the goal [rad]."""
    from stancekit.planners.files.documents import shown

    if text == "goal":
        return math.atan2(way[1], way[0])
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(
            f"{option}: expected an angle in rad, or goal, got {shown(text)}"
        ) from None


def in_options(message: str) -> str:
    """A task's message with the names of its fields as the options that gave them."""
    names = {
        "time_limit_s": "total_s",
        "start_yaw_rad": "heading",
        "end_yaw_rad": "heading_end",
    }
    parts = []
    for part in message.split("; "):
        name, colon, rest = part.partition(":")
        same = (
            "start",
            "goal",
            "duration_s",
            "friction",
            "gait",
            "cycle_s",
            "timings",
            "adhesive",
            "footing",
            "robot",
            "seeds",
            "seed",
            "max_iterations",
            "dynamics",
            "hessian",
        )
        known = names.get(name, name if name in same else "")
        parts.append(f"--{known.replace('_', '-')}{colon}{rest}" if known else part)
    return "; ".join(parts)
