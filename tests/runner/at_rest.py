"""Samples of robots that stand still, for tests that make their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M


def at_rest(
    *, foothold: Sequence[int], frame: float = 0.0, com_m: Array | None = None, **fields: Any
) -> Samples:
    """One sample of a robot that stands still, level and at the origin unless other values are
    given.
    """
    still = {
        "com_m": np.zeros(3) if com_m is None else com_m,
        "velocity_m_s": np.zeros(3),
        "rotation_rad": np.zeros(3),
        "rotation_rate_rad_s": np.zeros(3),
        "radii_m": np.full(len(foothold), FOOT_RADIUS_M),
    }
    return Samples(**{**still, **fields}, frame=np.array(frame), foothold=np.array(foothold))
