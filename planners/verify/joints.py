"""Judging joints: is every foot at its toe, is every joint within its limits, does any need more
torque than it has?

A plan that comes with angles is judged by them: pinocchio puts the feet where the robot's URDF has
them, while the angles were found over chains of our own (``robot.chain``). For one without, inverse
kinematics finds some here. Torques are those at rest, under the plan's own forces, in every stance.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answer.certificate import NOBODY_CARRIES
from ..answer.plan import Plan
from ..answer.report import LATE, WHOLE_BODY, Group
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..robot.robot_file import Servo
from .bodies import check_bodies

if TYPE_CHECKING:
    from ..robot.kinematics import Kinematics

REACHED_M = 1e-5
"""A foot farther than this from its toe is not there."""
LIMIT_RAD = 1e-6
"""Angles that a plan brings may be so far beyond a limit."""
Place = tuple[int, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class JointReport:
    """Can the joints do what a plan asks for?

    M frames, S stances, N limbs, J joints.

    Arguments:
        angles: shape (M, J) [rad].
        error_m: of every foot from its toe, shape (M, N).
        limit_rad: how far the worst joint of a limb is beyond its limits; of angles found here, how
            far it would have to be, shape (M, N).
        torque_nm: largest joint torque of a limb in a stance, shape (S, N).
        excess_nm: how far one of its joints is over its limit, 0 where within.
        share: largest torque as a share of its joint's limit, of joints whose limit counts.
            worst_…: where the largest is, as (frame, limb's name).
        shift_m: how far the whole robot's centre of mass is from the body's origin, which Lin et
            al. take for it, shape (M,) [m]; nothing is judged by it.
        unlimited: what is wrong with torque limits that count for nothing, a line each: the file
            has none, or one that no such joint has.
    """

    angles: Array
    error_m: Array
    limit_rad: Array
    torque_nm: Array
    excess_nm: Array
    share: float
    shift_m: Array
    worst_error: Place
    worst_limit: Place
    worst_torque: Place
    postures_message: str
    torque_message: str
    unlimited: tuple[str, ...]
    guessed: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Every foot is where it should be, and no joint needs more than it has as far as that is
        known.
        """
        return not self.message

    @property
    def message(self) -> str:
        """Fault in one line; empty where nothing is."""
        return "; ".join(filter(None, (self.postures_message, self.torque_message)))

    @property
    def groups(self) -> tuple[Group, Group]:
        """The groups ``joints`` and ``torque`` of a report."""
        frame, limb = self.worst_error
        joints = Group(
            name="joints",
            value=float(self.error_m.max()),
            limit=REACHED_M,
            unit="m",
            where=limb,
            limb=limb,
            when=frame,
            message=self.postures_message or "; ".join(self.guessed),
            verdict="violated"
            if self.postures_message
            else "not checked"
            if self.guessed
            else "holds",
            figures={
                "error_m": float(self.error_m.max()),
                "limit_rad": float(self.limit_rad.max()),
                "shift_m": float(self.shift_m.max()),
                "worst": {"error": _place(self.worst_error), "limit": _place(self.worst_limit)},
            },
        )
        frame, limb = self.worst_torque
        torque = Group(
            name="torque",
            value=self.share,
            limit=1.0,
            unit="1",
            where=limb,
            limb=limb,
            when=frame,
            message=self.torque_message or "; ".join(self.unlimited),
            verdict="violated"
            if self.torque_message
            else "not checked"
            if self.unlimited
            else "holds",
            figures={
                "torque_nm": float(self.torque_nm.max()),
                "share": self.share,
                "worst": _place(self.worst_torque),
            },
        )
        return joints, torque


def check_whole_body(plan: Plan, *, deadline: float = math.inf) -> tuple[Group, ...]:
    """Check whether the robot can do it: the groups ``joints``, ``torque``, ``bodies`` and
    ``motion``.

    Nothing is checked without pinocchio, or if the robot's legs are not known; bodies are not
    checked without coal. A motion is not required of a course in which all limbs lift at once, so
    that nothing carries the robot between two frames.

    Arguments:
        plan: the plan to judge.
        deadline: time at which to stop, on the clock of ``time.perf_counter()`` [s]; groups that
            are not reached by then are not checked.
    """
    from ..robot.kinematics import Kinematics  # slow to import

    groups = dict[str, Group]()
    if plan.problem.uncarried:
        groups["motion"] = Group(
            "motion", unit="m", message=NOBODY_CARRIES, verdict="not asked for"
        )
    try:
        if time.perf_counter() > deadline:
            raise InvalidInput(LATE)
        solver = Kinematics(plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2)
        report = joint_report(plan, solver=solver)
        groups["joints"], groups["torque"] = report.groups
        groups |= {
            group.name: group
            for group in check_bodies(plan, report.angles, solver, deadline=deadline)
        }
    except InvalidInput as error:
        return tuple(
            groups.get(name, Group(name, message=str(error), verdict="not checked"))
            for name in WHOLE_BODY
        )
    return tuple(groups[name] for name in WHOLE_BODY)


def joint_report(
    plan: Plan,
    servo: Servo | None = None,
    *,
    reached_m: float = REACHED_M,
    solver: Kinematics | None = None,
) -> JointReport:
    """Joints of every key frame, torques of every stance.

    Raises InvalidInput without pinocchio.

    A plan that says within which torque it was made is held to that, where joints have more.

    Arguments:
        servo: drives the joints of drawn-up legs, in place of the robot's own.
        reached_m: a foot farther than this from where it should be is out of reach.
        solver: of the plan's robot, in place of one with this servo.
    """
    from ..robot.kinematics import Kinematics, rotation_of  # slow to import

    course = plan.problem
    solver = solver or Kinematics(course.robot, servo, gravity_m_s2=course.gravity_m_s2)
    angles, error, limit, wrong = _postures(plan, solver, reached_m)
    torque = np.array(
        [
            np.abs(
                solver.torques(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]), forces)
            )
            for of, forces in zip(course.stances, plan.forces_n, strict=True)
        ]
    )
    most = np.minimum(solver.torque_nm, _torque_cap(plan))
    shares, over = torque / most, torque - most
    row, joint = (int(i) for i in np.unravel_index(int(np.argmax(shares)), shares.shape))
    place = course.stances[row].frame, course.robot.limb_names[int(solver.legs[joint])]
    tired = ""
    if over.max() > 0.0:
        tired = (
            f"frame {place[0]}, limb {place[1]}: {torque[row, joint]:.3g} Nm in a joint, "
            f"where {solver.joints[joint]} has {most[joint]:g}"
        )
    frames = list(range(course.frames))
    return JointReport(
        angles=angles,
        error_m=error,
        limit_rad=limit,
        torque_nm=_by_leg(solver, torque),
        excess_nm=np.maximum(_by_leg(solver, over), 0.0),
        share=float(shares.max()),
        shift_m=np.array(
            [np.linalg.norm(solver.com_offset(q) - course.robot.origin_m) for q in angles]
        ),
        worst_error=_where(error, frames, course),
        worst_limit=_where(limit, frames, course),
        worst_torque=place,
        postures_message=wrong,
        torque_message=tired,
        unlimited=solver.model.lines_of(solver.model.torque_doubts),
        guessed=solver.model.limit_doubts,
    )


def _torque_cap(plan: Plan) -> float:
    """Largest torque that the plan allows any joint, whatever it has [Nm]; inf where it says
    nothing.
    """
    limit = plan.provenance.get("torque_nm")
    return float(limit) if isinstance(limit, int | float) and limit > 0.0 else np.inf


def _postures(plan: Plan, solver: Kinematics, reached_m: float) -> tuple[Array, Array, Array, str]:
    """Angles, errors of the feet, what is beyond limits, and what is wrong with them."""
    from ..motion.joints import normals_at, plan_angles
    from ..robot.chain import rotation_of

    course, frames = plan.problem, list(range(plan.problem.frames))
    if plan.joints_rad is None:
        answers = plan_angles(plan, solver)
        angles = np.array([answer.angles for answer in answers])
        error, limit = (
            np.array([a.error_m for a in answers]),
            np.array([a.limit_rad for a in answers]),
        )
    else:
        angles = plan.joints_rad
        feet = [
            solver.targets(
                plan.com_m[k],
                rotation_of(plan.rotation_rad[k]),
                plan.toes_at(k),
                normals_at(plan, k),
            )
            for k in frames
        ]
        error = np.array([np.linalg.norm(solver.feet(angles[k]) - feet[k], axis=1) for k in frames])
        limit = _by_leg(solver, solver.beyond(angles))
    wrong = list[str]()
    (far, limb), (bent, owner) = _where(error, frames, course), _where(limit, frames, course)
    if not error.max() <= reached_m:
        away = f"{1e3 * error.max():.3g} mm away from its toe"
        message = (
            f"its foot stays {away} within the joints' limits"
            if plan.joints_rad is None
            else f"its foot is {away}"
        )
        wrong.append(f"frame {far}, limb {limb}: {message}")
    if plan.joints_rad is not None and not limit.max() <= LIMIT_RAD:
        wrong.append(
            f"frame {bent}, limb {owner}: a joint is {limit.max():.3g} rad beyond its limit"
        )
    return angles, error, limit, "; ".join(wrong)


def _by_leg(solver: Kinematics, values: Array) -> Array:
    """The largest number of a limb's joints, shape (K, J) to (K, N)."""
    return np.array(
        [[row[solver.joints_of(i)].max() for i in range(len(solver.robot.limbs))] for row in values]
    )


def _where(table: Array, frames: Sequence[int], course: Problem) -> Place:
    row, limb = np.unravel_index(int(np.argmax(table)), table.shape)
    return frames[int(row)], course.robot.limb_names[int(limb)]


def _place(at: Place) -> dict[str, Any]:
    return {"frame": at[0], "limb": at[1]}
