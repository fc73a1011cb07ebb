"""The soft start: from the pose that was measured to the first pose of the motion, slowly, with
feet kept clear.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics

from ..worlds.world import Ground, Solids, Terrain

SLACK_M = 0.006
"""So deep a foot may be in a surface on the path: what it stands on, and what it is off by, is no
collision."""
TOUCHING_M, RISES = 0.001, 40
"""A foot that is no deeper in the terrain touches it; and how often a robot is put higher."""
LEVEL = 0.5
"""Upward part of the normal of a surface that a robot is put higher for; none is lifted out of a wall."""
SAMPLES = 40
STILL_RAD = 1e-4
PEAK = 1.875
"""Greatest velocity of a quintic from 0 to 1 in unit time."""


def soft_motion(
    start_rad: Array, goal_rad: Array, speed_rad_s: float, rate_hz: float
) -> Iterator[Array]:
    """Joint angles from start to goal, no joint faster than this, at rest at both ends, shape (J,)
    each.
    """
    change = np.asarray(goal_rad) - start_rad
    longest = float(np.abs(change).max())
    if longest <= STILL_RAD:
        return
    periods = max(1, int(np.ceil(PEAK * longest / speed_rad_s * rate_hz)))
    for k in range(1, periods + 1):
        s = k / periods
        yield start_rad + s * s * s * (10.0 - 15.0 * s + 6.0 * s * s) * change


def soft_start(
    kinematics: Kinematics,
    solids: Solids,
    pose: tuple[Array, Array],
    measured_rad: Array,
    first_rad: Array,
    normals: Array,
    clearance_m: float,
) -> list[Array]:
    """The joint angles to go to, one after the other, the last ``first_rad``.

    Arguments:
        pose: position, shape (3,) [m], and rotation of the body, shape (3, 3).
        normals: of the surfaces that the feet stand on, shape (N, 3). Goes straight where no foot
            enters a surface; else over a pose whose feet are off by clearance_m.

    Raises:
        InvalidInput: with the limb's name where both paths are blocked.
    """
    depth, limb = _deepest(kinematics, solids, pose, [measured_rad, first_rad])
    if depth <= SLACK_M:
        return [first_rad]
    above = kinematics.feet(first_rad) + clearance_m * normals @ pose[1]
    off, _ = kinematics.reach(above, first_rad, first_rad)
    around, _ = _deepest(kinematics, solids, pose, [measured_rad, off, first_rad])
    if around <= SLACK_M:
        return [off, first_rad]
    raise InvalidInput(
        f"soft start: limb {limb}: its foot would go {1e3 * depth:.0f} mm into a surface on the "
        "way from the measured "
        "pose to the first one: bring the robot closer to it, or check its calibration"
    )


def rise_m(terrain: Terrain, feet_m: Array, radii_m: Array) -> float:
    """Height by which a robot has to be put higher for no foot to be in the terrain [m].

    Arguments:
        feet_m: centres of the feet, shape (N, 3).
        radii_m: of the feet, shape (N,).
    """
    solids: Solids = (
        (terrain,)
        if isinstance(terrain, Ground)
        else [each.solid for each in terrain if each.normal[2] > LEVEL]
    )
    rise = 0.0
    for _ in range(RISES if solids else 0):
        feet = feet_m + np.array([0.0, 0.0, rise])
        deepest = max(float((radii_m - solid.distance(feet)).max()) for solid in solids)
        if deepest <= TOUCHING_M:
            return rise
        rise += deepest
    return 0.0


def _deepest(
    kinematics: Kinematics, solids: Solids, pose: tuple[Array, Array], path: Sequence[Array]
) -> tuple[float, str]:
    """Largest depth of feet in surfaces, and the foot [m]; negative where all are outside."""
    position, rotation = pose
    worst = np.full(len(kinematics.robot.limbs), -np.inf)
    for start, goal in pairwise(path):
        for s in np.linspace(0.0, 1.0, SAMPLES):
            feet = position + kinematics.feet(start + s * (goal - start)) @ rotation.T
            for solid in solids:
                worst = np.maximum(worst, kinematics.radii_m - solid.distance(feet))
    index = int(np.argmax(worst))
    return float(worst[index]), kinematics.robot.limb_names[index]
