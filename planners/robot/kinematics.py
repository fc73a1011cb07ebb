"""Inverse kinematics and joint torques of the robot's limbs (extra ``kin``: pinocchio on the URDF of ``robot.urdf``).

Feet are found by damped least squares from closed-form seeds, all limbs at once, inside the joint limits; the free
joint of a limb is drawn towards a comfortable posture. Torques are those of a robot that stands still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..answer.plan import Plan
from ..files.arrays import Array, frozen
from ..problem.course import Course
from ..problem.posture import GRAVITY_M_S2
from ..terrain.prism import Solid
from .leg_ik import limb_postures
from .model import Robot
from .rotation import rotation_of
from .urdf import FOOT_RADIUS_M, JOINTS, Servo, foot_names, hexapod_urdf, joint_names
from .urdf_reader import pinocchio

__all__ = ["JointAnswer", "JointReport", "Kinematics", "joint_report", "pinocchio", "plan_angles", "rotation_of"]

EXACT_M = 1e-7
"""A foot this close to its target is there."""
REACHED_M = 1e-5
"""A foot farther from its target than this is out of reach."""
DAMPING = 1e-4
STEPS = 60
LONGEST_STEP_RAD = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class JointAnswer:
    """Joint angles for one posture; J joints, N limbs.

    angles: shape (J,) [rad], within the limits. error_m: distance of every foot from its target, shape (N,) [m].
    limit_rad: how far beyond its limits the worst joint of a limb would have to go to get there, shape (N,) [rad].
    torques_nm: joint torques that hold the robot still under the given forces, shape (J,) [Nm]; zeros without forces.
    """

    angles: Array
    error_m: Array
    limit_rad: Array
    torques_nm: Array

    @property
    def within_limits(self) -> bool:
        """Every foot is where it should be, with no joint beyond its limits."""
        return bool(np.all(self.error_m <= REACHED_M))


class Kinematics:
    """The robot's limbs as pinocchio knows them, the body fixed. Not for use by several threads at once.

    Raises InvalidInput where pinocchio is not installed.
    """

    def __init__(self, robot: Robot, servo: Servo = Servo(), *, gravity_m_s2: float = GRAVITY_M_S2) -> None:
        self._pin = pinocchio()
        self.robot, self.servo, self.gravity_m_s2 = robot, servo, gravity_m_s2
        self.joints = joint_names(robot)
        self._model = self._pin.buildModelFromXML(hexapod_urdf(robot, servo))
        self._data = self._model.createData()
        self._feet = [self._model.getFrameId(name) for name in foot_names(robot)]
        self._lower = np.tile(np.array(servo.lower_rad), len(robot.limbs))
        self._upper = np.tile(np.array(servo.upper_rad), len(robot.limbs))
        self._shoulders = np.array([limb.shoulder_m for limb in robot.limbs])
        limb_mass = float(self._pin.computeTotalMass(self._model))
        self._limb_share = limb_mass / robot.mass_kg

    def solve(
        self,
        com_m: ArrayLike,
        rotation_rad: ArrayLike,
        toes_m: ArrayLike,
        *,
        normals: ArrayLike | None = None,
        forces_n: ArrayLike | None = None,
        seed: ArrayLike | None = None,
        obstacles: Sequence[Solid] = (),
    ) -> JointAnswer:
        """Angles for a body pose and toes in the world.

        com_m: the body's origin, shape (3,) [m]. rotation_rad: rotation vector, taken exactly, not linearised, shape
        (3,). toes_m: where the limbs touch, shape (N, 3) [m]. normals: of the surfaces, shape (N, 3); the foot's centre
        is a radius away along them. Without normals the foot's centre goes to the toe. forces_n: on the robot, world
        frame, shape (N, 3) [N]. seed: angles to stay close to, shape (J,). obstacles: what the links should keep off.
        """
        count = len(self.robot.limbs)
        turn = rotation_of(rotation_rad)
        toes = frozen(toes_m, (count, 3), "toes_m")
        out = np.zeros((count, 3)) if normals is None else frozen(normals, (count, 3), "normals")
        com = frozen(com_m, (3,), "com_m")
        feet = (toes + FOOT_RADIUS_M * out - com) @ turn
        near = None if seed is None else frozen(seed, (len(self.joints),), "seed").reshape(count, -1)
        wished = limb_postures(
            self.robot, self.servo, feet, -out @ turn, near=near, pose=(com, turn), obstacles=obstacles
        )
        angles, error = self.reach(feet, wished, wished)
        excess = np.zeros(count)
        if np.any(error > REACHED_M):
            beyond, missed = self.reach(feet, wished, wished, limits=False)
            over = np.maximum(beyond - self._upper, self._lower - beyond).reshape(count, -1).max(axis=1)
            excess = np.where(missed <= REACHED_M, np.maximum(over, 0.0), 0.0)
        torques = np.zeros(len(self.joints))
        if forces_n is not None:
            torques = self.torques(angles, turn, frozen(forces_n, (count, 3), "forces_n"))
        return JointAnswer(angles=angles, error_m=error, limit_rad=excess, torques_nm=torques)

    def reach(self, feet: Array, start: Array, wished: Array, *, limits: bool = True) -> tuple[Array, Array]:
        """Damped least squares from ``start``, drawn towards ``wished`` where that moves no foot; a limb that ends no
        closer than it started stays as it was.

        feet: centres in the body frame, shape (N, 3) [m]. Returns angles, shape (J,), and errors, shape (N,) [m].
        """
        pull, angles = 0.5, np.array(start)
        for _ in range(STEPS):
            now, jacobian = self._feet_and_jacobian(angles)
            gap = feet - now
            if np.max(np.abs(gap)) < EXACT_M:
                break
            damped = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING * np.eye(3) * np.max(np.abs(gap))
            inverse = jacobian.transpose(0, 2, 1) @ np.linalg.inv(damped)
            drawn = pull * (wished - angles).reshape(len(feet), -1, 1)
            pull *= 0.7
            step = (inverse @ (gap[:, :, None] - jacobian @ drawn) + drawn).ravel()
            angles = angles + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD)
            if limits:
                angles = np.clip(angles, self._lower, self._upper)
        error, before = (np.linalg.norm(feet - self.feet(q), axis=1) for q in (angles, start))
        better = error <= np.maximum(before, EXACT_M)
        return np.where(np.repeat(better, len(JOINTS)), angles, start), np.where(better, error, before)

    def feet(self, angles: Array) -> Array:
        """Centres of the feet in the body frame, shape (N, 3) [m]."""
        self._pin.framesForwardKinematics(self._model, self._data, angles)
        return np.array([self._data.oMf[frame].translation for frame in self._feet])

    def chains(self, angles: Array) -> Array:
        """Shoulder, roll joint, knee and foot of every limb in the body frame, shape (N, 4, 3) [m].

        The roll joint is drawn a fifth along the thigh.
        """
        feet, count = self.feet(angles), len(JOINTS)
        knees = np.array([self._data.oMi[count * (i + 1)].translation for i in range(len(feet))])
        return np.stack([self._shoulders, 0.8 * self._shoulders + 0.2 * knees, knees, feet], axis=1)

    def foot_frames(self, angles: Array) -> Array:
        """Orientations of the feet in the body frame, shape (N, 3, 3)."""
        self._pin.framesForwardKinematics(self._model, self._data, angles)
        return np.array([self._data.oMf[frame].rotation for frame in self._feet])

    def com_offset(self, angles: Array) -> Array:
        """The whole robot's centre of mass in the body frame, shape (3,) [m]: paper E takes it for zero."""
        return np.asarray(self._limb_share * self._pin.centerOfMass(self._model, self._data, angles))

    def torques(self, angles: Array, rotation: Array, forces_n: Array) -> Array:
        """τ = g(q) − Σ Jᵢᵀ fᵢ: what the joints give so that the robot stands still, shape (J,) [Nm].

        rotation: R_WB, shape (3, 3); forces_n: on the feet, world frame, shape (N, 3) [N].
        """
        self._model.gravity.linear = rotation.T @ np.array([0.0, 0.0, -self.gravity_m_s2])
        weight = np.array(self._pin.computeGeneralizedGravity(self._model, self._data, angles))
        _, jacobian = self._feet_and_jacobian(angles)
        return np.asarray(weight - (jacobian.transpose(0, 2, 1) @ (forces_n @ rotation)[:, :, None]).ravel())

    def _feet_and_jacobian(self, angles: Array) -> tuple[Array, Array]:
        """Centres of the feet, shape (N, 3), and their derivatives in their own limb's joints, shape (N, 3, 4)."""
        pin, joints = self._pin, len(JOINTS)
        pin.computeJointJacobians(self._model, self._data, angles)
        pin.updateFramePlacements(self._model, self._data)
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        found = np.empty((len(self._feet), 3, joints))
        for i, foot in enumerate(self._feet):
            whole = pin.getFrameJacobian(self._model, self._data, foot, frame)
            found[i] = whole[:3, joints * i : joints * (i + 1)]
        return np.array([self._data.oMf[foot].translation for foot in self._feet]), found


@dataclass(frozen=True, kw_only=True, eq=False)
class JointReport:
    """Can the joints do what a plan asks for? M frames, S stances, N limbs.

    angles: shape (M, J) [rad]. error_m, limit_rad: as in ``JointAnswer``, shape (M, N). torque_nm: largest joint torque
    of a limb in a stance, shape (S, N); excess_nm: that less the servo's limit, 0 where within. accepted: all within.
    worst_…: where the largest is, as (frame, limb's name). shift_m: how far the whole robot's centre of mass is from
    the body's origin, which paper E takes for it, shape (M,) [m]; nothing is judged by it.
    """

    accepted: bool
    angles: Array
    error_m: Array
    limit_rad: Array
    torque_nm: Array
    excess_nm: Array
    shift_m: Array
    worst_error: tuple[int, str]
    worst_limit: tuple[int, str]
    worst_torque: tuple[int, str]
    message: str


def plan_angles(plan: Plan, kinematics: Kinematics | None = None) -> list[JointAnswer]:
    """Angles of every key frame, each near those of the frame before. Raises InvalidInput without pinocchio.

    The torques are those of the mean force of the frame's stances.
    """
    course = plan.course
    solver = kinematics or Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    solids = [Solid.behind(patch) for patch in course.terrain]
    found = list[JointAnswer]()
    for k in range(course.frames):
        normals = [course.patch(int(p), plan.choice).normal for p in course.holds[k]]
        answer = solver.solve(
            plan.com_m[k], plan.rotation_rad[k], plan.toes_at(k), normals=normals, forces_n=plan.forces_at(k),
            seed=found[-1].angles if found else None, obstacles=solids,
        )  # fmt: skip
        found.append(answer)
    return found


def joint_report(plan: Plan, servo: Servo = Servo(), *, reached_m: float = REACHED_M) -> JointReport:
    """Inverse kinematics of every key frame, torques of every stance. Raises InvalidInput without pinocchio.

    reached_m: a foot farther than this from where it should be is out of reach.
    """
    course = plan.course
    solver = Kinematics(course.robot, servo, gravity_m_s2=course.gravity_m_s2)
    answers = plan_angles(plan, solver)
    torque = np.array(
        [
            np.abs(solver.torques(answers[of.frame].angles, rotation_of(plan.rotation_rad[of.frame]), forces))
            for of, forces in zip(course.stances, plan.forces_n, strict=True)
        ]
    )
    torque = torque.reshape(len(torque), len(course.robot.limbs), -1).max(axis=2)
    error, limit = np.array([a.error_m for a in answers]), np.array([a.limit_rad for a in answers])
    excess = np.maximum(torque - servo.torque_nm, 0.0)
    frames = list(range(course.frames))
    far, pressed = _where(error, frames, course), _where(torque, [of.frame for of in course.stances], course)
    wrong = []
    if error.max() > reached_m:
        wrong.append(
            f"frame {far[0]}, limb {far[1]}: its foot stays {1e3 * error.max():.3g} mm away from its toe within the "
            f"joints' limits"
        )
    if excess.max() > 0.0:
        wrong.append(
            f"frame {pressed[0]}, limb {pressed[1]}: {torque.max():.3g} Nm in a joint, "
            f"where servos have {servo.torque_nm:g}"
        )
    return JointReport(
        accepted=not wrong,
        angles=np.array([a.angles for a in answers]),
        error_m=error,
        limit_rad=limit,
        torque_nm=torque,
        excess_nm=excess,
        shift_m=np.array([np.linalg.norm(solver.com_offset(a.angles)) for a in answers]),
        worst_error=far,
        worst_limit=_where(limit, frames, course),
        worst_torque=pressed,
        message="; ".join(wrong),
    )


def _where(table: Array, frames: list[int], course: Course) -> tuple[int, str]:
    row, limb = np.unravel_index(int(np.argmax(table)), table.shape)
    return frames[int(row)], course.robot.limb_names[int(limb)]
