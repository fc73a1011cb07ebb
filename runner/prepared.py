"""Motions that are ready to go on a world: checked, timed, and with a tracker that has not
begun.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from stancekit.planners.answer.certificate import Crossing
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import CrossingMotion, GaitMotion, plans_of
from stancekit.planners.motion.leap_motion import LeapRun
from stancekit.planners.motion.motion import Played
from stancekit.planners.motion.path import LIFT_M, touch_downs_m
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.robot.kinematics import Kinematics

from .acceptance import Accepted, check_fits, check_joints, check_stands
from .control.tracker import Target, Tracker
from .execution import Execution
from .log import Record
from .motion.bodies import motion_bodies
from .motion.redundancy import LoadTransfer, MeanForces, RedundancyResolution, resolved
from .motion.time_parametrization import (
    BLIND,
    LIMIT_SHARE,
    RATE_HZ,
    STEADY,
    JointProfile,
    TimedMotion,
    check_actuators,
    check_at_rest,
    expected,
    timed_gait,
    timed_plan,
    unhurried_plan,
)
from .safety.guard import SafeWorld
from .settings import RunSettings
from .worlds.drives import Drives
from .worlds.world import Ground, Solids, State, Terrain

LOG = logging.getLogger(__name__)
PlannedMotion = PlanMotion | GaitMotion | LeapRun | CrossingMotion
BodyFrom = Literal["the world", "leg odometry", "nothing"]
_WALKING: dict[str, Any] = {"seek_m_s": 0.3, "seek_m": 0.03, "waits": False}
"""A foot of a gait that is late is looked for at once, and not waited for: its body moves on."""
_LEAPING: dict[str, Any] = {**_WALKING, "settle_hz": 5.0}
"""So is one that lands, which slides as it does; where it came to rest it stands."""
M_co = TypeVar("M_co", bound=Played, covariant=True)
P_co = TypeVar("P_co", bound=PlannedMotion, covariant=True)
P = TypeVar("P", bound=PlannedMotion)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked(Generic[M_co]):
    """A motion with a tracker that has not begun.

    Arguments:
        first: the target before the first period.
        sees: feet are felt.
    """

    motion: M_co
    tracker: Tracker
    first: Target
    sees: bool

    def next(self, felt: Array, state: State | None = None) -> Target | None:
        """The target of the next period, None at the end.

        Arguments:
            felt: by the feet just now, (N, 3) [N].
            state: the world's, from its last period on.
        """
        return self.tracker.next(felt if self.sees else expected(self.tracker.coming), state)

    @staticmethod
    def lean(target: Target) -> Array:
        """Part of a target that is load, that of feedback, too, shape (J,) [rad]: joints are to be
        at the rest.
        """
        return np.asarray(target.targets_rad - target.angles_rad)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared(Tracked[P_co]):
    """A plan, or a gait, that a run begins with.

    Arguments:
        accepted: the motion as it was accepted.
        terrain: what it was made for.
        surfaces: what feet stay out of.
        pace: of that asked for, 1 where it was slow enough.
        bound_by: what slowed it down.
        clearance_m: how far feet are lifted where the path to the first pose is not clear.
        touch_downs_m: how far beyond its place the ground of each foothold may be, 0 of what is
            exact, shape (P,).
    """

    accepted: Accepted[Any]
    kinematics: Kinematics
    terrain: Terrain
    surfaces: Solids
    clearance_m: float
    pace: float = 1.0
    bound_by: str = ""
    touch_downs_m: Array | None = None

    def entry(self, world: SafeWorld) -> dict[str, Any]:
        """Entry of a log before the run."""
        limbs = {leg.name: list(leg.joint_names) for leg in self.kinematics.model.legs}
        return {
            "digest": self.accepted.digest,
            "course": self.accepted.name,
            "source": self.accepted.source,
            "joints": list(world.joints),
            "limbs": limbs,
            "rate_hz": world.rate_hz,
            "world": world.name,
            "dry": world.dry,
            "pace": self.pace,
            "bound_by": self.bound_by,
            "seconds": self.motion.duration_s,
            "sees": self.sees,
            "frames": self.motion.last_frame + 1,
            **self.motion.entry(),
            **world.drives.entry(),
        }

    def execution(
        self, world: SafeWorld, record: Record, settings: RunSettings, wall_s: float
    ) -> Execution:
        """Compare the measurements with the plan."""
        return Execution.of(
            record,
            self.kinematics,
            world,
            goal_m=self.motion.goal_m,
            stances=self.motion.stances,
            tolerance=settings.tolerance,
            wall_s=wall_s,
            touch_downs_m=self.touch_downs_m if self.sees else None,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Resumption:
    """Handover of a robot that stands already to another plan: from the posture of its kinematics,
    from what its feet carry, shape (N, 3) [N], and no faster than at this pace.
    """

    kinematics: Kinematics
    carried_n: Array
    pace: float = 1.0


def prepare(
    accepted: Accepted[Any],
    world: SafeWorld,
    settings: RunSettings,
    resumption: Resumption | None = None,
) -> Prepared[Any]:
    """A motion for a world that it fits, with its tracker.

    A plan is timed and slowed down to what joints can do, and so are the climbs of a crossing. A
    gait and a leap run as planned, or not at all.

    Arguments:
        resumption: how a robot that stands already takes up a plan.

    Raises:
        InvalidInput: where it does not fit, and for settings that it has no use for, before anything
            moves.
    """
    _check_settings(settings, world)
    match accepted.plan:
        case Plan():
            return _of_plan(accepted, world, settings, resumption)
        case Trajectory():
            return _of_gait(accepted, world, settings)
        case _:
            return _of_leaps(accepted, world, settings)


def _of_plan(
    accepted: Accepted[Plan],
    world: SafeWorld,
    settings: RunSettings,
    resumption: Resumption | None,
) -> Prepared[PlanMotion]:
    plan, sees = accepted.plan, _sees_feet(world, settings)
    if settings.check_limits:
        if resumption is None and not settings.hung:
            check_stands(accepted, settings.least_push)
        check_fits(accepted, world)
    else:
        check_joints(accepted.source, plan.problem.robot, world, plan.problem.gravity_m_s2)
    course = plan.problem
    if resumption is None:
        kinematics = Kinematics(course.robot, world.servo, gravity_m_s2=course.gravity_m_s2)
    else:
        kinematics, settings = (
            resumption.kinematics,
            replace(settings, timing=settings.timing.at_pace(resumption.pace)),
        )
    motion, wished = unhurried_plan(
        plan, kinematics, world.capabilities, settings.timing, shared=settings.forces == "shared"
    )
    pace = steady = motion.timing.foot_m_s / settings.timing.foot_m_s
    bound_by = "the support of its soles" if pace < 1.0 else ""
    if settings.check_limits:
        if not settings.hung:
            check_at_rest(accepted.source, motion, kinematics, wished, world.drives, LIMIT_SHARE)
        timed = timed_plan(
            motion, wished, kinematics, world.capabilities, world.drives, hung=settings.hung
        )
        motion, pace, bound_by, wished = (
            timed.motion,
            steady * timed.pace,
            timed.bound_by or bound_by,
            timed.profile.wished,
        )
        _check_heat(accepted.source, timed.profile, world.drives)
        _check_bodies(accepted, timed, kinematics)
    followed: Played = LoadTransfer(motion) if settings.hung else motion
    if resumption is not None and not settings.hung:
        followed = LoadTransfer(motion, resumption.carried_n, motion.rest_s)
    tracker = Tracker(
        followed,
        kinematics,
        world.rate_hz,
        settings.feedback if sees else BLIND,
        settings.body,
        wished,
        world.drives,
        touch_downs_m(plan),
    )
    first = tracker.start()
    if resumption is not None:
        tracker.take_over(world.last_rad - first.targets_rad, motion.rest_s)
    return Prepared(
        accepted=accepted,
        motion=motion,
        kinematics=kinematics,
        tracker=tracker,
        first=first,
        sees=sees,
        pace=pace,
        bound_by=bound_by,
        clearance_m=motion.path.lift_m,
        terrain=course.terrain,
        surfaces=motion.solids,
        touch_downs_m=touch_downs_m(plan),
    )


def _of_gait(
    accepted: Accepted[Trajectory], world: SafeWorld, settings: RunSettings
) -> Prepared[GaitMotion]:
    if settings.odometry:
        raise InvalidInput(
            "odometry: expected a plan, got a gait: two standing feet do not determine the body's "
            "rotation"
        )
    trajectory, kinematics = accepted.plan, _kinematics(accepted, world)
    motion = GaitMotion(trajectory, accepted.robot.source.foot_radii_m)
    wished = (
        _check_gait(motion, kinematics, world, hung=settings.hung)
        if settings.check_limits
        else None
    )
    fall_s = float(
        np.sqrt(kinematics.model.stand_height_m / accepted.gravity_m_s2)
    )  # of an inverted pendulum
    stepping = replace(settings.body, step_s=fall_s) if settings.body.acts else settings.body
    ground = Ground(heights=trajectory.terrain, friction=trajectory.friction)
    return _paced(
        accepted,
        world,
        replace(settings, body=stepping),
        kinematics,
        motion,
        LoadTransfer(motion) if settings.hung else motion,
        wished,
        ground,
        (ground,),
    )


def _of_leaps(
    accepted: Accepted[Any], world: SafeWorld, settings: RunSettings
) -> Prepared[LeapRun | CrossingMotion]:
    _check_leaps(settings, world)
    kinematics, subject = _kinematics(accepted, world), accepted.plan
    ground = accepted.plan.ground()
    if isinstance(subject, LeapPlan):
        assert isinstance(ground, tuple)
        motion: LeapRun | CrossingMotion = LeapRun(subject)
        surfaces: Solids = tuple(patch.solid for patch in ground)
    else:
        motion = CrossingMotion(subject, _climbs(accepted, world, settings, kinematics))
        surfaces = motion.solids
    followed = MeanForces(motion, 1.0 / world.rate_hz)
    return _paced(accepted, world, settings, kinematics, motion, followed, None, ground, surfaces)


def _climbs(
    accepted: Accepted[Crossing], world: SafeWorld, settings: RunSettings, kinematics: Kinematics
) -> list[PlanMotion]:
    """The climbs of a crossing, timed as any plan's."""
    climbs = list[PlanMotion]()
    for plan in plans_of(accepted.plan):
        motion, wished = unhurried_plan(
            plan,
            kinematics,
            world.capabilities,
            settings.timing,
            shared=settings.forces == "shared",
        )
        if settings.check_limits:
            check_at_rest(accepted.source, motion, kinematics, wished, world.drives, LIMIT_SHARE)
            motion = timed_plan(motion, wished, kinematics, world.capabilities, world.drives).motion
        climbs.append(motion)
    return climbs


def _kinematics(accepted: Accepted[Any], world: SafeWorld) -> Kinematics:
    """Kinematics of the robot, whose joints the world has."""
    check_joints(accepted.source, accepted.robot, world, accepted.gravity_m_s2)
    return Kinematics(accepted.robot, world.servo, gravity_m_s2=accepted.gravity_m_s2)


def _paced(
    accepted: Accepted[Any],
    world: SafeWorld,
    settings: RunSettings,
    kinematics: Kinematics,
    motion: P,
    followed: Played,
    wished: RedundancyResolution | None,
    terrain: Terrain,
    surfaces: Solids,
) -> Prepared[P]:
    """A motion that runs at its own pace.

    Arguments:
        followed: the motion as the tracker follows it.
    """
    sees, feet = (
        _sees_feet(world, settings),
        _WALKING if isinstance(motion, GaitMotion) else _LEAPING,
    )
    tracker = Tracker(
        followed,
        kinematics,
        world.rate_hz,
        replace(settings.feedback, **feet) if sees else STEADY,
        settings.body,
        wished,
        world.drives,
    )
    return Prepared(
        accepted=accepted,
        motion=motion,
        kinematics=kinematics,
        tracker=tracker,
        first=tracker.start(),
        sees=sees,
        clearance_m=LIFT_M * kinematics.model.size,
        terrain=terrain,
        surfaces=surfaces,
    )


def _check_leaps(settings: RunSettings, world: SafeWorld) -> None:
    """Raise InvalidInput for a world and settings without leaps."""
    for wrong, message in (
        (settings.odometry, "odometry: expected a plan, got a leap: nothing stands in the air"),
        (settings.hung, "hung: expected a plan or a gait, got a leap"),
        (
            world.real and not world.dry,
            "world: expected a simulation for a leap, whose stop in the air lands first, got "
            f"{world.name}",
        ),
    ):
        if wrong:
            raise InvalidInput(message)


def _sees_feet(world: SafeWorld, settings: RunSettings) -> bool:
    """Tell whether what feet feel comes back, and is used."""
    return world.capabilities.has_contact_forces and not world.dry and not settings.blind


def body_from(world: SafeWorld, settings: RunSettings) -> BodyFrom:
    """Source of the body's pose; without one, only the joints are followed."""
    if world.dry:
        return "nothing"
    if settings.odometry:
        return "leg odometry"
    return "the world" if world.capabilities.has_body_pose and not settings.blind else "nothing"


def _check_settings(settings: RunSettings, world: SafeWorld) -> None:
    """Raise InvalidInput for a robot that hangs where none can, and for limits that only a
    simulation may break.
    """
    if settings.hung and not world.real:
        raise InvalidInput(
            f"hung: expected a robot that can hang in a stand, world {world.name} has none"
        )
    if not settings.check_limits and (world.real or world.kind != "simulation"):
        raise InvalidInput(
            f"check_limits: expected True but in a simulation, got False in world {world.name}"
        )


def _check_bodies(
    accepted: Accepted[Plan], timed: TimedMotion[PlanMotion], kinematics: Kinematics
) -> None:
    """Raise InvalidInput where a link goes through another one or the terrain on the way; log what
    has no shape.
    """
    report = motion_bodies(accepted.plan, timed.profile.targets, kinematics)
    if report.message:
        raise InvalidInput(
            f"{accepted.source}: expected a motion in which no bodies collide: {report.message}"
        )
    if report.missing:
        LOG.warning(
            "%s: bodies not checked along the motion: %s",
            accepted.source,
            "; ".join(report.missing),
        )


def _check_gait(
    motion: GaitMotion, kinematics: Kinematics, world: SafeWorld, *, hung: bool
) -> RedundancyResolution:
    """Raise InvalidInput where joints cannot do it: a gait cannot be slowed down.

    Returns what its tracker wishes.
    """
    wished = resolved(motion, kinematics)
    if not hung:
        check_at_rest("gait", motion, kinematics, wished, world.drives, LIMIT_SHARE)
    profile = timed_gait(
        motion, wished, kinematics, world.capabilities, world.drives, hung=hung
    ).profile
    _check_heat("gait", profile, world.drives)
    return profile.wished


def _check_heat(source: str, profile: JointProfile, drives: Drives) -> None:
    """Raise InvalidInput for a motion that makes an actuator hotter than it bears, as far as that
    is known.
    """
    check_actuators(
        source, drives, profile.static_nm + profile.dynamic_nm, 1.0 / RATE_HZ, share=1.0
    )
