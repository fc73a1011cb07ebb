"""Legs in the air turn no faster than their joints can, and the motion waits for those that are late.

Where a leg passes a singular posture, as one whose thigh is along the axis of its yaw, the joints that its foot's path
asks for turn at any speed. They are led on at the speed that they have, and the motion's time slows down, or stands
still, until they are where they should be: softly, for the body moves with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics

SPEED_SHARE = 0.9
"""Of their greatest velocity that joints in the air are led with."""
RAMP_S, PAUSE_S = 0.06, 0.2
"""Times in which such a joint comes to that velocity, and in which a motion that waits for it comes to rest."""


class SwingSpeed:
    """Of one motion. velocity_rad_s: greatest of the joints, shape (J,). pace: how fast the motion's time goes, from 0
    to 1."""

    def __init__(self, kinematics: Kinematics, velocity_rad_s: Array, period_s: float) -> None:
        self._kinematics, self._most, self._period_s = kinematics, SPEED_SHARE * velocity_rad_s, period_s
        self.pace = 1.0

    def led(self, before: Array, rates: Array, angles: Array, air: NDArray[np.bool_]) -> Array:
        """The next angles on the way to these, shape (J,). before, rates: the last, with their velocities; air: which
        legs are there, shape (N,)."""
        turns = angles - before
        now, use = (self._used(velocity) for velocity in (rates, turns / self._period_s))
        share = np.minimum(1.0, now + self._period_s / RAMP_S) / np.maximum(use, 1e-9)
        share = np.where(air, np.minimum(1.0, share), 1.0)
        change = self._period_s / PAUSE_S
        self.pace = min(max(self.pace + (-change if (share < 1.0).any() else change), 0.0), 1.0)
        return np.asarray(before + self._kinematics.of_joints(share) * turns)

    def _used(self, velocity: Array) -> Array:
        """The share of what a leg can that it uses, shape (N,)."""
        return np.asarray(self._kinematics.by_leg(np.abs(velocity) / self._most).max(axis=1))
