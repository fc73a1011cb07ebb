"""Which of a limb's postures to take along a motion: four joints have one more than a foot's position needs.

Chosen for every limb at once over the whole motion, by dynamic programming over the closed-form family of postures
(``planners.robot.leg_ik``): comfortable ones, and near each other, so that no joint jumps from one branch to another
and no limb walks into a joint limit that a posture on the way would have avoided. A plan that has joint angles has
chosen: its motion goes through them, unless a limb that is drawn up would jump on the way between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.joints import JointPath
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg_ik import NEAR, clearance_of, posture_cost
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.urdf import link_lengths, outward_rad
from stancekit.planners.terrain.prism import Solid

from .motion import Motion, MotionSample
from .timeline import PlanMotion

ROUGH = 10
"""The shift of the centre of mass, which depends on the postures, is looked at at every tenth knot."""
TURNED = 100.0
"""Cost of a turn of 1 rad between two knots, squared, in the units of a posture's discomfort at one knot."""
LEFT = 60.0
"""The same for the first posture, as far as it is from where the robot is."""
SMOOTHED = 2.0
"""Standard deviation of the smoothing over the family's steps, in knots; what it moves of a foot the tracker undoes."""
JUMP_RAD = 0.5
"""A joint that turns more between two knots jumps to another posture of the same foot, and no pace is slow enough."""


class RedundancyResolution:
    """Comfortable joint angles over a motion: what inverse kinematics is drawn to. ``at`` a time: shape (J,) [rad]."""

    def __init__(self, motion: Motion, kinematics: Kinematics, near_rad: Array | None = None) -> None:
        times = motion.knots_s
        if isinstance(motion, PlanMotion) and motion.plan.joints_rad is not None:
            path = _planned(motion, times, kinematics, near_rad)
            if kinematics.robot.model is not None or np.abs(np.diff(path, axis=0)).max() < JUMP_RAD:
                self._set(times, path)
                return
        samples = [motion.at(float(time_s)) for time_s in times]
        if kinematics.robot.model is not None:
            self._set(times, _followed(samples, kinematics, near_rad))
            return
        shifts = np.zeros((len(times), 3))
        _, rough = _families(samples, shifts, motion.solids, kinematics, slice(None, None, ROUGH))
        shifts = np.repeat([kinematics.com_offset(q) for q in rough], ROUGH, axis=0)[: len(times)]
        tables, _ = _families(samples, shifts, motion.solids, kinematics, slice(None))
        near = None if near_rad is None else np.asarray(near_rad).reshape(len(tables), -1)
        chosen = [_cheapest(table, None if near is None else near[limb]) for limb, table in enumerate(tables)]
        self._set(
            times, np.concatenate([gaussian_filter1d(q, SMOOTHED, axis=0, mode="nearest") for q in chosen], axis=1)
        )

    def _set(self, times: Array, path: Array) -> None:
        self._angles = make_interp_spline(times, path, k=3)
        self._end = float(times[-1])

    def at(self, time_s: float) -> Array:
        """The ends are held."""
        return np.asarray(self._angles(min(max(time_s, 0.0), self._end)))


def _planned(motion: PlanMotion, times: Array, kinematics: Kinematics, near_rad: Array | None) -> Array:
    """Postures of a plan that has joint angles, as the verifier judges them; from where the robot is while it settles,
    shape (T, J)."""
    path = JointPath(motion.path, kinematics).postures(motion.moments(times)).angles
    if near_rad is not None:
        left = np.clip(1.0 - times / motion.timing.settle_s, 0.0, 1.0)[:, None]
        path = path + left * (near_rad - path[0])
    return path


def _followed(samples: Sequence[MotionSample], kinematics: Kinematics, near_rad: Array | None) -> Array:
    """Postures of a robot's own legs, each near the one before, the first near where it stands, shape (T, J)."""
    angles = np.concatenate([leg.stance_rad for leg in kinematics.model.legs]) if near_rad is None else near_rad
    path = list[Array]()
    for sample in samples:
        rotation = rotation_of(sample.rotation_rad)
        for _ in range(2 if path else 4):  # the shift of the centre of mass depends on the posture
            origin = sample.com_m - rotation @ kinematics.com_offset(angles)
            angles, _ = kinematics.reach((sample.feet_m - origin) @ rotation, angles, angles)
        path.append(angles)
    return np.array(path)


Table = tuple[Array, Array]
"""Postures of one limb at every knot, shape (T, K, 4), and what they cost, shape (T, K)."""


def _families(
    samples: Sequence[MotionSample], shifts: Array, solids: Sequence[Solid], kinematics: Kinematics, chosen: slice
) -> tuple[list[Table], Array]:
    """Tables of all limbs, and the cheapest postures at every knot alone, shape (T, J)."""
    tables, samples = list[Table](), samples[chosen]
    turns = np.array([rotation_of(sample.rotation_rad) for sample in samples])
    coms, feet, normals = (np.array([getattr(s, name) for s in samples]) for name in ("com_m", "feet_m", "normals"))
    origins = coms - (turns @ shifts[chosen, :, None])[..., 0]
    for i, limb in enumerate(kinematics.robot.limbs):
        shoulders, towards = origins + turns @ limb.shoulder_m, turns @ rotation_of([0.0, 0.0, outward_rad(limb)])
        target, normal = ((v[:, None] @ towards)[:, 0] for v in (feet[:, i] - shoulders, normals[:, i]))
        clearance = clearance_of(shoulders, towards, solids, NEAR * limb.reach_m)
        tables.append(posture_cost(link_lengths(limb), target, -normal, kinematics.servo, clearance=clearance))
    alone = [np.take_along_axis(of, np.argmin(cost, axis=1)[:, None, None], axis=1)[:, 0] for of, cost in tables]
    return tables, np.concatenate(alone, axis=1)


def _cheapest(table: Table, near: Array | None) -> Array:
    """The cheapest path through a table, shape (T, 4)."""
    families, costs = table
    family, cost = families[0], costs[0]
    total = cost if near is None else cost + LEFT * np.sum((family - near) ** 2, axis=1)
    back = list[Array]()
    for (before, after), cost in zip(pairwise(families), costs[1:], strict=True):
        far = np.sum(before**2, axis=1)[:, None] + np.sum(after**2, axis=1) - 2.0 * before @ after.T
        through = total[:, None] + TURNED * far
        back.append(np.argmin(through, axis=0))
        total = through.min(axis=0) + cost
    index = [int(np.argmin(total))]
    for row in reversed(back):
        index.append(int(row[index[-1]]))
    found = families[np.arange(len(families)), index[::-1]]
    if near is not None:
        found[0] = near
    return found
