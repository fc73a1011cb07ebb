"""Time parametrisation against closed forms and limits, and the soft start's way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from stancekit import Motion
from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.joints import JointPath, path_torques, plan_angles
from stancekit.planners.motion.motion import Samples
from stancekit.planners.motion.path import APART_M
from stancekit.planners.motion.plan_motion import KNOTS, Timing, moments_at, plan_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import distribute_forces
from stancekit.planners.projection.whole_body import WholeBodyLimits, whole_body, with_joints
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.bodies import TOUCH_M
from stancekit.planners.robot.kinematics import Kinematics, pinocchio, rotation_of
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.robot_file import Servo, drawn_urdf
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.tracker import (
    PAUSE_S,
    RAMP_S,
    SPEED_SHARE,
    SwingSpeed,
    Tracker,
)
from stancekit.runner.motion.redundancy import (
    JUMP_RAD,
    LEFT,
    TURNED,
    RedundancyResolution,
    _cheapest,
    postures,
    resolved,
    spaced,
)
from stancekit.runner.motion.time_parametrization import (
    ACCELERATION_RAD_S2,
    BLIND,
    LIMIT_SHARE,
    PEAK,
    RATE_HZ,
    STEADY,
    JointProfile,
    expected,
    joint_profile,
    moving_nm,
    parametrize,
    soft_motion,
    soft_start,
    undisturbed,
    unhurried,
)
from stancekit.runner.run import Runner
from stancekit.runner.worlds.world import Drives
from tests.emulators.memory_world import MemoryWorld
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

CAN = MemoryWorld().capabilities


@pytest.fixture(scope="module")
def plan(step: Callable[[str], Motion]) -> Motion:
    return step("walls")


@pytest.fixture(scope="module")
def kinematics(plan: Motion) -> Kinematics:
    return Kinematics(plan.problem.robot)


@pytest.fixture(scope="module")
def seen(plan: Motion, kinematics: Kinematics) -> JointProfile:
    return joint_profile(plan_motion(plan), kinematics)


def with_limits(**limits: float) -> Drives:
    return replace(CAN, **{name: np.full(24, value) for name, value in limits.items()})  # type: ignore[arg-type]


def test_the_look_is_along_the_whole_motion_and_reaches_every_foot(
    plan: Motion, seen: JointProfile
) -> None:
    assert seen.time_s[-1] == pytest.approx(plan_motion(plan).duration_s, abs=0.011)
    assert seen.error_m.max() < 1e-5


def test_feet_of_the_angles_are_where_the_motion_has_them(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion = plan_motion(plan)
    for row in range(0, len(seen.time_s), 40):
        sample = motion.at(seen.time_s[row])
        angles = seen.angles_rad[row]
        rotation = rotation_of(sample.rotation_rad)
        origin = sample.com_m - rotation @ kinematics.com_offset(angles)
        feet = origin + kinematics.feet(angles) @ rotation.T
        # feet roll on their surfaces by up to their radius times a limb's turn, and the offset is
        # of the last period
        assert np.linalg.norm(feet - sample.feet_m, axis=1).max() < 0.015


def test_velocities_scale_with_the_pace_and_accelerations_and_torques_with_its_square(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    slow = joint_profile(plan_motion(plan, Timing().at_pace(0.5)), kinematics)
    for name, factor in (
        ("velocity_rad_s", 0.5),
        ("acceleration_rad_s2", 0.25),
        ("dynamic_nm", 0.25),
    ):
        fast_peak, slow_peak = (
            np.percentile(np.abs(getattr(each, name)), 99.5) for each in (seen, slow)
        )
        assert slow_peak == pytest.approx(factor * fast_peak, rel=0.06), name
    assert np.abs(slow.static_nm).max() == pytest.approx(np.abs(seen.static_nm).max(), rel=1e-2)


def test_accelerating_torques_are_those_of_newton_and_euler(
    seen: JointProfile, plan: Motion, kinematics: Kinematics
) -> None:
    """Power: what the joints' torques do while nobody stands is the change of kinetic energy, and
    of a rotor alone.
    """
    sample, pin = plan_motion(plan).at(0.0), pinocchio()
    model = pin.buildModelFromXML(drawn_urdf(plan.problem.robot))  # the body stays where it is
    data = model.createData()
    air = replace(sample, foothold=np.full(6, -1))
    rng = np.random.default_rng(0)
    angles, velocity, acceleration = (rng.uniform(-1.0, 1.0, 24) for _ in range(3))
    step = 1e-5

    def energy(t: float) -> float:
        q, v = angles + velocity * t + 0.5 * acceleration * t * t, velocity + acceleration * t
        rotors = 0.5 * kinematics.servo.rotor_kg_m2 * float(v @ v)
        return float(pin.computeKineticEnergy(model, data, q, v)) + rotors

    torques = moving_nm(
        kinematics, kinematics.rotor_kg_m2, angles, velocity, acceleration, air, np.zeros(3)
    )
    assert torques @ velocity == pytest.approx(
        (energy(step) - energy(-step)) / (2.0 * step), rel=1e-5
    )


def test_the_rotors_of_a_urdfs_joints_are_those_that_its_world_turns_and_its_verifier_counts(
    plan: Motion,
) -> None:
    """Not the servos': those are of a hexapod, and heavy or light for others."""
    model = model_of(quadruped(effort=60.0))
    kinematics = Kinematics(robot_of(model))
    drives = Drives.of(model)
    length_m = np.mean([leg.chain.length_m for leg in model.legs])
    np.testing.assert_allclose(kinematics.rotor_kg_m2, 2e-4 * 9.81 * model.mass_kg * length_m)
    np.testing.assert_array_equal(drives.rotor_kg_m2, kinematics.rotor_kg_m2)
    still, angles = np.zeros(len(drives.joints)), np.full(len(drives.joints), 0.3)
    rising = np.linspace(-50.0, 50.0, len(still))
    air = replace(plan_motion(plan).at(0.0), foothold=np.full(4, -1))
    torques, bare = (
        moving_nm(kinematics, rotors, angles, still, rising, air, np.zeros(3))
        for rotors in (drives.rotor_kg_m2, 0.0 * drives.rotor_kg_m2)
    )
    np.testing.assert_allclose(torques - bare, drives.rotor_kg_m2 * rising, atol=1e-12)


def test_a_body_that_accelerates_takes_torques_of_its_mass_times_that(
    plan: Motion, kinematics: Kinematics
) -> None:

    sample, still = plan_motion(plan).at(0.0), np.zeros(24)
    angles = np.tile([0.1, 0.4, 0.0, 1.0], 6)
    push = np.array([0.3, -0.2, 0.5])
    torques = moving_nm(kinematics, kinematics.rotor_kg_m2, angles, still, still, sample, push)
    step, rate = 1e-6, np.random.default_rng(1).normal(size=24)
    rotation = rotation_of(sample.rotation_rad)
    moved = (kinematics.feet(angles + step * rate) - kinematics.feet(angles - step * rate)) / (
        2.0 * step
    )
    # virtual work: torques on joints and the feet's forces, which are m a / 6 each, balance
    assert torques @ rate == pytest.approx(
        -float((moved @ rotation.T @ (10.0 * push / 6.0)).sum()), rel=1e-5
    )


def test_a_motion_within_all_limits_keeps_its_pace(plan: Motion, kinematics: Kinematics) -> None:
    found = parametrize(plan_motion(plan, Timing().at_pace(0.5)), kinematics, CAN)
    assert (found.motion.pace, found.motion.bound_by) == (1.0, "")
    assert np.abs(found.velocity_rad_s).max() <= LIMIT_SHARE * VELOCITY_RAD_S


def test_joints_that_turn_slowly_slow_it_down_by_just_that(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    most = 0.5 * np.abs(seen.velocity_rad_s).max()
    found = parametrize(plan_motion(plan), kinematics, with_limits(velocity_rad_s=float(most)))
    assert found.motion.pace == pytest.approx(0.9 * 0.5, rel=0.02)
    assert found.motion.bound_by.startswith("velocity of ")
    assert np.abs(joint_profile(found.motion, kinematics).velocity_rad_s).max() <= 0.9 * most + 1e-9


def test_accelerations_slow_it_down_by_their_root(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    most = 0.25 * np.abs(seen.acceleration_rad_s2).max()
    found = parametrize(plan_motion(plan), kinematics, CAN, acceleration_rad_s2=float(most))
    assert found.motion.bound_by.startswith("acceleration of ")
    assert found.motion.pace == pytest.approx(0.5, rel=0.1)
    assert np.abs(joint_profile(found.motion, kinematics).acceleration_rad_s2).max() <= most * (
        1.0 + 1e-6
    )
    assert most < ACCELERATION_RAD_S2


def test_a_torque_at_rest_beyond_the_limit_is_refused_with_its_joint(
    plan: Motion, kinematics: Kinematics
) -> None:
    with refuses("motion", "5 Nm"):
        parametrize(plan_motion(plan), kinematics, with_limits(torque_nm=5.0))


def test_a_joint_beyond_its_limit_is_refused_with_its_name(
    plan: Motion, kinematics: Kinematics
) -> None:
    knee = np.where(np.arange(24) % 4 == 3, 0.5, CAN.upper_rad)
    with refuses("rad"):
        parametrize(plan_motion(plan), kinematics, replace(CAN, upper_rad=knee))


def test_what_is_expected_to_be_felt_touches_wherever_a_foot_stands(plan: Motion) -> None:
    sample = plan_motion(plan).at(0.0)
    pressed = np.einsum("ij,ij->i", expected(sample) - sample.forces_n, sample.normals)
    np.testing.assert_allclose(pressed, 3.0)


def test_a_soft_motion_keeps_its_speed_and_begins_and_ends_at_rest() -> None:
    start, goal = np.zeros(3), np.array([0.5, -0.2, 0.0])
    path = np.array([start, *soft_motion(start, goal, 0.4, 200.0)])
    np.testing.assert_array_equal(path[-1], goal)
    rates = 200.0 * np.abs(np.diff(path, axis=0))
    assert 0.38 < rates.max() <= 0.4 + 1e-9
    assert max(rates[0].max(), rates[-1].max()) < 1e-3
    assert len(path) - 1 == np.ceil(PEAK * 0.5 / 0.4 * 200.0)
    assert list(soft_motion(goal, goal, 0.4, 200.0)) == []


def test_the_soft_start_goes_round_a_surface_and_gives_up_before_it_goes_through(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion, first = plan_motion(plan), seen.angles_rad[0]
    sample = motion.at(0.0)
    rotation = rotation_of(sample.rotation_rad)
    pose = sample.com_m - rotation @ kinematics.com_offset(first), rotation
    assert len(soft_start(kinematics, motion.solids, pose, first, first, sample.normals, 0.05)) == 1
    pressed, _ = kinematics.reach(
        kinematics.feet(first) - 0.03 * sample.normals @ rotation, first, first
    )
    with refuses("soft start"):
        soft_start(kinematics, motion.solids, pose, pressed, first, sample.normals, 0.05)


def test_every_soft_start_that_is_found_keeps_feet_out_of_surfaces(
    plan: Motion, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion, first, rng = plan_motion(plan), seen.angles_rad[0], np.random.default_rng(0)
    sample = motion.at(0.0)
    rotation = rotation_of(sample.rotation_rad)
    pose = sample.com_m - rotation @ kinematics.com_offset(first), rotation
    walls = [
        (patch.normal, patch.vertices_m[0])
        for patch in plan.problem.terrain
        if abs(patch.normal[1]) > 0.9
    ]
    kinds = []
    for _ in range(12):
        along = rng.uniform(-0.12, 0.12, (6, 3)) * [1.0, 0.0, 1.0]
        found, _ = kinematics.reach(
            kinematics.feet(first) + 0.005 * sample.normals + along, first, first
        )
        try:
            ways = soft_start(kinematics, motion.solids, pose, found, first, sample.normals, 0.05)
        except InvalidInput:
            kinds.append(0)
            continue
        kinds.append(len(ways))
        for a, b in zip([found, *ways[:-1]], ways, strict=True):
            for q in np.linspace(a, b, 25):
                feet = pose[0] + kinematics.feet(q) @ rotation.T
                for normal, corner in walls:
                    assert ((feet - corner) @ normal).min() >= 0.012 - 0.006 - 1e-3
    assert {1, 2} <= set(kinds), kinds


def test_torques_along_the_path_are_those_of_the_motion(
    plan: Motion, kinematics: Kinematics
) -> None:
    bent = with_joints(plan, kinematics)
    motion = plan_motion(bent)
    profile = joint_profile(motion, kinematics)
    table = path_torques(bent, kinematics)[1]
    moving = [k for k, segment in enumerate(motion.segments) if segment.part == 1]
    ends = np.cumsum(motion.seconds)
    first = profile.static_nm[round(ends[moving[0] - 1] * RATE_HZ)]
    last = profile.static_nm[round(ends[moving[-1]] * RATE_HZ)]
    np.testing.assert_allclose(table[0], first, atol=0.1)
    np.testing.assert_allclose(table[-1], last, atol=0.1)
    assert np.abs(first).max() > 2.0


@pytest.fixture(scope="module")
def stairs(step: Callable[[str], Motion]) -> Motion:
    return step("stairs")


@pytest.fixture(scope="module")
def rows(stairs: Motion) -> Samples:
    return undisturbed(plan_motion(stairs), Kinematics(stairs.problem.robot))[0]


def test_postures_that_are_judged_are_a_centimetre_apart_from_start_to_end(
    rows: Samples,
) -> None:
    chosen = spaced(rows)
    assert (chosen[0], chosen[-1]) == (0, len(rows.com_m) - 1)
    for points in (rows.feet_m, rows.origin_m):
        assert np.linalg.norm(np.diff(points[chosen], axis=0), axis=-1).max() <= APART_M
    assert len(chosen) < len(rows.com_m) / 3


def test_the_toes_of_a_posture_are_on_their_patches_where_the_plan_has_them(
    stairs: Motion, rows: Samples
) -> None:
    """The motion moves the middles of round feet; a plan's toes are the points that touch."""
    first = postures(rows, Kinematics(stairs.problem.robot))
    np.testing.assert_allclose(first.toes_m[0], stairs.toes_at(0), atol=1e-9)
    assert first.stands[0].all()


def test_the_motion_that_is_run_is_the_one_that_is_judged(stairs: Motion) -> None:
    """The tracker's postures at 100 Hz against those of the path at the same times: bodies to .2
    mm, joints to 1°.
    """
    solver = Kinematics(stairs.problem.robot)
    whole = with_joints(stairs, solver)
    motion = plan_motion(whole)
    rows, _ = undisturbed(motion, solver)
    times = np.minimum(np.arange(len(rows.com_m)) / RATE_HZ, motion.duration_s)
    found = JointPath(motion.path, solver).postures(moments_at(motion, times))
    assert len(times) > 200
    assert np.abs(found.origin_m - rows.origin_m).max() < 2e-4
    assert np.abs(found.angles - rows.angles_rad).max() < np.radians(1.0)


def test_a_motion_through_something_is_refused_before_anything_moves(stairs: Motion) -> None:
    """The trunk's front goes into a plate that is ahead of it at the first key frame."""
    whole = with_joints(stairs)
    radius = 0.75 * np.mean([np.hypot(*limb.shoulder_m[:2]) for limb in stairs.problem.robot.limbs])
    front = stairs.com_m[-1] + [radius - 0.006, 0.0, 0.0]
    assert front[0] > stairs.com_m[0, 0] + radius + TOUCH_M
    corners = front + 0.02 * np.array([(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)])
    sign = Patch(vertices_m=corners, normal=[-1, 0, 0], shear_reference=[0, 1, 0], friction=0.5)
    course = replace(stairs.problem, terrain=(*stairs.problem.terrain, sign))
    lit, bare = replace(whole, problem=course), replace(stairs, problem=course)
    assert check_plan(lit).accepted
    report = check_plan(lit, joints=True)
    assert report.group("motion").verdict == "violated"
    assert report.group("motion").figures["worst"]["link"] == "body"
    # the runner keeps the whole robot's centre of mass on the path, not the base
    shift = report.group("joints").figures["shift_m"]
    assert report.group("motion").figures["depth_m"] == pytest.approx(0.006, abs=shift)
    assert shift < 0.015
    assert 0.0 < report.group("motion").figures["worst"]["frame"] <= stairs.problem.frames - 1
    assert check_plan(whole, joints=True).group("motion").verdict == "holds"
    with refuses("sign", "bodies"):
        Accepted.verified(lit, "sign")
    runner = Runner(MemoryWorld())
    with refuses("sign", "body"):  # a plan without angles: the runner chooses them
        runner.prepare(Accepted.verified(bare, "sign"))
    accepted = Accepted.verified(whole, "stairs")
    assert accepted.digest == check_plan(whole, joints=True).digest  # of all groups
    assert runner.prepare(accepted).motion.pace > 0.0


@pytest.mark.parametrize("near", [None, np.array([0.3, -0.2, 0.1, 0.4])])
def test_the_way_through_a_table_is_the_cheapest_of_all(near: Array | None) -> None:
    rng = np.random.default_rng(3)
    table = [(rng.uniform(-0.5, 0.5, (5, 4)), rng.uniform(0.0, 20.0, 5)) for _ in range(4)]

    def cost(ways: tuple[int, ...]) -> float:
        rows = [family[k] for (family, _), k in zip(table, ways, strict=True)]
        own = sum(float(costs[k]) for (_, costs), k in zip(table, ways, strict=True))
        begun = 0.0 if near is None else LEFT * float(np.sum((rows[0] - near) ** 2))
        return own + begun + TURNED * float(np.sum(np.diff(rows, axis=0) ** 2))

    best = min(product(range(5), repeat=4), key=cost)
    expected = np.array([family[k] for (family, _), k in zip(table, best, strict=True)])
    if near is not None:
        expected[0] = near
    families, costs = (np.array(each) for each in zip(*table, strict=True))
    np.testing.assert_array_equal(_cheapest((families, costs), near), expected)


def test_the_choice_is_the_same_at_every_pace(plan: Motion) -> None:
    kinematics = Kinematics(plan.problem.robot)
    fast, slow = (
        RedundancyResolution(plan_motion(plan, Timing().at_pace(pace)), kinematics)
        for pace in (1.0, 0.5)
    )
    for time_s in np.linspace(0.0, plan_motion(plan).duration_s, 23):
        np.testing.assert_allclose(fast.at(time_s), slow.at(2.0 * time_s), atol=1e-6)


def test_limbs_that_stand_take_the_angles_of_a_plan_that_has_some_and_so_its_torques() -> None:
    plan = TwoStage().solve(read_course("walls", frames=4)).solution
    kinematics = Kinematics(plan.problem.robot)
    bent = whole_body(plan, WholeBodyLimits(torque_nm=10.0), kinematics)
    assert bent.plan.joints_rad is not None

    def largest(of: Motion) -> float:
        motion = plan_motion(of, forces_n=distribute_forces(of, kinematics))
        return float(np.abs(joint_profile(motion, kinematics, rate_hz=20.0).static_nm).max())

    assert largest(bent.plan) < 1.1 * bent.torque_nm
    assert np.abs(path_torques(bent.plan, kinematics)[1]).max() <= 10.0
    assert largest(replace(bent.plan, joints_rad=None)) > 1.2 * bent.torque_nm


def twisted(plan: Motion) -> Motion:
    """With its own angles, but for a limb that stands elsewhere at frame 1, and jumps there on the
    straight line.
    """
    joints, _, _ = plan_angles(plan)
    joints[1, 5:7] += [-2.0, 2.0]
    return replace(plan, joints_rad=joints)


def test_a_limb_that_would_jump_between_a_plans_own_angles_is_led_round_and_stands_as_planned(
    plan: Motion,
) -> None:
    kinematics = Kinematics(plan.problem.robot)
    motion = plan_motion(twisted(plan))
    own = JointPath(motion.path, kinematics).postures(moments_at(motion, motion.knots_s)).angles
    assert np.abs(np.diff(own, axis=0)).max() > JUMP_RAD
    resolution = RedundancyResolution(motion, kinematics)
    found = np.array([resolution.at(float(time_s)) for time_s in motion.knots_s])
    assert np.abs(np.diff(found, axis=0)).max() < 0.3 * JUMP_RAD
    stands = np.array([motion.at(float(time_s)).foothold for time_s in motion.knots_s]) >= 0
    held = np.repeat(stands, 4, axis=1)
    assert held.any(axis=0).all()
    np.testing.assert_allclose(found[held], own[held], atol=1e-9)


def test_a_swing_by_way_of_comfortable_postures_ends_in_the_plans_own(
    plan: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "stancekit.planners.motion.joints.STRAY_M", -1.0
    )  # as if no limb followed its foot's path
    kinematics, motion = Kinematics(plan.problem.robot), plan_motion(twisted(plan))
    path = JointPath(motion.path, kinematics)
    moments = moments_at(motion, motion.knots_s)
    angles = path.postures(moments).angles
    assert path.corners
    for (step, limb), corners in path.corners.items():
        assert corners.shape == (2, 4)
        landed = np.flatnonzero((moments.step == step) & (moments.part == 2))[-1]
        turned = angles[landed + 1] - angles[landed]
        assert np.abs(turned[kinematics.joints_of(limb)]).max() < 0.05


def test_a_robot_that_is_somewhere_goes_on_from_there(plan: Motion) -> None:
    robot = plan.problem.robot
    motion, kinematics = plan_motion(plan), Kinematics(robot)
    alone = RedundancyResolution(motion, kinematics).at(0.0)
    other = alone.copy()
    other[0] -= 1.5  # of the left front limb: its knee elsewhere
    feet = kinematics.feet(alone)
    near, error = kinematics.reach(feet, other, other)
    assert error.max() < 1e-4
    assert np.abs(near - alone).max() > 0.3, "another posture of the same feet"
    first = joint_profile(motion, Kinematics(robot, near_rad=near)).angles_rad[0]
    assert np.abs(first - near).max() < 0.15


@pytest.mark.parametrize("index", [2, 3, 4])
def test_courses_on_which_joints_once_jumped_or_feet_stayed_behind_are_walked_smoothly(
    index: int,
) -> None:
    course = perturbed("walls", np.random.default_rng([0, index]), frames=3)
    plan = TwoStage().solve(course).solution
    assert plan is not None
    seen = joint_profile(plan_motion(plan), Kinematics(course.robot))
    assert seen.error_m.max() < 1e-5
    assert np.abs(seen.acceleration_rad_s2).max() < 60.0


__all__ = ["plan"]
PERIOD_S, VELOCITY_RAD_S = 0.005, 4.0


def test_a_joint_that_comes_too_fast_to_brake_stops_at_its_limit() -> None:
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    lowest, air = kinematics.lowest_rad[5], np.arange(6) == 1
    before, rates = np.zeros(24), np.zeros(24)
    before[5], rates[5] = (
        lowest + 0.005,
        -0.9 * VELOCITY_RAD_S,
    )  # a hip, a few milliradians before its limit
    goal = np.zeros(24)
    goal[5] = lowest
    angles = swing.led(before, rates, goal, air)
    assert before[5] + PERIOD_S * rates[5] < lowest
    assert angles[5] == lowest


def test_a_joint_that_is_asked_to_jump_comes_to_its_speed_softly_and_the_motion_waits_for_it() -> (
    None
):
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    goal, air = np.zeros(24), np.arange(6) == 1
    goal[4:8], goal[0] = [1.0, 0.0, -0.5, 0.0], 1.0
    path, rates, paces = [np.zeros(24)], np.zeros(24), list[float]()
    for _ in range(200):
        path.append(swing.led(path[-1], rates, goal, air))
        rates = (path[-1] - path[-2]) / PERIOD_S
        paces.append(swing.pace)
    speed = np.diff(np.array(path), axis=0)[:, 4:8] / PERIOD_S
    top = SPEED_SHARE * VELOCITY_RAD_S
    assert np.abs(speed).max() == pytest.approx(top)
    assert np.abs(np.diff(speed[:, 0], prepend=0.0)).max() <= top * PERIOD_S / RAMP_S + 1e-9
    assert speed.min(axis=0)[0] >= 0.0, "it brakes in time, and does not come back"
    np.testing.assert_allclose(speed[:, 2], -0.5 * speed[:, 0], atol=1e-12)
    np.testing.assert_array_equal(path[-1][4:8], goal[4:8])
    assert path[1][0] == 1.0, "a leg that stands is not led"
    assert min(paces) == 0.0
    assert paces[-1] == 1.0
    assert np.abs(np.diff(paces)).max() == pytest.approx(PERIOD_S / PAUSE_S)


def test_a_leg_that_comes_from_elsewhere_goes_along_with_what_it_follows_and_then_the_motion_waits_no_more() -> (
    None
):
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    times = PERIOD_S * np.arange(300)
    wanted = np.zeros((300, 24))
    wanted[:, 4] = 0.4 * np.sin(3.0 * times) + 0.8 * (times > 0.5)
    path, rates, paces = [wanted[0]], np.zeros(24), list[float]()
    for goal in wanted:
        path.append(swing.led(path[-1], rates, goal, np.ones(6, dtype=bool)))
        rates = (path[-1] - path[-2]) / PERIOD_S
        paces.append(swing.pace)
    sent = np.array(path[1:])[:, 4]
    speed = np.diff(sent) / PERIOD_S
    top = SPEED_SHARE * VELOCITY_RAD_S
    assert np.abs(np.diff(speed)).max() <= top * PERIOD_S / RAMP_S + 1e-9
    assert np.abs(speed).max() <= top + 1e-9
    away = np.abs(sent - wanted[:, 4])
    assert away[20:99].max() == 0.0
    assert away[101] > 0.7
    assert away[-1] == 0.0
    assert min(paces) < 0.1
    assert paces[99] == paces[-1] == 1.0


def test_no_joint_in_the_air_is_sent_faster_than_it_turns_where_a_plans_postures_are_far_apart(
    plan: Motion,
) -> None:
    kinematics, motion = Kinematics(plan.problem.robot), plan_motion(twisted(plan))
    profile = joint_profile(motion, kinematics)
    air = profile.rows.foothold < 0
    flies = np.repeat(air[1:] & air[:-1], 4, axis=1)
    sent = np.abs(np.diff(profile.angles_rad, axis=0))[flies] * 100.0
    assert 0.5 * SPEED_SHARE * VELOCITY_RAD_S < sent.max() <= SPEED_SHARE * VELOCITY_RAD_S + 1e-9
    change = np.abs(np.diff(profile.angles_rad, n=2, axis=0))[flies[1:] & flies[:-1]] * 100.0**2
    assert change.max() <= SPEED_SHARE * VELOCITY_RAD_S / RAMP_S + 1e-6
    assert profile.time_s[-1] >= motion.duration_s - 0.02


def test_a_gait_waits_for_no_leg(plan: Motion) -> None:
    kinematics, motion = (
        Kinematics(plan.problem.robot, Servo(velocity_rad_s=1.0)),
        plan_motion(twisted(plan)),
    )
    waits, steady = (
        len(undisturbed(motion, kinematics, feedback=how)[1]) for how in (BLIND, STEADY)
    )
    assert 0.0 <= steady - 1 - motion.duration_s * RATE_HZ <= 1.0 + 1e-6
    assert waits > steady + 2


def test_every_phase_alone_is_as_long_as_its_joints_need(plan: Motion) -> None:
    kinematics, motion = Kinematics(plan.problem.robot), plan_motion(twisted(plan))
    wished = resolved(motion, kinematics)
    slow = np.full(24, 0.4)
    longer = unhurried(motion, wished, slow, np.inf)
    assert longer.min() == 1.0 < longer.max()
    other = plan_motion(twisted(plan), longer=longer)
    times = other.knots_s
    rates = np.abs(np.diff(wished.path_rad, axis=0)) / np.diff(times)[:, None]
    used = (rates / (LIMIT_SHARE * slow)).max(axis=1).reshape(-1, KNOTS).max(axis=1)
    np.testing.assert_allclose(used[longer > 1.0], 1.0)
    assert used.max() <= 1.0 + 1e-9
    for share in np.linspace(0.0, 1.0, 7):
        here, there = (
            share * motion.knots_s[-1],
            np.interp(share * motion.knots_s[-1], motion.knots_s, times),
        )
        np.testing.assert_allclose(other.at(there).feet_m, motion.at(here).feet_m, atol=1e-12)
    np.testing.assert_allclose(
        wished.retimed(times).at(float(times[7])), wished.path_rad[7], atol=1e-12
    )


def test_what_is_expected_is_of_the_moment_that_comes(step: Callable[[str], Motion]) -> None:
    """A motion that waits has another time than the clock has."""
    kinematics, motion = Kinematics(step("walls").problem.robot), plan_motion(step("walls"))
    tracker = Tracker(
        motion,
        kinematics,
        100.0,
        drives=Drives.of(kinematics.model),
    )
    tracker.start()
    coming = tracker.coming
    target = tracker.next(expected(coming))
    np.testing.assert_array_equal(target.sample.feet_m, coming.feet_m)
