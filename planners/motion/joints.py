"""The joints along a plan's path: drawn to the straight line between the angles of its key frames.

Feet are spheres that roll, and the whole robot's centre of mass, legs included, is where the plan
has it: a robot is drawn in the plan as if its legs weighed nothing, and is moved by what they
weigh. So the body at a key frame is up to a centimetre from where the plan draws it, and the joints
are those that bring it there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..answer.trajectory import Trajectory
from ..errors import check_time, until
from ..files.arrays import Array, cross
from ..robot.inverse_kinematics import (
    InverseKinematics,
    WholeBody,
    centres_of,
    descend_legs,
)
from ..robot.kinematics import Kinematics
from ..robot.leg import rotations_of, small_turns
from ..robot.model import robot_of
from ..robot.robot_model import RobotModel
from ..terrain.patch import solids_of
from .path import APART_M, PathMoments, PlanPath, path_of

STRAY_M = 1e-4
"""A foot that is farther from where it should be does not follow its path: what the tracker looks
for anew, and the runner refuses, too."""
_ROUNDS, _SETTLED_M = 100, 0.1 * STRAY_M
"""Joints are found so often at most, and until that moves no body whose feet are where they should
be by more: where the centre of mass is, and how far feet rolled, depends on them."""
_WALK_ROUNDS = 6
"""Those of a walk at least: the centre of mass moves in the body as legs do, which moves the legs;
every round leaves a fifth of it, and more where legs are heavy."""


def walk_joints(trajectory: Trajectory, samples: slice = slice(None)) -> tuple[Array, Array]:
    """Angles at every sample, or some, each found from the standing posture, and errors of the feet,
    as ``InverseKinematics.solve`` has them; feet face the ground below them, also in the air.

    Raises InvalidInput for a robot that is but boxes.
    """
    model, normals = trajectory.robot.own_model(), _normals(trajectory)[samples]
    torso, rotation, feet = (
        trajectory.torso_m[samples],
        trajectory.rotation[samples],
        trajectory.feet_m[samples],
    )
    legs = InverseKinematics(model.legs)
    return legs.solve(centres_of(model, torso, rotation, feet, normals), near=legs.standing)


class MovingBody:
    """The robot of a model along a motion of its centre of mass and its toes; it is kept for
    several motions.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model, self.kinematics = model, Kinematics(robot_of(model))
        self._solver = InverseKinematics(model.legs)

    def postures(
        self,
        com_m: Array,
        rotation: Array,
        toes_m: Array,
        normals: Array,
        stands: NDArray[np.bool_],
        *,
        near: Array | None = None,
        rounds: int = 0,
        steps: int = 0,
    ) -> WholeBody:
        """Postures of K samples of a robot whose legs weigh something, each found from the standing
        posture or from one that is near: the base's frame is where the whole robot's centre of mass
        is at the motion's.

        Arguments:
            com_m: of the whole robot, shape (K, 3) [m].
            rotation: R_WB, shape (K, 3, 3).
            toes_m, normals: where feet touch or would, and of the surface there, shape (K, N, 3).
            stands: which feet touch, shape (K, N).
            near: angles to begin with, shape (K, J) [rad].
            rounds: 0 for ``_WALK_ROUNDS``, and more until no body moves whose feet are where they
                should be.
            steps: of inverse kinematics at most, from ``near`` alone; 0 for as many as it takes.
        """
        body_m, angles = self.model.com_m, near
        origin = com_m - rotation @ body_m
        if near is not None:
            origin = com_m - np.einsum("kij,kj->ki", rotation, self._shifts(near))
        for done in range(rounds or 5 * _WALK_ROUNDS):
            standing = origin + rotation @ body_m
            feet = centres_of(self.model, standing, rotation, toes_m, normals)
            if steps and angles is not None:
                angles, error = descend_legs(self.model.legs, feet, angles, steps=steps)
            else:
                start = self._solver.standing if angles is None else angles
                angles, error = self._solver.solve(feet, near=start)
            before, origin = origin, com_m - np.einsum("kij,kj->ki", rotation, self._shifts(angles))
            settled = np.abs(origin - before).max(axis=1) < _SETTLED_M
            if (
                not rounds
                and done + 1 >= _WALK_ROUNDS
                and (settled | (error > STRAY_M).any(1)).all()
            ):
                break
        assert angles is not None
        return WholeBody(
            rotation=rotation,
            origin_m=origin,
            angles=angles,
            toes_m=toes_m,
            normals=normals,
            stands=stands,
        )

    def _shifts(self, angles: Array) -> Array:
        return np.array([self.kinematics.com_offset(posture) for posture in angles])


def walk_postures(trajectory: Trajectory) -> tuple[WholeBody, Kinematics]:
    """The posture at every sample, found as ``walk_joints`` finds it, and the robot's legs.

    Raises InvalidInput as that does.
    """
    body, normals = MovingBody(trajectory.robot.own_model()), _normals(trajectory)
    return (
        body.postures(
            trajectory.torso_m, trajectory.rotation, trajectory.feet_m, normals, trajectory.contact
        ),
        body.kinematics,
    )


def _normals(trajectory: Trajectory) -> Array:
    toes = trajectory.feet_m
    return np.asarray(
        trajectory.problem.terrain.normal(toes[..., :2].reshape(-1, 2)).reshape(toes.shape)
    )


_JUMP_RAD = 0.5
"""A limb that stands, and one of whose joints would turn so far between two key frames, jumps to
another posture."""


def plan_angles(
    plan: Plan,
    kinematics: Kinematics | None = None,
    start_rad: Array | None = None,
    *,
    deadline: float = math.inf,
) -> tuple[Array, Array, Array]:
    """Angles of every key frame, rotations taken exactly, shape (K, J), and what ``Kinematics.solve``
    tells beside them, shapes (K, N).

    Arguments:
        start_rad: of a robot that stands already, shape (J,): no joint leaves them at the first key
            frame but to put feet where the plan has them, and no limb jumps to another posture
            before it lifts; None: comfortable ones. Where a foot is out of reach, those that bring
            it nearest.

    Raises:
        InvalidInput: without pinocchio, and TimeEnded after the deadline (``time.perf_counter()``).
    """
    course = plan.problem
    solver = kinematics or Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    solids = solids_of(course.terrain)
    answers = list[tuple[Array, Array, Array]]()
    for k in range(course.frames):
        check_time(deadline)
        stands = course.holds[k] == course.holds[0] if start_rad is not None else False
        answer = solver.solve(
            plan.com_m[k],
            plan.rotation_rad[k],
            plan.toes_at(k),
            normals=normals_at(plan, k),
            seed=answers[-1][0] if answers else start_rad,
            obstacles=solids,
            most_rad=np.where(stands, _JUMP_RAD if answers else 0.0, np.inf),
        )
        answers.append(answer)
    angles, error_m, limit_rad = (np.array(each) for each in zip(*answers, strict=True))
    return angles, error_m, limit_rad


def normals_at(plan: Plan, frame: int) -> Array:
    """Normals of the patches under all limbs at a key frame, shape (N, 3)."""
    return np.array(
        [plan.problem.patch(int(p), plan.choice).normal for p in plan.problem.holds[frame]]
    )


TURN_RAD = 0.1
"""Between two moments that are judged no joint turns by much more: half way, joints that turn
evenly put a foot less than L θ² / 8 from its path, a fraction of a millimetre."""


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
    ) -> tuple[PathMoments, WholeBody]:
        """Moments so near to each other, nearer where joints turn by more than ``turn_rad`` in
        between, and the postures there.

        Raises InvalidInput for a path of which there are too many, and TimeEnded after the deadline
        (``time.perf_counter()``).
        """
        with until(deadline):
            counts = self.path.counts(self._apart_m)
        moments = self.path.divided(counts)
        postures = self._postures(moments)
        assert postures.error_m is not None
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

    def postures(self, moments: PathMoments) -> WholeBody:
        """The postures at moments that follow each other."""
        self.judged()  # for the corners
        return self._postures(moments)

    def _turn(self, moments: PathMoments, postures: WholeBody, deadline: float) -> None:
        """Find postures for the corners of swings that limbs do not follow."""
        assert postures.error_m is not None
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

    def _comfortable(self, moments: PathMoments, postures: WholeBody, t: int, limb: int) -> Array:
        """A comfortable posture of a limb at a moment, near to where it is drawn."""
        normals = moments.ups[t]
        angles, _, _ = self._kinematics.solve(
            moments.com_m[t],
            moments.rotation_rad[t],
            moments.feet_m[t] - self.path.radii_m[:, None] * normals,
            normals=normals,
            seed=postures.angles[t],
            obstacles=self.path.solids,
        )
        return np.asarray(angles[self._kinematics.joints_of(limb)])

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

    def _postures(self, moments: PathMoments) -> WholeBody:
        kinematics, angles = self._kinematics, self._drawn(moments)
        rotations = rotations_of(moments.rotation_rad)
        normals, feet = moments.ups, moments.feet_m
        origins, error = np.full_like(moments.com_m, np.inf), np.zeros(feet.shape[:2])
        for _ in range(_ROUNDS):
            shifts, before = np.array([kinematics.com_offset(q) for q in angles]), origins
            origins = moments.com_m - np.einsum("tij,tj->ti", rotations, shifts)
            moved_m = np.abs(origins - before).max(axis=1)
            if moved_m[error.max(axis=1) < STRAY_M].max(initial=0.0) < _SETTLED_M:
                break
            feet = moments.feet_m + _rolled(kinematics, moments, rotations, angles, normals)
            angles, error = descend_legs(
                kinematics.model.legs,
                np.einsum("tij,tni->tnj", rotations, feet - origins[:, None]),
                angles,
                np.einsum("tij,tni->tnj", rotations, normals),
            )
        else:  # feet of a body that does not settle are nowhere
            error = np.maximum(error, STRAY_M / _SETTLED_M * moved_m[:, None])
        return WholeBody(
            rotation=rotations,
            origin_m=origins,
            angles=angles,
            toes_m=moments.feet_m - self.path.radii_m[:, None] * normals,
            normals=normals,
            stands=moments.foothold >= 0,
            error_m=error,
        )


def joints_along(
    plan: Plan, kinematics: Kinematics, *, deadline: float = math.inf
) -> tuple[PathMoments, WholeBody]:
    """The moments of a plan's path that are judged, and the postures there; found once for whoever
    judges or mends the plan.

    Raises as ``JointPath.judged`` does.
    """
    if kinematics.robot is not plan.problem.robot:
        return JointPath(path_of(plan), kinematics).judged(deadline=deadline)
    along: tuple[PathMoments, WholeBody] = vars(plan).get("_joints") or vars(plan).setdefault(
        "_joints", JointPath(path_of(plan), kinematics).judged(deadline=deadline)
    )
    return along


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
        error_m=np.zeros((len(angles), len(robot.limbs))),
    )


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
    moved = kinematics.radii_m[:, None] * cross(small_turns(turned), normals[1:])
    stands, rolled = moments.foothold >= 0, np.zeros_like(normals)
    rolled[1:] = np.where((stands[1:] & stands[:-1])[..., None], moved, 0.0)
    for i in range(len(legs)):
        landed = np.flatnonzero(stands[1:, i] & ~stands[:-1, i]) + 1
        for path in np.split(rolled[:, i], landed):
            np.cumsum(path, axis=0, out=path)
    rolled *= 1.0 - moments.lifted[..., None]
    return rolled


def path_torques(
    plan: Plan, solver: Kinematics, *, deadline: float = math.inf
) -> tuple[Array, Array]:
    """Moments in which the body moves, the first and the last of every step among them, as progress
    in key frames, shape (T,), and torques of all joints there, shape (T, J) [Nm]. Forces, and those
    of soles with their moments, run along the straight line between those of a step's two stances.

    Raises TimeEnded after the deadline (``time.perf_counter()``).
    """
    path, forces_n = path_of(plan), plan.forces_n
    if plan.moments_nm is not None:
        forces_n = np.concatenate([forces_n, plan.moments_nm], axis=2)
    moments, postures = joints_along(plan, solver, deadline=deadline)
    rows = np.flatnonzero((moments.part == 1) | ((moments.part == 0) & (moments.passed == 1.0)))
    torques = list[Array]()
    for t in rows.tolist():
        frames = int(moments.step[t]) - 1, int(moments.step[t])
        before, after = (plan.forces_at(k, path.support(frames[1]), forces_n) for k in frames)
        share = moments.passed[t] if moments.part[t] == 1 else 0.0
        forces = before + share * (after - before)
        torques.append(
            solver.torques(
                postures.angles[t],
                postures.rotation[t],
                forces[:, :3],
                forces[:, 3:] if forces.shape[1] > 3 else None,
            )
        )
    return moments.frame[rows], np.array(torques).reshape(-1, len(solver.joints))
