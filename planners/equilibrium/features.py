"""Features of a posture problem for a policy: its non-dimensional numbers, clipped to a bounded
room.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .scaled import Scaled

ROOM = 4.0
"""Bound on non-dimensional coordinates in an observation."""


def observe(scaled: Scaled) -> dict[str, NDArray[np.float32]]:
    """The observation of a scene, an array a name."""
    return {name: values[0] for name, values in observe_batch([scaled]).items()}


def observe_batch(scaled: Sequence[Scaled]) -> dict[str, NDArray[np.float32]]:
    """The observations of several scenes of one size, a row each."""

    def seen(name: str, room: float) -> NDArray[np.float32]:
        values = np.stack(
            [getattr(problem, "patches" if name == "vertices" else name) for problem in scaled]
        )
        view: NDArray[np.float32] = (
            np.clip(values, -room, room).astype(np.float32).reshape(len(scaled), -1)
        )
        return view

    rooms = {"vertices": ROOM, "frames": 1.0, "friction": ROOM, "shoulders": ROOM, "reach": ROOM}
    return {name: seen(name, room) for name, room in rooms.items()}
