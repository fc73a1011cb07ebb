"""Motions that are ready to go on a world: checked, timed, and with a tracker that has not
begun.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import crossing_motion, gait_motion
from stancekit.planners.motion.leap_motion import leap_motion
from stancekit.planners.motion.motion import Played
from stancekit.planners.motion.path import LIFT_M, path_of
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.verify.geometry import tipping

from .acceptance import Accepted, check_fits, check_joints
from .control.tracker import Target, Tracker
from .motion.redundancy import (
    RedundancyResolution,
    load_transfer,
    mean_forces,
    motion_bodies,
    resolved,
)
from .motion.time_parametrization import (
    BLIND,
    LIMIT_SHARE,
    RATE_HZ,
    STEADY,
    JointProfile,
    check_actuators,
    check_at_rest,
    expected,
    parametrize,
    timed_gait,
    unhurried_plan,
)
from .safety.guard import SafeWorld
from .settings import RunSettings
from .worlds.world import Drives, Ground, Solids, State, Terrain

LOG = logging.getLogger(__name__)
BodyFrom = Literal["the world", "leg odometry", "nothing"]
_WALKING: dict[str, Any] = {"seek_m_s": 0.3, "seek_m": 0.03, "waits": False}
"""A foot of a gait that is late is looked for at once, and not waited for: its body moves on."""
_LEAPING: dict[str, Any] = {**_WALKING, "settle_hz": 5.0}
"""So is one that lands, which slides as it does; where it came to rest it stands."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """A motion with a tracker that has not begun.

    Arguments:
        first: the target before the first period.
        sees: feet are felt.
    """

    motion: Played
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
class Prepared(Tracked):
    """A plan, or a gait, that a run begins with.

    Arguments:
        accepted: the motion as it was accepted.
        terrain: what it was made for.
        surfaces: what feet stay out of.
        clearance_m: how far feet are lifted where the path to the first pose is not clear.
        touch_downs_m: how far beyond its place the ground of each foothold may be, 0 of what is
            exact, shape (P,).
    """

    accepted: Accepted[Any]
    kinematics: Kinematics
    terrain: Terrain
    surfaces: Solids
    clearance_m: float
    touch_downs_m: Array | None = None

    @property
    def counted(self) -> str:
        """What its progress counts."""
        return "key frames" if self.accepted.plan.keyed else "seconds"

    @property
    def last_frame(self) -> float:
        """Progress at its end."""
        plan = self.accepted.plan
        return plan.problem.frames - 1 if plan.keyed else self.motion.duration_s

    @property
    def ends_m(self) -> tuple[Array, Array]:
        """Places at which the centre of mass begins and ends, shape (3,) each [m]."""
        return self.motion.at(0.0).com_m, self.motion.at(self.motion.duration_s).com_m

    def entry(self, world: SafeWorld) -> dict[str, Any]:
        """Entry of a log before the run."""
        limbs = {leg.name: list(leg.joint_names) for leg in self.kinematics.model.legs}
        plan, (start_m, goal_m) = self.accepted.plan, self.ends_m
        path: dict[str, Any] = {"start_m": start_m, "goal_m": goal_m}
        if plan.keyed:
            path = {"com_m": plan.com_m, "toes_m": plan.toes_m, "holds": plan.problem.holds}
        return {
            "digest": self.accepted.digest,
            "course": self.accepted.name,
            "source": self.accepted.source,
            "joints": list(world.joints),
            "limbs": limbs,
            "rate_hz": world.rate_hz,
            "world": world.name,
            "dry": world.dry,
            "pace": self.motion.pace,
            "bound_by": self.motion.bound_by,
            "seconds": self.motion.duration_s,
            "sees": self.sees,
            "frames": self.last_frame + 1,
            **path,
            "torque_nm": world.drives.torque_nm,
        }


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
) -> Prepared:
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
    if accepted.plan.keyed:
        return _of_plan(accepted, world, settings, resumption)
    prepared = _of_gait if accepted.plan.has("times_s") else _of_leaps
    return prepared(accepted, world, settings)


def _of_plan(
    accepted: Accepted[Plan],
    world: SafeWorld,
    settings: RunSettings,
    resumption: Resumption | None,
) -> Prepared:
    plan, sees = accepted.plan, _sees_feet(world, settings)
    if settings.check_limits:
        stands = resumption is not None or settings.hung
        if not stands and (tips := tipping(plan, settings.least_push)):
            raise InvalidInput(f"{accepted.source}: {tips}; least_push 0 runs it all the same")
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
    motion, wished, profile = _timed(accepted.source, plan, kinematics, world, settings)
    if profile is not None:
        _check_heat(accepted.source, profile, world.drives)
        _check_bodies(accepted, profile, kinematics)
    assert motion.rest_s is not None
    followed = load_transfer(motion) if settings.hung else motion
    if resumption is not None and not settings.hung:
        followed = load_transfer(motion, resumption.carried_n, motion.rest_s)
    tracker = Tracker(
        followed,
        kinematics,
        world.rate_hz,
        settings.feedback if sees else BLIND,
        settings.body,
        wished,
        world.drives,
        path_of(plan).touch_downs_m,
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
        clearance_m=path_of(plan).lift_m,
        terrain=course.terrain,
        surfaces=motion.solids,
        touch_downs_m=path_of(plan).touch_downs_m,
    )


def _of_gait(accepted: Accepted[Trajectory], world: SafeWorld, settings: RunSettings) -> Prepared:
    if settings.odometry:
        raise InvalidInput(
            "odometry: expected a plan, got a gait: two standing feet do not determine the body's "
            "rotation"
        )
    trajectory, kinematics = accepted.plan, _kinematics(accepted, world)
    motion = gait_motion(trajectory, accepted.robot.foot_radii_m)
    wished = (
        _check_gait(motion, kinematics, world, hung=settings.hung)
        if settings.check_limits
        else None
    )
    fall_s = float(
        np.sqrt(kinematics.model.stand_height_m / accepted.gravity_m_s2)
    )  # of an inverted pendulum
    stepping = replace(settings.body, step_s=fall_s) if settings.body.acts else settings.body
    ground = Ground(heights=trajectory.problem.terrain, friction=trajectory.problem.friction)
    return _paced(
        accepted,
        world,
        replace(settings, body=stepping),
        kinematics,
        motion,
        load_transfer(motion) if settings.hung else motion,
        wished,
        ground,
        (ground,),
        _WALKING,
    )


def _of_leaps(accepted: Accepted[Any], world: SafeWorld, settings: RunSettings) -> Prepared:
    _check_leaps(settings, world)
    kinematics, subject = _kinematics(accepted, world), accepted.plan
    ground = accepted.plan.ground()
    if subject.has("timing"):
        assert isinstance(ground, tuple)
        motion = leap_motion(subject)
        surfaces: Solids = tuple(patch.solid for patch in ground)
    else:
        climbs = [
            _timed(accepted.source, plan, kinematics, world, settings)[0] for plan in subject.climbs
        ]  # as any plan's
        motion = crossing_motion(subject, climbs)
        surfaces = motion.solids
    followed = mean_forces(motion, 1.0 / world.rate_hz)
    return _paced(
        accepted, world, settings, kinematics, motion, followed, None, ground, surfaces, _LEAPING
    )


def _timed(
    source: str, plan: Plan, kinematics: Kinematics, world: SafeWorld, settings: RunSettings
) -> tuple[Played, RedundancyResolution | None, JointProfile | None]:
    """The motion of a plan, as fast as joints can do it, what its tracker wishes, and the profile of
    its joints; of limits that are not checked None.

    Raises InvalidInput where no pace helps.
    """
    can, drives, shared = world.capabilities, world.drives, settings.forces == "shared"
    motion, wished = unhurried_plan(plan, kinematics, can, settings.timing, shared=shared)
    if not settings.check_limits:
        return motion, wished, None
    if not settings.hung:
        check_at_rest(source, motion, kinematics, wished, drives, LIMIT_SHARE)
    profile = parametrize(motion, kinematics, can, hung=settings.hung, drives=drives, wished=wished)
    return profile.motion, profile.wished, profile


def _kinematics(accepted: Accepted[Any], world: SafeWorld) -> Kinematics:
    """Kinematics of the robot, whose joints the world has."""
    check_joints(accepted.source, accepted.robot, world, accepted.gravity_m_s2)
    return Kinematics(accepted.robot, world.servo, gravity_m_s2=accepted.gravity_m_s2)


def _paced(
    accepted: Accepted[Any],
    world: SafeWorld,
    settings: RunSettings,
    kinematics: Kinematics,
    motion: Played,
    followed: Played,
    wished: RedundancyResolution | None,
    terrain: Terrain,
    surfaces: Solids,
    feet: Mapping[str, Any],
) -> Prepared:
    """A motion that runs at its own pace.

    Arguments:
        followed: the motion as the tracker follows it.
        feet: what is other than in ``settings.feedback``.
    """
    sees = _sees_feet(world, settings)
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
    return world.senses and not world.dry and not settings.blind


def body_from(world: SafeWorld, settings: RunSettings) -> BodyFrom:
    """Source of the body's pose; without one, only the joints are followed."""
    if world.dry:
        return "nothing"
    if settings.odometry:
        return "leg odometry"
    return "the world" if world.senses and not settings.blind else "nothing"


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


def _check_bodies(accepted: Accepted[Plan], profile: JointProfile, kinematics: Kinematics) -> None:
    """Raise InvalidInput where a link goes through another one or the terrain on the way; log what
    has no shape.
    """
    group = motion_bodies(accepted.plan, profile.rows, kinematics)
    if group.verdict == "violated":
        raise InvalidInput(
            f"{accepted.source}: expected a motion in which no bodies collide: {group.message}"
        )
    if group.verdict == "not checked":
        LOG.warning("%s: bodies not checked along the motion: %s", accepted.source, group.message)


def _check_gait(
    motion: Played, kinematics: Kinematics, world: SafeWorld, *, hung: bool
) -> RedundancyResolution:
    """Raise InvalidInput where joints cannot do it: a gait cannot be slowed down.

    Returns what its tracker wishes.
    """
    wished = resolved(motion, kinematics)
    if not hung:
        check_at_rest("gait", motion, kinematics, wished, world.drives, LIMIT_SHARE)
    profile = timed_gait(motion, wished, kinematics, world.capabilities, world.drives, hung=hung)
    _check_heat("gait", profile, world.drives)
    return profile.wished


def _check_heat(source: str, profile: JointProfile, drives: Drives) -> None:
    """Raise InvalidInput for a motion that makes an actuator hotter than it bears, as far as that
    is known.
    """
    check_actuators(
        source, drives, profile.static_nm + profile.dynamic_nm, 1.0 / RATE_HZ, share=1.0
    )
