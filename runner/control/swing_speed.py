"""Legs in the air turn no faster than their joints can, and the motion waits for those that are
late.

Where a leg passes a singular posture, as one whose thigh is along the axis of its yaw, the joints
that its foot's path asks for turn at any speed. They are led on at the speed that they have, and
the motion's time slows down, or stands still, until they are where they should be: softly, for the
body moves with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics

SPEED_SHARE = 0.9
"""Share of their greatest velocity that joints in the air are led with."""
RAMP_S, PAUSE_S = 0.035, 0.2
"""Times in which such a joint comes to that velocity, and in which a motion that waits for it comes
to rest."""
LATE_RAD = 1e-6
"""A leg with a joint that is farther from where it should be is late."""


class SwingSpeed:
    """Speed limit of the swinging legs of one motion.

    Arguments:
        velocity_rad_s: greatest of the joints, shape (J,). pace: how fast the motion's time goes,
            from 0 to 1. late: which legs are not yet where they should be, shape (N,).
    """

    def __init__(self, kinematics: Kinematics, velocity_rad_s: Array, period_s: float) -> None:
        self._kinematics, self._most, self._period_s = (
            kinematics,
            SPEED_SHARE * velocity_rad_s,
            period_s,
        )
        self._most_change = period_s / RAMP_S * self._most
        self._wanted: Array | None = None
        self.pace, self.late = 1.0, np.zeros(len(kinematics.robot.limbs), dtype=bool)

    def led(self, before: Array, rates: Array, angles: Array, air: NDArray[np.bool_]) -> Array:
        """The next angles on the way to these, shape (J,).

        A leg that is where it should be goes with what it follows; one that is elsewhere comes
        there, braking in time, and neither turns faster, nor changes how fast it turns by more in a
        period, than ``RAMP_S`` lets it; at a limit of a joint, which it may be late to brake for,
        it stops.

        Arguments:
            before, rates: the last, with their velocities.
            air: which legs are there, shape (N,).
        """
        period, slower = self._period_s, self._period_s / PAUSE_S
        if not air.any() or self._keeps_up(before, rates, angles):  # nobody is led, or late
            self._wanted, self.late = angles, np.zeros_like(air)
            self.pace = min(max(self.pace + slower, 0.0), 1.0)
            return angles
        follows = (
            np.zeros_like(angles) if self._wanted is None else (angles - self._wanted) / period
        )
        follows = follows * self._each(
            self._used(follows) <= 1.0
        )  # a jump is nothing to go along with
        away = angles - before - period * follows
        left = self._used(away)  # what is left of the way, in seconds at full speed
        steps = np.ceil(
            0.5 * np.sqrt(1.0 + 8.0 * left * RAMP_S / period**2) - 0.5
        )  # periods in which it stops there
        steps = np.maximum(1.0, steps)
        closing = 1.0 / (steps * period) + 0.5 * (steps - 1.0) * period / RAMP_S / np.maximum(
            left, 1e-12
        )
        velocity = follows + self._each(closing) * away
        velocity = velocity / self._each(np.maximum(1.0, self._used(velocity)))
        change = velocity - rates
        change = change / self._each(np.maximum(1.0, self._used(change) * RAMP_S / period))
        on = before + period * (rates + change)
        on = np.minimum(np.maximum(on, self._kinematics.lowest_rad), self._kinematics.highest_rad)
        led = np.where(self._each(air) > 0.0, on, angles)
        self._wanted = angles
        self.late = self._kinematics.by_leg(np.abs(angles - led)).max(axis=1) > LATE_RAD
        self.pace = min(max(self.pace + (-slower if self.late.any() else slower), 0.0), 1.0)
        if not self.late.any():
            return angles
        return np.asarray(np.where(self._each(self.late) > 0.0, led, angles))

    def _keeps_up(self, before: Array, rates: Array, angles: Array) -> bool:
        """Tell whether joints that were where they should be come to the next angles within what
        they can, so that ``led`` leads them there, too.
        """
        if before is not self._wanted:
            return False
        velocity = (angles - before) / self._period_s
        change = np.abs(velocity - rates)
        return bool(((np.abs(velocity) <= self._most) & (change <= self._most_change)).all())

    def _each(self, legs: Array | NDArray[np.bool_]) -> Array:
        """Values of legs, repeated for their joints."""
        return np.asarray(self._kinematics.of_joints(np.asarray(legs, dtype=np.float64)))

    def _used(self, velocity: Array) -> Array:
        """The share of what a leg can that it uses, shape (N,)."""
        return np.asarray(self._kinematics.by_leg(np.abs(velocity) / self._most).max(axis=1))
