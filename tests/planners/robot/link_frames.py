"""Frames of all links of a robot's model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.robot_model import RobotModel


def link_frames(model: RobotModel, angles: Sequence[Array]) -> dict[str, tuple[Array, Array]]:
    """R_BL and p_BL of every link for one posture of every leg, shapes (3, 3) and (3,) [m].

    Arguments:
        angles: joint angles of each leg, shape (n,) [rad].
    """
    placed = [
        leg.chain.frames(np.asarray(q)[None]) for leg, q in zip(model.legs, angles, strict=True)
    ]
    frames = dict[str, tuple[Array, Array]]()
    for name, mount in model.mounts.items():
        frames[name] = mount.rotation, mount.origin_m
        if mount.leg is not None:
            turn, place = (part[0, mount.joint] for part in placed[mount.leg])
            frames[name] = turn @ mount.rotation, place + turn @ mount.origin_m
    return frames
