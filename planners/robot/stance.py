"""A posture to stand in, where nobody says one: every foot below its hip, joints near the middle of
their limits.
"""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .inverse_kinematics import REACHED_M, descend
from .leg import Leg

DROP = 0.75
"""Share of how far below its hip a foot can be, at which it stands."""
SAMPLES = 4000
NEAREST = 200
BACKWARD = 0.2
"""Preference of a knee to the rear, where both ways are as good: all legs then bend alike."""


def standing(leg: Leg) -> Array:
    """The most comfortable posture found with the foot below the leg's hip, shape (n,) [rad].

    The foot is below the joint that swings it fore and aft, at DROP times the depth that it
    reaches. Of the sampled postures whose feet are near, the one nearest the middle of its limits
    is brought there.
    """
    angles = leg.random_angles(SAMPLES, np.random.default_rng(0))
    feet = leg.chain.feet(angles)
    rest = np.clip(np.zeros(len(leg.joints)), leg.lower_rad, leg.upper_rad)
    hip = leg.chain.frames(rest[None])[1][0][min(1, len(leg.joints) - 1)]
    straight = leg.chain.feet(rest[None])[0]
    target = np.array(
        [hip[0], 0.5 * (hip[1] + straight[1]), hip[2] + DROP * (float(feet[:, 2].min()) - hip[2])]
    )
    near = np.argsort(np.linalg.norm(feet - target, axis=1))[:NEAREST]
    middle, half = 0.5 * (leg.lower_rad + leg.upper_rad), 0.5 * (leg.upper_rad - leg.lower_rad)
    angles_found, error = descend(leg, np.repeat(target[None], len(near), axis=0), angles[near])
    strain = np.max(
        np.abs(angles_found - middle) / np.maximum(half, 1e-9), axis=1
    ) + 1e3 * np.maximum(error - REACHED_M, 0.0)
    knees = leg.chain.frames(angles_found)[1][:, -1]
    strain = strain + BACKWARD * (knees[:, 0] - hip[0]) / max(leg.chain.length_m, 1e-9)
    return np.asarray(angles_found[int(np.argmin(strain))])
