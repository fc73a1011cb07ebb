"""Answer of inverse kinematics for one posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array
from .inverse_kinematics import REACHED_M


@dataclass(frozen=True, kw_only=True, eq=False)
class JointAnswer:
    """Joint angles for one posture; J joints, N limbs.

    Arguments:
        angles: shape (J,) [rad], within the limits.
        error_m: distance of every foot from its target, shape (N,) [m].
        limit_rad: how far beyond its limits the worst joint of a limb would have to go to get
            there, shape (N,) [rad].
        torques_nm: joint torques that hold the robot still under the given forces, shape (J,) [Nm];
            zeros without forces.
    """

    angles: Array
    error_m: Array
    limit_rad: Array
    torques_nm: Array

    @property
    def within_limits(self) -> bool:
        """Every foot is where it should be, with no joint beyond its limits."""
        return bool(np.all(self.error_m <= REACHED_M))
