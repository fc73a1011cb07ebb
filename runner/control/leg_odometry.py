"""Leg odometry: where the body is by its joints' encoders and the feet that stand, where nothing measures it.

Feet that stand are taken to stay where they were put down, but for what they roll: of the rigid motions of the body the
one is taken that brings the feet, as the joints have them, nearest to those places (Kabsch). With fewer than three
feet on the ground the body is taken to turn no farther. What feet slide is not seen.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

from ..record import Record

LEAST = 3
"""So many feet tell how the body is turned."""


def leg_odometry(record: Record, kinematics: Kinematics) -> tuple[Array, Array]:
    """p_WB and R_WB of the base's frame at every control period, shape (T, 3) [m] and (T, 3, 3).

    The first body is where it should be. Which feet stand is the plan's to say.
    """
    first = record.pairs[0][0]
    origin, rotation = first.origin_m, rotation_of(first.sample.rotation_rad)
    before = np.full(len(first.sample.foothold), -1)
    places, origins, rotations = np.zeros((len(before), 3)), list[Array](), list[Array]()
    for target, state in record.pairs:
        feet, stood = kinematics.feet(state.angles_rad), np.array(target.sample.foothold)
        held = (stood >= 0) & (stood == before)
        if held.any():
            origin, rotation = _body(feet[held], (places + target.rolled_m)[held], rotation)
        places = np.where(held[:, None], places, origin + feet @ rotation.T - target.rolled_m)
        before = stood
        origins.append(origin)
        rotations.append(rotation)
    return np.array(origins), np.array(rotations)


def odometry_error_m(record: Record, kinematics: Kinematics) -> float:
    """How far the body was from where it should be, at most, by leg odometry [m]."""
    origins, _ = leg_odometry(record, kinematics)
    return float(np.linalg.norm(origins - [target.origin_m for target, _ in record.pairs], axis=1).max())


def _body(feet: Array, places: Array, rotation: Array) -> tuple[Array, Array]:
    """The body whose feet, in its frame, come nearest to their places. rotation: the one before."""
    middle, goal = feet.mean(axis=0), places.mean(axis=0)
    if len(feet) >= LEAST:
        rotation = Rotation.align_vectors(places - goal, feet - middle)[0].as_matrix()
    return goal - rotation @ middle, rotation
