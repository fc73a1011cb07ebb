"""Leg odometry: where the body is by its joints' encoders and the feet that stand, where nothing
measures it.

Feet that stand are taken to stay where they were put down, but for what they roll: of the rigid
motions of the body the one is taken that brings the feet, as the joints have them, nearest to those
places (Kabsch). With fewer than three feet on the ground the body is taken to turn no farther. What
feet slide is not seen. Feet stand where the plan has it, and where they feel forces only those that
do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

from ..log import TOUCH_N, Record
from ..worlds.world import State
from .tracker import Target

LEAST = 3
"""So many feet tell how the body is turned."""
SMOOTH_S = 0.03
"""Time constant of the body's velocity."""


class LegOdometry:
    """Odometry of one motion.

    Arguments:
        first: what is sent first; the first body is where it should be.
        felt: feet feel forces.
    """

    def __init__(
        self, kinematics: Kinematics, first: Target, rate_hz: float, *, felt: bool = False
    ) -> None:
        self._kinematics, self._rate_hz, self._felt = kinematics, rate_hz, felt
        self.origin_m, self.rotation = first.origin_m, rotation_of(first.sample.rotation_rad)
        limbs = len(first.sample.foothold)
        self._before, self._places = np.full(limbs, -1), np.zeros((limbs, 3))
        self._velocity: Array | None = None

    def seen(self, target: Target, state: State) -> State:
        """A state with the body's pose, velocity and feet by odometry.

        Arguments:
            target: what this state came of.
        """
        feet, stood = self._kinematics.feet(state.angles_rad), target.sample.foothold
        if self._felt:
            stood = np.where(np.linalg.norm(state.forces_n, axis=1) > TOUCH_N, stood, -1)
        held, (origin, rotation) = (
            (stood >= 0) & (stood == self._before),
            (self.origin_m, self.rotation),
        )
        if held.any():
            self.origin_m, self.rotation = _body(
                feet[held], (self._places + target.rolled_m)[held], rotation
            )
        now = self.origin_m + feet @ self.rotation.T
        self._places = np.where(held[:, None], self._places, now - target.rolled_m)
        self._before = stood
        turned = Rotation.from_matrix(self.rotation @ rotation.T).as_rotvec()
        moved = self._rate_hz * np.concatenate([self.origin_m - origin, turned])
        share = 1.0 - np.exp(-1.0 / (SMOOTH_S * self._rate_hz))
        before = moved if self._velocity is None else self._velocity
        self._velocity = before + share * (moved - before)
        return replace(
            state,
            position_m=self.origin_m,
            rotation=self.rotation,
            velocity=self._velocity,
            feet_m=now,
        )


def leg_odometry(record: Record, kinematics: Kinematics) -> tuple[Array, Array]:
    """p_WB and R_WB of the base's frame at every control period, shape (T, 3) [m] and (T, 3, 3).

    The first body is where it should be. Which feet stand is the plan's to say.
    """
    odometry = LegOdometry(kinematics, record.pairs[0][0], 1.0)
    states = [odometry.seen(target, state) for target, state in record.pairs]
    return np.array([state.position_m for state in states]), np.array(
        [state.rotation for state in states]
    )


def odometry_error_m(record: Record, kinematics: Kinematics) -> float:
    """Largest distance of the body from where it should be, by leg odometry [m]."""
    origins, _ = leg_odometry(record, kinematics)
    return float(
        np.linalg.norm(origins - [target.origin_m for target, _ in record.pairs], axis=1).max()
    )


def _body(feet: Array, places: Array, rotation: Array) -> tuple[Array, Array]:
    """The body whose feet, in its frame, come nearest to their places.

    Arguments:
        rotation: the one before.
    """
    middle, goal = feet.mean(axis=0), places.mean(axis=0)
    if len(feet) >= LEAST:
        rotation = Rotation.align_vectors(places - goal, feet - middle)[0].as_matrix()
    return goal - rotation @ middle, rotation
