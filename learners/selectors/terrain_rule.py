"""The rule of Lin et al. §IV-A for ``Traverse-v0``: walk on ground, climb between walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.memoryless import Observation
from stancekit.planners.problem.posture import MAX_TILT_RAD

LEAST = float(np.cos(MAX_TILT_RAD))
"""Least part of a normal along an axis, for it to be ground, or a wall."""


def terrain_rule(observation: Observation) -> NDArray[np.int64]:
    """Choose among Traverse-v0's planners by the slope of what carries the robot and of what it may
    stand on next: 1, walking, where all is ground, 2, climbing, where all are walls to the left and
    the right, up to 30° off either way, else 0, the lift.

    Arrays may have axes before their own, one index an environment.
    """
    limbs, horizon = observation["reach"].shape[-1], observation["path"].shape[-1] // 3
    offered = observation["offered"] > 0.0
    first = offered.reshape(*offered.shape[:-1], horizon, limbs, -1)[..., 0, :, :]
    stays = ~first.any(axis=-1)  # the other toes leave before the body moves

    def all_along(axis: int) -> NDArray[np.bool_]:
        coming, under = (
            np.abs(observation[name][..., axis::3]) >= LEAST for name in ("normals", "footing")
        )
        return np.asarray((coming | ~offered).all(axis=-1) & (under | ~stays).all(axis=-1))

    return np.asarray(np.where(all_along(2), 1, np.where(all_along(1), 2, 0)), dtype=np.int64)
