"""Choice of a limb's postures along a motion: four joints have one more than a foot's position
needs.

Chosen for every limb at once over the whole motion, by dynamic programming over the closed-form
family of postures (``planners.robot.kinematics``): comfortable ones, and near each other, so that no
joint jumps from one branch to another and no limb walks into a joint limit that a posture on the
way would have avoided. A plan that has joint angles has chosen: its motion goes through them. Where
a limb that is drawn up would jump on the way between them, while it swings, that swing alone is
chosen anew, between the postures that the plan has at both its ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import Group
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.joints import JointPath
from stancekit.planners.motion.motion import Played, Samples, smooth
from stancekit.planners.motion.plan_motion import moments_at
from stancekit.planners.robot.bodies import Bodies
from stancekit.planners.robot.inverse_kinematics import WholeBody
from stancekit.planners.robot.kinematics import (
    NEAR,
    Kinematics,
    clearance_of,
    link_lengths,
    outward_rad,
    posture_cost,
)
from stancekit.planners.robot.leg import JOINTS, rotation_of, rotations_of
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.terrain.patch import Solid
from stancekit.planners.verify.bodies import bodies_group, spaced as rows_apart

_MIDDLES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Places in a control period at which forces are looked at, as shares of it before its end."""


def load_transfer(
    motion: Played, forces_n: Array | float = 0.0, within_s: float = math.inf
) -> Played:
    """A motion that begins at rest, taken up by a robot whose feet carry other forces.

    Their load moves evenly from the feet that carry it now to those that shall: both sets of forces
    balance the same posture and are within cones, and so is everything between them.

    Arguments:
        forces_n: those of now, shape (N, 3) [N]; 0 of a robot that hangs in a stand.
        within_s: how long that takes [s], no longer than the motion is at rest; infinite for a
            robot that never carries itself.
    """

    def at(times_s: float | Array) -> Samples:
        sample = motion.at(times_s)
        part = smooth(np.clip(np.asarray(times_s) / within_s, 0.0, 1.0))[..., None, None]
        mixed = forces_n + part * (sample.forces_n - forces_n)
        return replace(sample, forces_n=np.where(part < 1.0, mixed, sample.forces_n))

    return replace(motion, at=at)


def mean_forces(motion: Played, period_s: float) -> Played:
    """A dynamic motion whose forces are, at every time, their means over the control period that
    ends then, as a tracker commands them: feet lift and land within periods, and at full force. One
    that carries during any part of a period stands in it.

    Arguments:
        period_s: of control [s].
    """

    def at(times_s: float | Array) -> Samples:
        sample = motion.at(times_s)
        forces, foothold = np.zeros_like(sample.forces_n), np.array(sample.foothold)
        for share in _MIDDLES:
            within = motion.at(np.asarray(times_s) - share * period_s)
            forces += within.forces_n / len(_MIDDLES)
            foothold = np.where(foothold < 0, within.foothold, foothold)
        return replace(sample, forces_n=forces, foothold=foothold)

    return replace(motion, at=at)


ROUGH = 10
"""The shift of the centre of mass, which depends on the postures, is looked at at every tenth
knot."""
TURNED = 100.0
"""Cost of a turn of 1 rad between two knots, squared, in the units of a posture's discomfort at one
knot."""
LEFT = 60.0
"""The same for the first posture, as far as it is from where the robot is."""
_ENDS = 1e4
"""The same for the last posture of a swing: the one that the plan stands in comes next."""
_SMOOTHED = 2.0
"""Standard deviation of the smoothing over the family's steps, in knots; what it moves of a foot
the tracker undoes."""
JUMP_RAD, _LEAP_RAD = 0.5, 1.0
"""A joint that turns so far between two knots jumps to another posture of the same foot: while its
limb swings that is smoothed; while it stands, from the second on no pace is slow enough, and all
postures are chosen anew."""


class RedundancyResolution:
    """Comfortable joint angles over a motion: what inverse kinematics is drawn to.

    ``at`` times of shape (…,) it is of shape (…, J) [rad]. path_rad: at the motion's knots, shape
    (T, J).
    """

    def __init__(
        self, motion: Played, kinematics: Kinematics, near_rad: Array | None = None
    ) -> None:
        times = motion.knots_s
        if motion.path is not None and motion.path.plan.joints_rad is not None:
            path = JointPath(motion.path, kinematics).postures(moments_at(motion, times)).angles
            path = _from(near_rad, path, motion, times)
            if kinematics.drawn:
                path = _without_jumps(
                    path, [motion.at(float(t)) for t in times], motion.solids, kinematics
                )
            if not kinematics.drawn or _jumps(path, _LEAP_RAD).size == 0:
                self._set(times, path)
                return
        samples = [motion.at(float(time_s)) for time_s in times]
        if not kinematics.drawn:
            self._set(times, _followed(samples, kinematics, near_rad))
            return
        shifts = np.zeros((len(times), 3))
        limbs = range(len(kinematics.robot.limbs))
        rough = _comfortable(
            [
                _family(samples[::ROUGH], shifts[::ROUGH], motion.solids, kinematics, limb)
                for limb in limbs
            ]
        )
        shifts = np.repeat([kinematics.com_offset(q) for q in rough], ROUGH, axis=0)[: len(times)]
        tables = [_family(samples, shifts, motion.solids, kinematics, limb) for limb in limbs]
        near = None if near_rad is None else np.asarray(near_rad).reshape(len(tables), -1)
        chosen = [
            _cheapest(table, None if near is None else near[limb])
            for limb, table in enumerate(tables)
        ]
        smooth = [_smoothed(q) for q in chosen]
        self._set(times, _from(near_rad, np.concatenate(smooth, axis=1), motion, times))

    def _set(self, times: Array, path: Array) -> None:
        from scipy.interpolate import make_interp_spline  # slow to import

        self.path_rad = path
        self._angles = make_interp_spline(times, path, k=3)
        self._end = float(times[-1])

    def retimed(self, times_s: Array) -> Self:
        """Resolution with the same postures at other times, shape (T,) [s]."""
        copy_of_it = copy(self)
        copy_of_it._set(times_s, self.path_rad)
        return copy_of_it

    def at(self, times_s: float | Array) -> Array:
        """The ends are held."""
        return np.asarray(self._angles(np.minimum(np.maximum(times_s, 0.0), self._end)))


def resolved(motion: Played, kinematics: Kinematics) -> RedundancyResolution:
    """Resolve the postures that inverse kinematics is drawn to along a motion; half of the work
    before a run, which trackers share.
    """
    return RedundancyResolution(motion, kinematics, kinematics.near_rad)


def _from(near_rad: Array | None, path: Array, motion: Played, times: Array) -> Array:
    """The path from where the robot is, if it is somewhere: what it is off by there fades while the
    motion is at rest. A robot that stands has no other way to the beginning that moves no foot.
    """
    if near_rad is None:
        return path
    rest_s = motion.rest_s or motion.duration_s
    return np.asarray(
        path + np.clip(1.0 - times / rest_s, 0.0, 1.0)[:, None] * (near_rad - path[0])
    )


def _jumps(path: Array, most_rad: float = JUMP_RAD) -> NDArray[np.int_]:
    """Knots before which a limb jumps, and the limb, shape (n, 2)."""
    far = np.abs(np.diff(path, axis=0)).reshape(len(path) - 1, -1, len(JOINTS))
    return np.asarray(np.argwhere(far.max(axis=2) >= most_rad) + np.array([1, 0]))


def _without_jumps(
    path: Array, samples: Sequence[Samples], solids: Sequence[Solid], kinematics: Kinematics
) -> Array:
    """The path with those swings chosen anew in which a limb jumps, from where it stands to where
    it stands again.
    """
    smoothed, swings = np.array(path), set[tuple[int, int, int]]()
    stands = np.array([sample.foothold for sample in samples]) >= 0
    for knot, limb in _jumps(path):
        on = np.flatnonzero(stands[:, limb])
        before, after = on[on < knot], on[on >= knot]
        if len(before) and len(after):
            swings.add((int(limb), int(before[-1]), int(after[0])))
    for limb, begin, end in swings:
        within, joints = slice(begin, end + 1), kinematics.joints_of(limb)
        shifts = np.array([kinematics.com_offset(q) for q in path[within]])
        table = _family(samples[within], shifts, solids, kinematics, limb)
        chosen = _cheapest(table, path[begin, joints], path[end, joints])
        if _jumps(chosen).size:  # the family has no hip beyond the vertical
            chosen = path[within, joints]
        smoothed[within, joints] = _smoothed(chosen)
        smoothed[begin, joints], smoothed[end, joints] = path[begin, joints], path[end, joints]
    return smoothed


def _smoothed(path: Array) -> Array:
    """A limb's postures without the family's steps, shape (T, 4)."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(path, _SMOOTHED, axis=0, mode="nearest"))


def _followed(samples: Sequence[Samples], kinematics: Kinematics, near_rad: Array | None) -> Array:
    """Postures of a robot's own legs, each near the one before, the first near where it stands,
    shape (T, J).
    """
    angles = (
        np.concatenate([leg.stance_rad for leg in kinematics.model.legs])
        if near_rad is None
        else near_rad
    )
    path = list[Array]()
    for sample in samples:
        rotation = rotation_of(sample.rotation_rad)
        for _ in range(2 if path else 4):  # the shift of the centre of mass depends on the posture
            origin = sample.com_m - rotation @ kinematics.com_offset(angles)
            feet, up = (sample.feet_m - origin) @ rotation, sample.normals @ rotation
            angles, _ = kinematics.reach(feet, angles, angles, up)
        path.append(angles)
    return np.array(path)


Table = tuple[Array, Array]
"""Postures of one limb at every knot, shape (T, K, 4), and what they cost, shape (T, K)."""


def _family(
    samples: Sequence[Samples],
    shifts: Array,
    solids: Sequence[Solid],
    kinematics: Kinematics,
    limb: int,
) -> Table:
    """The table of a limb.

    Arguments:
        shifts: of the centre of mass in the body, shape (T, 3) [m].
    """
    limb_of_it = kinematics.robot.limbs[limb]
    turns = np.array([rotation_of(sample.rotation_rad) for sample in samples])
    coms = np.array([sample.com_m for sample in samples])
    feet, normals = (
        np.array([getattr(sample, name)[limb] for sample in samples])
        for name in ("feet_m", "normals")
    )
    shoulders = coms - (turns @ shifts[..., None])[..., 0] + turns @ limb_of_it.shoulder_m
    towards = turns @ rotation_of([0.0, 0.0, outward_rad(limb_of_it)])
    target, normal = ((v[:, None] @ towards)[:, 0] for v in (feet - shoulders, normals))
    clearance = clearance_of(shoulders, towards, solids, NEAR * limb_of_it.reach_m)
    return posture_cost(
        link_lengths(limb_of_it), target, -normal, kinematics.servo, clearance=clearance
    )


def _comfortable(tables: Sequence[Table]) -> Array:
    """The cheapest postures at every knot alone, shape (T, J)."""
    return np.concatenate(
        [
            np.take_along_axis(of, np.argmin(cost, axis=1)[:, None, None], axis=1)[:, 0]
            for of, cost in tables
        ],
        axis=1,
    )


def _cheapest(table: Table, near: Array | None, then: Array | None = None) -> Array:
    """The cheapest path through a table, shape (T, 4).

    Arguments:
        near, then: where it begins, and ends, if that is given.
    """
    families, costs = table
    family, cost = families[0], costs[0]
    total = cost if near is None else cost + LEFT * np.sum((family - near) ** 2, axis=1)
    back = list[Array]()
    for (before, after), cost in zip(pairwise(families), costs[1:], strict=True):
        far = np.sum(before**2, axis=1)[:, None] + np.sum(after**2, axis=1) - 2.0 * before @ after.T
        through = total[:, None] + TURNED * far
        back.append(np.argmin(through, axis=0))
        total = through.min(axis=0) + cost
    if then is not None:
        total = total + _ENDS * np.sum((families[-1] - then) ** 2, axis=1)
    index = [int(np.argmin(total))]
    for row in reversed(back):
        index.append(int(row[index[-1]]))
    best = families[np.arange(len(families)), index[::-1]]
    if near is not None:
        best[0] = near
    if then is not None:
        best[-1] = then
    return best


def motion_bodies(plan: Plan, rows: Samples, kinematics: Kinematics) -> Group:
    """Judge the postures of a plan's motion, ``APART_M`` apart.

    Raises InvalidInput without coal.

    Arguments:
        rows: of the whole motion, as ``joint_profile`` has them.
    """
    bodies, some = Bodies(kinematics, Obstacles.of(plan.problem.terrain)), spaced(rows)
    found = postures(rows, kinematics).at(some)
    return bodies_group("motion", bodies, rows.frame[some], found, between=True)


def postures(rows: Samples, kinematics: Kinematics) -> WholeBody:
    """Postures that the whole robot should have at the ends of control periods."""
    assert rows.origin_m is not None
    assert rows.angles_rad is not None
    return WholeBody(
        rotation=rotations_of(rows.rotation_rad),
        origin_m=rows.origin_m,
        angles=rows.angles_rad,
        toes_m=rows.feet_m - kinematics.radii_m[:, None] * rows.normals,
        normals=rows.normals,
        stands=rows.stands,
    )


def spaced(rows: Samples) -> NDArray[np.intp]:
    """Numbers of the first row of a motion, of the last, and of as few in between as keep
    neighbours within ``APART_M`` and ``TURN_RAD`` of each other.
    """
    assert rows.origin_m is not None
    assert rows.angles_rad is not None
    return rows_apart(
        np.concatenate([rows.feet_m, rows.origin_m[:, None]], axis=1), rows.angles_rad
    )
