"""Time parametrisation: how slow a motion must be for joints with limits of velocity, acceleration
and torque.

Every phase of a plan's motion scales with the pace: at pace p velocities are p times, accelerations
and the torques that they take p² times those at pace 1, and torques at rest are the same. So the
pace is known after one profile of the motion, which is inverse kinematics of the whole plan; a
second profile checks it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from stancekit.planners.answer.motion import Motion
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import (
    crossing_motion,
    feet_motion,
    gait_motion,
)
from stancekit.planners.motion.joints import STRAY_M
from stancekit.planners.motion.leap_motion import leap_motion
from stancekit.planners.motion.motion import Played, Samples, between, stacked
from stancekit.planners.motion.plan_motion import KNOTS, Timing, plan_motion
from stancekit.planners.projection.force_distribution import distribute_forces, standing_forces
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.robot.leg import ActuatorModel, continued

from ..acceptance import JointNeeds
from ..control.foot_placement import ContactFeedback
from ..control.tracker import Tracker
from ..worlds.world import Drives, Ground, Solids, Terrain
from .redundancy import RedundancyResolution, resolved

_SAMPLED_S = 0.02
"""Torques at rest are taken so often, between the knots along straight lines."""
_CLEARLY = 1.05
"""Postures at knots are not quite those that are tracked: only what is over a limit by so much is
refused by them."""


def check_at_rest(
    source: str,
    motion: Played,
    kinematics: Kinematics,
    wished: RedundancyResolution,
    drives: Drives,
    share: float,
) -> None:
    """Raise InvalidInput where torques at rest, at a motion's knots, tell that named actuators
    cannot do it: that is known in a tenth of the time that the whole motion takes.
    """
    if drives.assigned is None:
        return
    samples = [motion.at(float(time_s)) for time_s in motion.knots_s]
    torques = np.array(
        [
            kinematics.torques(
                angles, rotation_of(sample.rotation_rad), sample.forces_n, sample.moments_nm
            )
            for angles, sample in zip(wished.path_rad, samples, strict=True)
        ]
    )
    times = np.arange(0.0, motion.duration_s, _SAMPLED_S)
    even = np.stack([np.interp(times, motion.knots_s, joint) for joint in torques.T], axis=1)
    check_actuators(source, drives, even, _SAMPLED_S, share, _CLEARLY)


def check_actuators(
    source: str,
    drives: Drives,
    torques_nm: Array,
    period_s: float,
    share: float,
    clearly: float = 1.0,
) -> None:
    """Raise InvalidInput where named actuators lack torque, or get hotter than they bear.

    Arguments:
        torques_nm: shape (T, J), so long apart.
        share: of the stall torque that may be used.
        clearly: how many times a limit is to be exceeded.
    """
    if drives.assigned is None:
        return
    needs = JointNeeds.of(drives.joints, drives.actuators, torques_nm, period_s)
    used = np.fmax(needs.share_of_stall / share, np.sqrt(needs.heat))
    worst = int(np.argmax(used))
    if used[worst] <= clearly:
        return
    names = drives.assigned.names(drives.joints)
    alike = [joint for joint, name in enumerate(names) if name == names[worst]]
    fits = [
        name
        for name, model in drives.assigned.known.items()
        if _bears(model, torques_nm[:, alike], period_s, share)
    ]
    would = f"at rest {' or '.join(fits)} would do" if fits else "no known actuator would do"
    raise InvalidInput(
        f"{source}: expected actuators that bear it: joint {needs.joints[worst]} needs "
        f"{needs.said(worst)}, {names[worst]} has {_said(drives.actuators[worst], share)}; {would}"
    )


def _bears(model: ActuatorModel, torques_nm: Array, period_s: float, share: float) -> bool:
    """Tell whether an actuator can give these torques, shape (T, J), at J joints."""
    count = torques_nm.shape[1]
    needs = JointNeeds.of([""] * count, [model] * count, torques_nm, period_s)
    return bool(np.all(needs.share_of_stall <= share) and not np.any(needs.heat > 1.0))


def _said(model: ActuatorModel, share: float) -> str:
    """Words for what an actuator can give, for a moment and for ever."""
    long = "" if model.continuous_nm is None else f" and {model.continuous_nm:.3g} Nm for ever"
    return f"{share:g} of {model.stall_nm:.3g} Nm for a moment{long}"


_SLACK_M = 0.006
"""So deep a foot may be in a surface on the path: what it stands on, and what it is off by, is no
collision."""
_TOUCHING_M, _RISES = 0.001, 40
"""A foot that is no deeper in the terrain touches it; and how often a robot is put higher."""
LEVEL = 0.5
"""Upward part of the normal of a surface that a robot is put higher for; none is lifted out of a wall."""
_SAMPLES = 40
_STILL_RAD = 1e-4
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
    if longest <= _STILL_RAD:
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
    if depth <= _SLACK_M:
        return [first_rad]
    above = kinematics.feet(first_rad) + clearance_m * normals @ pose[1]
    off, _ = kinematics.reach(above, first_rad, first_rad, normals @ pose[1])
    around, _ = _deepest(kinematics, solids, pose, [measured_rad, off, first_rad])
    if around <= _SLACK_M:
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
    for _ in range(_RISES if solids else 0):
        feet = feet_m + np.array([0.0, 0.0, rise])
        deepest = max(float((radii_m - solid.distance(feet)).max()) for solid in solids)
        if deepest <= _TOUCHING_M:
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
        for s in np.linspace(0.0, 1.0, _SAMPLES):
            feet = position + kinematics.feet(start + s * (goal - start)) @ rotation.T
            for solid in solids:
                worst = np.maximum(worst, kinematics.radii_m - solid.distance(feet))
    index = int(np.argmax(worst))
    return float(worst[index]), kinematics.robot.limb_names[index]


ACCELERATION_RAD_S2 = 120.0
LIMIT_SHARE = 0.9
"""Share of the limits of velocity and torque that may be used."""
RATE_HZ = 100.0
"""Rate at which the motion is sampled."""
_LEAST_PACE = 0.1
"""Phases last as long as their joints need (``unhurried``): what still wants a tenth of the pace
jumps."""
_ROUNDS = 4
LINEAR = ("velocity", "torque at speed")
"""Uses of limits that fall with the pace, or faster; the others do with its square."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointProfile:
    """A motion as the joints have it, T times, J joints: what is streamed where nothing disturbs it.

    Arguments:
        motion: the motion.
        time_s: shape (T,).
        angles_rad, velocity_rad_s, acceleration_rad_s2, static_nm, dynamic_nm: shape (T, J);
            static_nm are torques at rest under the planned forces, dynamic_nm what accelerations,
            damping and friction add.
        error_m: of inverse kinematics, shape (T, N).
        rows: samples, with the body's origin, that a tracker follows where all goes as planned.
        wished: what it is drawn to.
    """

    motion: Played
    time_s: Array
    angles_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    static_nm: Array
    dynamic_nm: Array
    error_m: Array
    rows: Samples
    wished: RedundancyResolution

    def played(self) -> Played:
        """The rows at their times, and straight lines between them; the ends are held."""
        step_s = float(self.time_s[1])
        turned = continued(self.rows.rotation_rad)
        rows = replace(
            self.rows,
            rotation_rad=turned,
            velocity_m_s=np.gradient(self.rows.com_m, step_s, axis=0),
            rotation_rate_rad_s=np.gradient(turned, step_s, axis=0),
            rates_rad_s=self.velocity_rad_s,
            torques_nm=self.static_nm + self.dynamic_nm,
        )

        def at(times_s: float | Array) -> Samples:
            return between(rows, np.asarray(times_s, dtype=np.float64) / step_s)

        return replace(self.motion, at=at, knots_s=self.time_s)


def unhurried(
    motion: Played,
    wished: RedundancyResolution,
    velocity_rad_s: Array,
    acceleration_rad_s2: float = ACCELERATION_RAD_S2,
    share: float = LIMIT_SHARE,
) -> Array:
    """Factors by which phases of a plan's motion are to last longer, or joints would be sent faster
    than they turn, shape (P,), 1 or more.

    A phase begins and ends at rest, so that each can have a time of its own.

    Arguments:
        velocity_rad_s: limits, shape (J,).
    """
    path, seconds = wished.path_rad, motion.seconds
    assert seconds is not None
    rates = (np.diff(path, axis=0) / np.repeat(seconds / KNOTS, KNOTS)[:, None]).reshape(
        len(seconds), KNOTS, -1
    )
    rising = np.diff(rates, axis=1) / (seconds / KNOTS)[:, None, None]
    fast = (np.abs(rates) / (share * velocity_rad_s)).max(axis=(1, 2))
    hard = np.abs(rising).max(axis=(1, 2)) / acceleration_rad_s2
    return np.asarray(np.maximum(1.0, np.maximum(fast, np.sqrt(hard))))


def parametrize(
    motion: Played,
    kinematics: Kinematics,
    can: Drives,
    *,
    acceleration_rad_s2: float = ACCELERATION_RAD_S2,
    share: float = LIMIT_SHARE,
    hung: bool = False,
    drives: Drives | None = None,
    wished: RedundancyResolution | None = None,
) -> JointProfile:
    """A plan's motion, slowed down until all limits hold.

    Arguments:
        share: of the limits of velocity and torque that may be used.
        hung: the robot hangs in a stand, its feet carry nothing.
        drives: whose torques fall with speed, where they do.
        wished: postures of this motion at any pace, where they are known.

    Raises:
        InvalidInput: with time, limb and joint, where a foot is out of reach, or a torque at rest
            too large: no pace helps there.
    """
    pace, slowed = 1.0, motion
    for _ in range(_ROUNDS):
        wished = resolved(slowed, kinematics) if wished is None else wished.retimed(slowed.knots_s)
        profile = joint_profile(slowed, kinematics, hung=hung, drives=drives, wished=wished)
        _check_static(profile, kinematics, can, share, drives)
        uses = _limit_use(
            profile, can, acceleration_rad_s2=acceleration_rad_s2, share=share, drives=drives
        )
        slower = min(
            (1.0 / use if name in LINEAR else use**-0.5)
            for name, (use, _) in uses.items()
            if use > 0.0
        )
        if slower >= 1.0 - 1e-6:
            return profile
        name = max(uses, key=lambda n: uses[n][0] if n in LINEAR else uses[n][0] ** 0.5)
        pace *= 0.995 * slower
        bound_by = f"{name} of {can.joints[uses[name][1]]}"
        assert motion.seconds is not None
        assert motion.lasting is not None
        slowed = replace(
            motion.lasting(motion.seconds / pace), pace=motion.pace * pace, bound_by=bound_by
        )
        if pace < _LEAST_PACE:
            break
    raise InvalidInput(
        f"pace: expected limits that some pace keeps, got none down to {pace:.3g}, bound by "
        f"{slowed.bound_by}"
    )


def joint_profile(
    motion: Played,
    kinematics: Kinematics,
    rate_hz: float = RATE_HZ,
    *,
    hung: bool = False,
    balanced: bool = False,
    drives: Drives | None = None,
    wished: RedundancyResolution | None = None,
) -> JointProfile:
    """Inverse kinematics along a whole motion, and what it takes.

    Arguments:
        balanced: the motion's forces are those that push the body as it moves, as a gait's are, and
            not those at rest.
        drives: whose rotors are turned; the robot's own where none are given.
        wished: postures at the motion's knots, where they are known.
    """
    wished, period_s = wished or resolved(motion, kinematics), 1.0 / rate_hz
    rows, error = undisturbed(motion, kinematics, rate_hz, wished, STEADY if balanced else BLIND)
    angles = rows.angles_rad
    assert angles is not None
    assert rows.torques_nm is not None
    velocity = np.gradient(angles, period_s, axis=0)
    acceleration, body = np.zeros_like(angles), np.zeros((len(angles), 3))
    acceleration[1:-1] = (angles[2:] - 2.0 * angles[1:-1] + angles[:-2]) / period_s**2
    if not (hung or balanced):
        body[1:-1] = (rows.com_m[2:] - 2.0 * rows.com_m[1:-1] + rows.com_m[:-2]) / period_s**2
    rotors = kinematics.rotor_kg_m2 if drives is None else drives.rotor_kg_m2
    moved = zip(angles, velocity, acceleration, rows.rows(), body, strict=True)
    dynamic = np.array([moving_nm(kinematics, rotors, *row) for row in moved])
    static = rows.torques_nm
    if hung:
        nothing = np.zeros_like(rows.forces_n[0])
        static = np.array([kinematics.torques(q, np.eye(3), nothing) for q in angles])
    return JointProfile(
        motion=motion,
        time_s=np.arange(len(angles), dtype=float) * np.float64(period_s),
        angles_rad=angles,
        velocity_rad_s=velocity,
        acceleration_rad_s2=acceleration,
        static_nm=static,
        dynamic_nm=dynamic + kinematics.resistance(velocity),
        error_m=error,
        rows=rows,
        wished=wished,
    )


BLIND = ContactFeedback(press_hz=0.0, memory_s=0.0)
"""For feet that feel nothing: what is expected is taken for felt."""
STEADY = replace(BLIND, waits=False)
"""The same of a gait, which waits for nothing."""


def undisturbed(
    motion: Played,
    kinematics: Kinematics,
    rate_hz: float = RATE_HZ,
    wished: RedundancyResolution | None = None,
    feedback: ContactFeedback = BLIND,
) -> tuple[Samples, Array]:
    """Samples, with the body's origin, joints and torques at rest, that the tracker follows over a
    whole motion if all feet feel the planned forces; and errors of inverse kinematics, shape (T, N).
    """
    tracker = Tracker(motion, kinematics, rate_hz, feedback, wished=wished)
    row: dict[str, Any] | None = tracker.begin()
    kept: dict[str, list[Any]] = {
        name: [] for name in ("sample", "origin_m", "angles_rad", "torques_nm", "error_m")
    }
    while row is not None:
        for name, values in kept.items():
            values.append(row[name])
        row = tracker.step(expected(tracker.coming))
    samples, error = kept.pop("sample"), np.array(kept.pop("error_m"))
    known = {name: np.array(values) for name, values in kept.items()}
    return replace(stacked(samples), **known), error


def expected(sample: Samples) -> Array:
    """Forces that feet feel when all goes as planned, shape (N, 3) [N]: all touch, however little
    they carry; of those in the air the tracker takes no notice.
    """
    return np.asarray(sample.forces_n + 2.0 * BLIND.touch_n * sample.normals)


def moving_nm(
    kinematics: Kinematics,
    rotors_kg_m2: float | Array,
    angles: Array,
    velocity: Array,
    acceleration: Array,
    sample: Samples,
    push: Array,
) -> Array:
    """Torques that accelerations take, shape (J,) [Nm]: of the limbs' own masses and rotors, and of
    the body that feet push.

    Arguments:
        push: acceleration of the centre of mass, shape (3,) [m/s²], shared by feet that stand.
    """
    own_nm = kinematics.inertial_torques(angles, velocity, acceleration)
    own_nm = own_nm + rotors_kg_m2 * acceleration
    stands, force_n = sample.stands, kinematics.robot.mass_kg * push
    shared = np.where(stands[:, None], force_n / max(1, int(stands.sum())), 0.0)
    loads = kinematics.loads(angles, rotation_of(sample.rotation_rad))
    with_push, without = (
        kinematics.torques_of(loads, forces) for forces in (shared, np.zeros_like(shared))
    )
    return np.asarray(own_nm + with_push - without)


def _limit_use(
    profile: JointProfile,
    can: Drives,
    *,
    acceleration_rad_s2: float = ACCELERATION_RAD_S2,
    share: float = LIMIT_SHARE,
    drives: Drives | None = None,
) -> dict[str, tuple[float, int]]:
    """The greatest use of every limit, with the joint; that of torque is of what torques at rest
    leave.

    "torque at speed" is of joints whose torque falls with it and that turn with their torque: |τ| /
    τ_0 + |q̇| / ω_0 is to be no more than 1, and at a pace p no more than the torque at rest and p
    times the rest are.
    """
    room = share * can.torque_nm - np.abs(profile.static_nm)
    tables = {
        "velocity": np.abs(profile.velocity_rad_s) / (share * can.velocity_rad_s),
        "acceleration": np.abs(profile.acceleration_rad_s2) / acceleration_rad_s2,
        "torque": np.abs(profile.dynamic_nm) / room,
    }
    if drives is not None and drives.fading.any():
        rest, most = np.abs(profile.static_nm), share * can.torque_nm
        motoring = (profile.static_nm + profile.dynamic_nm) * profile.velocity_rad_s > 0.0
        moving = np.abs(profile.dynamic_nm) / most + drives.fading * np.abs(profile.velocity_rad_s)
        tables["torque at speed"] = np.where(
            motoring & (drives.fading > 0.0), moving / (1.0 - rest / most), 0.0
        )
    return {
        name: (float(table.max()), int(np.unravel_index(int(np.argmax(table)), table.shape)[1]))
        for name, table in tables.items()
    }


def _check_static(
    profile: JointProfile,
    kinematics: Kinematics,
    can: Drives,
    share: float,
    drives: Drives | None = None,
) -> None:
    """Raise InvalidInput for what no pace helps with."""
    row, limb = np.unravel_index(int(np.argmax(profile.error_m)), profile.error_m.shape)
    if profile.error_m[row, limb] > STRAY_M:
        raise InvalidInput(
            f"motion: {profile.time_s[row]:.2f} s, limb {kinematics.robot.limb_names[int(limb)]}: "
            "its foot stays "
            f"{1e3 * profile.error_m[row, limb]:.2g} mm from where it should be"
        )
    if drives is not None:
        check_actuators("motion", drives, profile.static_nm, float(profile.time_s[1]), share)
    over = np.abs(profile.static_nm) - share * can.torque_nm
    row, joint = np.unravel_index(int(np.argmax(over)), over.shape)
    if over[row, joint] >= 0.0:
        raise InvalidInput(
            f"motion: {profile.time_s[row]:.2f} s, joint {can.joints[int(joint)]}: "
            f"{abs(profile.static_nm[row, joint]):.3g} Nm at rest, "
            f"expected less than {share:g} of its {can.torque_nm[joint]:.3g} Nm"
        )
    beyond = np.maximum(can.lower_rad - profile.angles_rad, profile.angles_rad - can.upper_rad)
    row, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    if beyond[row, joint] > 1e-6:
        raise InvalidInput(
            f"motion: {profile.time_s[row]:.2f} s, joint {can.joints[int(joint)]}: "
            f"{beyond[row, joint]:.3g} rad "
            "beyond its limit"
        )


log = logging.getLogger(__name__)


def streamed(subject: Motion[Any]) -> Played:
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


def joint_motion(subject: Motion[Any], rate_hz: float = RATE_HZ) -> Played:
    """The motion of a plan, a walk, a leap or a crossing with its joints, as ``run`` streams it, so
    many rows per second.

    Raises InvalidInput where joints are not known or ``run`` would refuse them.
    """
    if subject.has("timing") and not subject.robot.own:
        raise InvalidInput("a leap has body, feet and forces: its robot has limbs alone")
    walks, robot = subject.has("times_s"), subject.legged
    kinematics = Kinematics(robot, gravity_m_s2=subject.gravity_m_s2)
    drives = Drives.of(kinematics.model)

    def timed(plan: Plan) -> JointProfile:
        """A plan at the pace that its joints allow."""
        motion, wished = unhurried_plan(plan, kinematics, drives)
        return parametrize(motion, kinematics, drives, drives=drives, wished=wished)

    if subject.keyed:
        profile = timed(subject)
    elif walks:
        motion = gait_motion(subject, robot.foot_radii_m)
        profile = timed_gait(motion, resolved(motion, kinematics), kinematics, drives, drives)
    else:
        motion = (
            crossing_motion(subject, [timed(plan).motion for plan in subject.climbs])
            if subject.has("parts")
            else leap_motion(subject)
        )
        return joint_profile(motion, kinematics, rate_hz, balanced=True, drives=drives).played()
    if rate_hz != RATE_HZ:
        profile = joint_profile(
            profile.motion,
            kinematics,
            rate_hz,
            balanced=walks,
            drives=drives,
            wished=profile.wished,
        )
    return profile.played()


def unhurried_plan(
    plan: Plan,
    kinematics: Kinematics,
    can: Drives,
    timing: Timing = Timing(),
    *,
    shared: bool = True,
) -> tuple[Played, RedundancyResolution]:
    """A plan's motion whose phases last as long as joints need, and the postures that joints are
    drawn to.

    Arguments:
        shared: forces are shared anew among the limbs of every stance, with a reserve of friction;
            those of soles stay as planned, at a pace that their support bears.

    Raises:
        InvalidInput: where all limbs lift at once.
    """
    pace = _steady_pace(plan, timing) if kinematics.soles else 1.0
    shared, timing = shared and not kinematics.soles, timing.at_pace(pace)
    forces_n = distribute_forces(plan, kinematics) if shared else None
    standing_n = standing_forces(plan, kinematics) if shared else None
    motion = plan_motion(plan, timing, forces_n, standing_n=standing_n)
    wished = resolved(motion, kinematics)
    longer = unhurried(motion, wished, can.velocity_rad_s, _most(kinematics))
    assert motion.seconds is not None
    assert motion.lasting is not None
    bound_by = "the support of its soles" if pace < 1.0 else ""
    motion = replace(motion.lasting(motion.seconds * longer), pace=pace, bound_by=bound_by)
    return motion, wished.retimed(motion.knots_s)


_PEAK = 10.0 / math.sqrt(3.0)
"""Greatest acceleration of a smooth way from rest to rest, of its length over its squared time."""
_SUPPORT, _PASSED = 0.8, 0.1
"""Share of the least support, and of a way, that the weight of a body which speeds up may leave the
place under it by: it has gone on so far when it speeds up most."""


def _steady_pace(plan: Plan, timing: Timing) -> float:
    """Pace at which the weight of the body, c − h/g c̈ on the ground, stays on the soles: 1 where that
    of the timing does.
    """
    from stancekit.planners.verify.margins import stance_margins  # of soles alone

    model = plan.problem.robot.own_model()
    support_m = float(stance_margins(plan, ("support_m",))["support_m"].min())
    ways = np.linalg.norm(np.diff(plan.com_m[:, :2], axis=0), axis=1)
    seconds = np.maximum(timing.swing_s, ways / timing.body_m_s)
    room = np.maximum(_SUPPORT * support_m + _PASSED * ways, _LEAST_ROOM_M)
    needed = np.sqrt(_PEAK * model.stand_height_m / plan.problem.gravity_m_s2 * ways / room)
    return float(min(1.0, (seconds / np.maximum(needed, 1e-9)).min(initial=1.0)))


_LEAST_ROOM_M = 1e-3
"""Support is counted as this much at least, or a motion would take for ever [m]."""


def timed_gait(
    motion: Played,
    wished: RedundancyResolution,
    kinematics: Kinematics,
    can: Drives,
    drives: Drives,
    *,
    hung: bool = False,
) -> JointProfile:
    """A gait's motion as it is planned.

    Raises InvalidInput where joints cannot do it: it cannot be slowed down.

    What a robot's own joints can accelerate follows from their torques; servos are given a limit of
    their own.
    """
    profile = joint_profile(
        motion, kinematics, hung=hung, balanced=True, drives=drives, wished=wished
    )
    _check_static(profile, kinematics, can, LIMIT_SHARE, drives)
    most = _most(kinematics)
    uses = _limit_use(profile, can, acceleration_rad_s2=most, share=LIMIT_SHARE, drives=drives)
    for name, (use, joint) in uses.items():
        if use > 1.0:
            raise InvalidInput(
                f"gait: joint {can.joints[joint]}: it would take {use:.2g} times the {name} that "
                "it may have; a gait "
                "runs as planned, or not at all: plan one that steps less high or less far"
            )
    return profile


def _most(kinematics: Kinematics) -> float:
    """The greatest acceleration of joints [rad/s²]."""
    return ACCELERATION_RAD_S2 if kinematics.drawn else np.inf
