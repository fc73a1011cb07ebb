"""The motion that ``run`` streams, with its joints: timed by what they can do, the same for a world
and for a film.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TypeVar

import numpy as np

from stancekit.planners.answer.certificate import Crossing
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.motion.gait_motion import CrossingMotion, GaitMotion, feet_motion, plans_of
from stancekit.planners.motion.leap_motion import LeapRun
from stancekit.planners.motion.motion import Motion
from stancekit.planners.motion.plan_motion import PlanMotion, Timing
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.projection.force_distribution import distribute_forces, standing_forces
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.legged import walking_robot

from ..worlds.capabilities import WorldCapabilities
from ..worlds.drives import Drives
from .redundancy import RedundancyResolution, resolved
from .time_parametrization import (
    ACCELERATION_RAD_S2,
    LIMIT_SHARE,
    RATE_HZ,
    TimedMotion,
    check_static,
    joint_profile,
    limit_use,
    parametrize,
    unhurried,
)

log = logging.getLogger(__name__)
M = TypeVar("M", PlanMotion, GaitMotion, LeapRun, CrossingMotion)
JointMotion = (
    TimedMotion[PlanMotion]
    | TimedMotion[GaitMotion]
    | TimedMotion[LeapRun]
    | TimedMotion[CrossingMotion]
)


def streamed(subject: Plan | Trajectory | LeapPlan | Crossing) -> Motion:
    """The motion of a plan, a walk, a leap or a crossing as ``run`` streams it where nothing disturbs it, ``RATE_HZ``
    rows per second.

    Of body and feet alone, on the same path and timed by the same rule, where joints are not known
    or ``run`` would refuse them. The robot's own drives are taken.
    """
    try:
        return joint_motion(subject)
    except InvalidInput as error:
        log.info("the motion is shown without its joints: %s", error)
    return feet_motion(subject)


def joint_motion(
    subject: Plan | Trajectory | LeapPlan | Crossing, rate_hz: float = RATE_HZ
) -> JointMotion:
    """The motion of a plan, a walk, a leap or a crossing with its joints, as ``run`` streams it, so
    many rows per second.

    Raises InvalidInput where joints are not known or ``run`` would refuse them.
    """
    match subject:
        case Plan():
            kinematics = Kinematics(
                subject.problem.robot, gravity_m_s2=subject.problem.gravity_m_s2
            )
            drives, can = _of_file(kinematics)
            motion, wished = unhurried_plan(subject, kinematics, can)
            timed = timed_plan(motion, wished, kinematics, can, drives)
            return _at_rate(timed, kinematics, drives, rate_hz, balanced=False)
        case Trajectory():
            robot = walking_robot(subject.robot)
            kinematics = Kinematics(robot, gravity_m_s2=GRAVITY_M_S2)
            drives, can = _of_file(kinematics)
            walk = GaitMotion(subject, robot.source.foot_radii_m)
            walked = timed_gait(walk, resolved(walk, kinematics), kinematics, can, drives)
            return _at_rate(walked, kinematics, drives, rate_hz, balanced=True)
        case Crossing():
            kinematics = Kinematics(subject.robot, gravity_m_s2=subject.first.gravity_m_s2)
            drives, can = _of_file(kinematics)
            climbs = []
            for plan in plans_of(subject):
                motion, wished = unhurried_plan(plan, kinematics, can)
                climbs.append(timed_plan(motion, wished, kinematics, can, drives).motion)
            return _timed(CrossingMotion(subject, climbs), kinematics, drives, can, rate_hz)
        case LeapPlan():
            if not subject.problem.robot.source.own:
                raise InvalidInput("a leap has body, feet and forces: its robot has limbs alone")
            kinematics = Kinematics(subject.problem.robot, gravity_m_s2=GRAVITY_M_S2)
            drives, can = _of_file(kinematics)
            return _timed(LeapRun(subject), kinematics, drives, can, rate_hz)


L = TypeVar("L", LeapRun, CrossingMotion)


def _timed(
    motion: L, kinematics: Kinematics, drives: Drives, can: WorldCapabilities, rate_hz: float
) -> TimedMotion[L]:
    """A motion that was judged with its joints, and runs at its own pace."""
    profile = joint_profile(motion, kinematics, rate_hz, balanced=True, drives=drives)
    most = _most(kinematics)
    uses = limit_use(profile, can, acceleration_rad_s2=most, share=LIMIT_SHARE, drives=drives)
    velocity, acceleration, torque = (
        uses[name][0] for name in ("velocity", "acceleration", "torque")
    )
    return TimedMotion(
        motion=motion, profile=profile, velocity=velocity, acceleration=acceleration, torque=torque
    )


def _at_rate(
    timed: TimedMotion[M], kinematics: Kinematics, drives: Drives, rate_hz: float, *, balanced: bool
) -> TimedMotion[M]:
    """Convert a motion to this number of rows per second.

    Arguments:
        balanced: as of ``joint_profile``.
    """
    if rate_hz == RATE_HZ:
        return timed
    wished = timed.profile.wished
    profile = joint_profile(
        timed.motion, kinematics, rate_hz, balanced=balanced, drives=drives, wished=wished
    )
    return replace(timed, profile=profile)


def unhurried_plan(
    plan: Plan,
    kinematics: Kinematics,
    can: WorldCapabilities,
    timing: Timing = Timing(),
    *,
    shared: bool = True,
) -> tuple[PlanMotion, RedundancyResolution]:
    """A plan's motion whose phases last as long as joints need, and the postures that joints are
    drawn to.

    Arguments:
        shared: forces are shared anew among the limbs of every stance, with a reserve of friction.

    Raises:
        InvalidInput: where all limbs lift at once.
    """
    forces_n = distribute_forces(plan, kinematics) if shared else None
    standing_n = standing_forces(plan, kinematics) if shared else None
    motion = PlanMotion(plan, timing, forces_n, standing_n=standing_n)
    wished = resolved(motion, kinematics)
    longer = unhurried(motion, wished, can.velocity_rad_s, _most(kinematics))
    motion = PlanMotion(plan, timing, forces_n, longer, standing_n)
    return motion, wished.retimed(motion.knots_s)


def timed_plan(
    motion: PlanMotion,
    wished: RedundancyResolution,
    kinematics: Kinematics,
    can: WorldCapabilities,
    drives: Drives,
    *,
    hung: bool = False,
) -> TimedMotion[PlanMotion]:
    """A plan's motion slowed down to what joints can do.

    Raises InvalidInput as ``parametrize`` does.
    """
    return parametrize(
        motion.plan,
        kinematics,
        can,
        motion.timing,
        forces_n=motion.forces_n,
        hung=hung,
        drives=drives,
        longer=motion.longer,
        standing_n=motion.standing_n,
        wished=wished,
    )


def timed_gait(
    motion: GaitMotion,
    wished: RedundancyResolution,
    kinematics: Kinematics,
    can: WorldCapabilities,
    drives: Drives,
    *,
    hung: bool = False,
) -> TimedMotion[GaitMotion]:
    """A gait's motion as it is planned.

    Raises InvalidInput where joints cannot do it: it cannot be slowed down.

    What a robot's own joints can accelerate follows from their torques; servos are given a limit of
    their own.
    """
    profile = joint_profile(
        motion, kinematics, hung=hung, balanced=True, drives=drives, wished=wished
    )
    check_static(profile, kinematics, can, LIMIT_SHARE, drives)
    most = _most(kinematics)
    uses = limit_use(profile, can, acceleration_rad_s2=most, share=LIMIT_SHARE, drives=drives)
    for name, (use, joint) in uses.items():
        if use > 1.0:
            raise InvalidInput(
                f"gait: joint {can.joints[joint]}: it would take {use:.2g} times the {name} that "
                "it may have; a gait "
                "runs as planned, or not at all: plan one that steps less high or less far"
            )
    velocity, acceleration, torque = (
        uses[name][0] for name in ("velocity", "acceleration", "torque")
    )
    return TimedMotion(
        motion=motion, profile=profile, velocity=velocity, acceleration=acceleration, torque=torque
    )


def _most(kinematics: Kinematics) -> float:
    """The greatest acceleration of joints [rad/s²]."""
    return ACCELERATION_RAD_S2 if kinematics.drawn else np.inf


def _of_file(kinematics: Kinematics) -> tuple[Drives, WorldCapabilities]:
    """The drives of a robot as its file says, and what they can do."""
    drives = Drives.of(kinematics.robot, kinematics.servo, kinematics.model)
    return drives, WorldCapabilities.of_drives(drives, RATE_HZ, senses=False)
