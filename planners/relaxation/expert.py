"""The expert's envelopes, by rule of thumb (Lin et al. §IV-A)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..physics import GRAVITY_M_S2
from ..problem.posture import MAX_TILT_RAD, THREE_LEGS
from ..robot import Robot, hexapod
from .envelope import Envelope, EnvelopeSet

CLIMBING = ((0.0, 0.9), (-0.3, 0.3), (0.0, 0.4))
"""Bounds on f_n, f_y and the vertical shear f_z on a wall, in units of the robot's weight (Lin et
al. §IV-A)."""
WALKING = ((0.0, 0.5), (-0.15, 0.15), (-0.15, 0.15))
"""The same on the ground."""
LENGTH_SCALE_M = 0.6


def rule_of_thumb(
    shoulders_m: Array, reach_m: Array, climbs: NDArray[np.bool_], length_scale_m: float
) -> Envelope:
    """p within the limbs' workspace, f within CLIMBING for limbs on a wall, WALKING for those on
    the ground.

    Arguments:
        shoulders_m: shape (N, 3) [m].
        reach_m, climbs: shape (N,).
    """
    force = np.where(np.asarray(climbs)[:, None, None], CLIMBING, WALKING)
    reach = np.asarray(reach_m)[:, None]
    return Envelope(
        low=np.concatenate([(shoulders_m - reach) / length_scale_m, force[..., 0]], axis=1),
        high=np.concatenate([(shoulders_m + reach) / length_scale_m, force[..., 1]], axis=1),
    )


def expert_envelopes(
    terrain: Literal["ground", "wall"],
    robot: Robot | None = None,
    legs: tuple[str, ...] = THREE_LEGS,
) -> EnvelopeSet:
    """One envelope for these legs on the ground, or on two facing walls, up to 30° off: p within
    the limbs' workspace, f within WALKING or CLIMBING.
    """
    robot = robot or hexapod()
    limbs = robot.select(legs)
    shoulders = np.array([limb.shoulder_m for limb in limbs])
    reach = np.array([limb.reach_m for limb in limbs])
    inward = np.where(shoulders[:, 1] < 0.0, 1.0, -1.0)
    walls = np.column_stack([0.0 * inward, inward, 0.0 * inward])
    return EnvelopeSet(
        problem_class=f"{terrain}-{len(limbs)}",
        legs=tuple(legs),
        force_scale_n=robot.mass_kg * GRAVITY_M_S2,
        length_scale_m=LENGTH_SCALE_M,
        normals=walls if terrain == "wall" else np.tile([0.0, 0.0, 1.0], (len(limbs), 1)),
        tilt_rad=np.full(len(limbs), MAX_TILT_RAD),
        envelopes=(
            rule_of_thumb(shoulders, reach, np.full(len(limbs), terrain == "wall"), LENGTH_SCALE_M),
        ),
        provenance={"method": "heuristic", "source": "paper E §IV-A"},
    )
