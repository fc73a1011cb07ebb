"""The joints along a plan's path: drawn to the straight line between the angles of its key frames.

Feet are spheres that roll, and the whole robot's centre of mass, legs included, is where the plan
has it: a robot is drawn in the plan as if its legs weighed nothing, and is moved by what they
weigh. So the body at a key frame is up to a centimetre from where the plan draws it, and the joints
are those that bring it there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..answer.plan import Plan
from ..arguments import cached_property
from ..errors import check_time
from ..files.arrays import Array, cross
from ..robot.inverse_kinematics import descend
from ..robot.kinematics import Kinematics
from ..robot.overlaps import WholeBody
from ..robot.rotation import rotations_of
from .path import APART_M, PathMoments, PlanPath
from .plan_joints import normals_at

STRAY_M = 1e-4
"""A foot that is farther from where it should be does not follow its path: what the tracker looks
for anew, and the runner refuses, too."""
TURN_RAD = 0.1
"""Between two moments that are judged no joint turns by much more: half way, joints that turn
evenly put a foot less than L θ² / 8 from its path, a fraction of a millimetre."""
ROUNDS = 2
"""Joints are found so often: where the centre of mass is, and how far feet rolled, depends on
them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPostures:
    """A robot at T moments, J joints, N limbs.

    Arguments:
        rotations, origins_m: R_WB and p_WB of the base's frame, shape (T, 3, 3), (T, 3) [m].
        angles: shape (T, J) [rad].
        error_m: how far feet stay from where they should be, shape (T, N).
    """

    rotations: Array
    origins_m: Array
    angles: Array
    error_m: Array


class JointPath:
    """The joints of a robot along the path of a plan that has joint angles.

    They are drawn to the straight line between those of two key frames. Where a limb in the air
    does not follow its foot's path so, the line goes by way of comfortable postures at the two
    corners of its swing.

    Arguments:
        apart_m: of the moments at which that is looked at, those that are judged.
    """

    def __init__(self, path: PlanPath, kinematics: Kinematics, apart_m: float = APART_M) -> None:
        self.path, self._kinematics, self._apart_m = path, kinematics, apart_m
        self.corners = dict[tuple[int, int], Array]()
        """Angles at both corners of a swing, shape (2, n), by key frame that it ends at and
        limb."""

    def judged(
        self, turn_rad: float = TURN_RAD, *, deadline: float = math.inf
    ) -> tuple[PathMoments, PathPostures]:
        """Moments so near to each other, nearer where joints turn by more than ``turn_rad`` in
        between, and the postures there.

        Raises InvalidInput for a path of which there are too many, and TimeEnded after the deadline
        (``time.perf_counter()``).
        """
        counts = self.path.counts(self._apart_m)
        moments = self.path.divided(counts)
        postures = self._postures(moments)
        if postures.error_m.max() > STRAY_M:
            self._turn(moments, postures, deadline)
            postures = self._postures(moments)
        check_time(deadline)
        turned = np.abs(np.diff(postures.angles, axis=0, prepend=postures.angles[:1])).max(axis=1)
        finer = np.ceil(np.maximum.reduceat(turned, np.cumsum(counts) - counts) / turn_rad)
        if finer.max() > 1.0:
            moments = self.path.divided(counts * np.maximum(finer, 1.0).astype(int))
            postures = self._postures(moments)
        return moments, postures

    def postures(self, moments: PathMoments) -> PathPostures:
        """The postures at moments that follow each other."""
        _ = self._turned
        return self._postures(moments)

    @cached_property
    def _turned(self) -> bool:
        """Tell whether corners are known."""
        self.judged()
        return True

    def _turn(self, moments: PathMoments, postures: PathPostures, deadline: float) -> None:
        """Find postures for the corners of swings that limbs do not follow."""
        steps, missed = moments.step, postures.error_m > STRAY_M
        for t, limb in np.argwhere(missed & (moments.foothold < 0)).tolist():
            step = int(steps[t])
            if (step, limb) in self.corners or moments.part[t] < 0:
                continue
            check_time(deadline)
            ends = np.flatnonzero(
                (steps == step) & np.isin(moments.part, (0, 1)) & (moments.passed == 1.0)
            )
            self.corners[step, limb] = np.array(
                [self._comfortable(moments, postures, int(end), limb) for end in ends]
            )

    def _comfortable(
        self, moments: PathMoments, postures: PathPostures, t: int, limb: int
    ) -> Array:
        """A comfortable posture of a limb at a moment, near to where it is drawn."""
        normals = self.path.normals[moments.surface[t]]
        answer = self._kinematics.solve(
            moments.com_m[t],
            moments.rotation_rad[t],
            moments.feet_m[t] - self.path.radii_m[:, None] * normals,
            normals=normals,
            seed=postures.angles[t],
            obstacles=self.path.solids,
        )
        return np.asarray(answer.angles[self._kinematics.joints_of(limb)])

    def _drawn(self, moments: PathMoments) -> Array:
        """Posture that the joints are drawn to, shape (T, J)."""
        key = self.path.plan.joints_rad
        assert key is not None
        angles = key[moments.before] + moments.share[:, None] * (
            key[moments.after] - key[moments.before]
        )
        for (step, limb), corners in self.corners.items():
            joints = self._kinematics.joints_of(limb)
            line = np.stack([key[step - 1, joints], *corners, key[step, joints]])
            on = np.flatnonzero((moments.step == step) & (moments.part >= 0))
            part, passed = moments.part[on], moments.passed[on, None]
            angles[np.ix_(on, joints)] = line[part] + passed * (line[part + 1] - line[part])
        return np.asarray(angles)

    def _postures(self, moments: PathMoments) -> PathPostures:
        kinematics, angles = self._kinematics, self._drawn(moments)
        rotations = rotations_of(moments.rotation_rad)
        normals, feet, wished = self.path.normals[moments.surface], moments.feet_m, angles
        origins, error = moments.com_m, np.zeros(feet.shape[:2])
        for _ in range(ROUNDS):
            shifts = np.array([kinematics.com_offset(q) for q in angles])
            origins = moments.com_m - np.einsum("tij,tj->ti", rotations, shifts)
            feet = moments.feet_m + _rolled(kinematics, moments, rotations, angles, normals)
            angles, error = _reached(
                kinematics, np.einsum("tij,tni->tnj", rotations, feet - origins[:, None]), wished
            )
        return PathPostures(rotations=rotations, origins_m=origins, angles=angles, error_m=error)


def path_bodies(path: PlanPath, moments: PathMoments, postures: PathPostures) -> WholeBody:
    """Postures as ``Bodies`` takes them."""
    normals = path.normals[moments.surface]
    return WholeBody(
        rotation=postures.rotations,
        origin_m=postures.origins_m,
        angles=postures.angles,
        toes_m=moments.feet_m - path.radii_m[:, None] * normals,
        normals=normals,
        stands=moments.foothold >= 0,
    )


def key_postures(plan: Plan, angles: Array) -> WholeBody:
    """The postures of the key frames as they are drawn, rotations taken exactly.

    Arguments:
        angles: shape (M, J) [rad].
    """
    robot, frames = plan.problem.robot, range(len(angles))
    turns = rotations_of(plan.rotation_rad)
    return WholeBody(
        rotation=turns,
        origin_m=plan.com_m - turns @ robot.origin_m,
        angles=angles,
        toes_m=np.array([plan.toes_at(k) for k in frames]),
        normals=np.array([normals_at(plan, k) for k in frames]),
        stands=np.ones((len(angles), len(robot.limbs)), dtype=bool),
    )


def _reached(kinematics: Kinematics, feet: Array, drawn: Array) -> tuple[Array, Array]:
    """Joints whose feet are there, each leg as near to what it is drawn to as it goes; and what
    they miss.
    """
    angles, errors = np.empty_like(drawn), np.empty(feet.shape[:2])
    for i, leg in enumerate(kinematics.model.legs):
        joints = kinematics.joints_of(i)
        angles[:, joints], errors[:, i] = descend(leg, feet[:, i], drawn[:, joints])
    return angles, errors


def _rolled(
    kinematics: Kinematics, moments: PathMoments, rotations: Array, angles: Array, normals: Array
) -> Array:
    """Distance that feet have rolled since they were put down, shape (T, N, 3) [m]; lifted, they go
    back to their path.

    A sphere that rolls by a small turn ω moves by ω × r n.
    """
    legs = kinematics.model.legs
    turned = np.stack(
        [
            rotations @ leg.chain.frames(angles[:, kinematics.joints_of(i)])[0][:, -1]
            for i, leg in enumerate(legs)
        ],
        axis=1,
    )
    between = turned[1:] @ np.swapaxes(turned[:-1], 2, 3)
    skewed = 0.5 * (between - np.swapaxes(between, 2, 3))
    turns = np.stack([skewed[..., 2, 1], skewed[..., 0, 2], skewed[..., 1, 0]], axis=-1)
    moved = kinematics.radii_m[:, None] * cross(turns, normals[1:])
    stands, rolled = moments.foothold >= 0, np.zeros_like(normals)
    rolled[1:] = np.where((stands[1:] & stands[:-1])[..., None], moved, 0.0)
    for i in range(len(legs)):
        landed = np.flatnonzero(stands[1:, i] & ~stands[:-1, i]) + 1
        for path in np.split(rolled[:, i], landed):
            np.cumsum(path, axis=0, out=path)
    rolled *= 1.0 - moments.lifted[..., None]
    return rolled
