"""Time parametrisation against closed forms and limits, and the soft start's way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.motion.joints import path_torques
from stancekit.planners.motion.plan_motion import PlanMotion, Timing
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.kinematics import Kinematics, pinocchio, rotation_of
from stancekit.planners.robot.legged import robot_of
from stancekit.planners.robot.robot_file import Servo, hexapod_urdf
from stancekit.planners.robot.robot_model import model_of
from stancekit.runner.motion.time_parametrization import (
    ACCELERATION_RAD_S2,
    PEAK,
    RATE_HZ,
    JointProfile,
    expected,
    joint_profile,
    parametrize,
    soft_motion,
    soft_start,
)
from stancekit.runner.worlds.drives import Drives
from stancekit.runner.worlds.world import WorldCapabilities
from tests.emulators.memory_world import MemoryWorld
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

CAN = MemoryWorld().capabilities


@pytest.fixture(scope="module")
def plan(step: Callable[[str], Plan]) -> Plan:
    return step("walls")


@pytest.fixture(scope="module")
def kinematics(plan: Plan) -> Kinematics:
    return Kinematics(plan.problem.robot)


@pytest.fixture(scope="module")
def seen(plan: Plan, kinematics: Kinematics) -> JointProfile:
    return joint_profile(PlanMotion(plan), kinematics)


def with_limits(**limits: float) -> WorldCapabilities:
    return replace(CAN, **{name: np.full(24, value) for name, value in limits.items()})  # type: ignore[arg-type]


def test_the_look_is_along_the_whole_motion_and_reaches_every_foot(
    plan: Plan, seen: JointProfile
) -> None:
    assert seen.time_s[-1] == pytest.approx(PlanMotion(plan).duration_s, abs=0.011)
    assert seen.error_m.max() < 1e-5


def test_feet_of_the_angles_are_where_the_motion_has_them(
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion = PlanMotion(plan)
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
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    slow = joint_profile(PlanMotion(plan, Timing().at_pace(0.5)), kinematics)
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
    seen: JointProfile, plan: Plan, kinematics: Kinematics
) -> None:
    """Power: what the joints' torques do while nobody stands is the change of kinetic energy, and
    of a rotor alone.
    """
    from stancekit.runner.motion.time_parametrization import _Limbs

    limbs, sample = _Limbs(kinematics, kinematics.rotor_kg_m2), PlanMotion(plan).at(0.0)
    pin = pinocchio()
    model = pin.buildModelFromXML(hexapod_urdf(plan.problem.robot))  # the body stays where it is
    data = model.createData()
    air = replace(sample, foothold=np.full(6, -1))
    rng = np.random.default_rng(0)
    angles, velocity, acceleration = (rng.uniform(-1.0, 1.0, 24) for _ in range(3))
    step = 1e-5

    def energy(t: float) -> float:
        q, v = angles + velocity * t + 0.5 * acceleration * t * t, velocity + acceleration * t
        rotors = 0.5 * kinematics.servo.rotor_kg_m2 * float(v @ v)
        return float(pin.computeKineticEnergy(model, data, q, v)) + rotors

    torques = limbs.torques(angles, velocity, acceleration, air, np.zeros(3))
    assert torques @ velocity == pytest.approx(
        (energy(step) - energy(-step)) / (2.0 * step), rel=1e-5
    )


def test_the_rotors_of_a_urdfs_joints_are_those_that_its_world_turns_and_its_verifier_counts(
    plan: Plan,
) -> None:
    """Not the servos': those are of a hexapod, and heavy or light for others."""
    from stancekit.runner.motion.time_parametrization import _Limbs

    model = model_of(quadruped(effort=60.0))
    kinematics = Kinematics(robot_of(model))
    drives = Drives.of(kinematics.robot, Servo(), model)
    length_m = np.mean([leg.chain.length_m for leg in model.legs])
    np.testing.assert_allclose(kinematics.rotor_kg_m2, 2e-4 * 9.81 * model.body.mass_kg * length_m)
    np.testing.assert_array_equal(drives.rotor_kg_m2, kinematics.rotor_kg_m2)
    still, angles = np.zeros(len(drives.joints)), np.full(len(drives.joints), 0.3)
    rising = np.linspace(-50.0, 50.0, len(still))
    air = replace(PlanMotion(plan).at(0.0), foothold=np.full(4, -1))
    torques, bare = (
        _Limbs(kinematics, rotors).torques(angles, still, rising, air, np.zeros(3))
        for rotors in (drives.rotor_kg_m2, 0.0 * drives.rotor_kg_m2)
    )
    np.testing.assert_allclose(torques - bare, drives.rotor_kg_m2 * rising, atol=1e-12)


def test_a_body_that_accelerates_takes_torques_of_its_mass_times_that(
    plan: Plan, kinematics: Kinematics
) -> None:
    from stancekit.runner.motion.time_parametrization import _Limbs

    limbs, sample, still = (
        _Limbs(kinematics, kinematics.rotor_kg_m2),
        PlanMotion(plan).at(0.0),
        np.zeros(24),
    )
    angles = np.tile([0.1, 0.4, 0.0, 1.0], 6)
    push = np.array([0.3, -0.2, 0.5])
    torques = limbs.torques(angles, still, still, sample, push)
    step, rate = 1e-6, np.random.default_rng(1).normal(size=24)
    rotation = rotation_of(sample.rotation_rad)
    moved = (kinematics.feet(angles + step * rate) - kinematics.feet(angles - step * rate)) / (
        2.0 * step
    )
    # virtual work: torques on joints and the feet's forces, which are m a / 6 each, balance
    assert torques @ rate == pytest.approx(
        -float((moved @ rotation.T @ (10.0 * push / 6.0)).sum()), rel=1e-5
    )


def test_a_motion_within_all_limits_keeps_its_pace(plan: Plan, kinematics: Kinematics) -> None:
    found = parametrize(plan, kinematics, CAN, Timing().at_pace(0.5))
    assert (found.pace, found.bound_by) == (1.0, "")
    assert max(found.velocity, found.acceleration, found.torque) <= 1.0


def test_joints_that_turn_slowly_slow_it_down_by_just_that(
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    most = 0.5 * np.abs(seen.velocity_rad_s).max()
    found = parametrize(plan, kinematics, with_limits(velocity_rad_s=float(most)))
    assert found.pace == pytest.approx(0.9 * 0.5, rel=0.02)
    assert found.bound_by.startswith("velocity of ")
    assert np.abs(joint_profile(found.motion, kinematics).velocity_rad_s).max() <= 0.9 * most + 1e-9


def test_accelerations_slow_it_down_by_their_root(
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    most = 0.25 * np.abs(seen.acceleration_rad_s2).max()
    found = parametrize(plan, kinematics, CAN, acceleration_rad_s2=float(most))
    assert found.bound_by.startswith("acceleration of ")
    assert found.pace == pytest.approx(0.5, rel=0.1)
    assert np.abs(joint_profile(found.motion, kinematics).acceleration_rad_s2).max() <= most * (
        1.0 + 1e-6
    )
    assert most < ACCELERATION_RAD_S2


def test_a_torque_at_rest_beyond_the_limit_is_refused_with_its_joint(
    plan: Plan, kinematics: Kinematics
) -> None:
    with refuses("motion", "5 Nm"):
        parametrize(plan, kinematics, with_limits(torque_nm=5.0))


def test_a_joint_beyond_its_limit_is_refused_with_its_name(
    plan: Plan, kinematics: Kinematics
) -> None:
    knee = np.where(np.arange(24) % 4 == 3, 0.5, CAN.upper_rad)
    with refuses("rad"):
        parametrize(plan, kinematics, replace(CAN, upper_rad=knee))


def test_what_is_expected_to_be_felt_touches_wherever_a_foot_stands(plan: Plan) -> None:
    sample = PlanMotion(plan).at(0.0)
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
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion, first = PlanMotion(plan), seen.angles_rad[0]
    sample = motion.at(0.0)
    rotation = rotation_of(sample.rotation_rad)
    pose = sample.com_m - rotation @ kinematics.com_offset(first), rotation
    direct = soft_start(kinematics, motion.solids, pose, first, first, sample.normals, 0.05)
    assert len(direct) == 1
    pressed, _ = kinematics.reach(
        kinematics.feet(first) - 0.03 * sample.normals @ rotation, first, first
    )
    with refuses("soft start"):
        soft_start(kinematics, motion.solids, pose, pressed, first, sample.normals, 0.05)


def test_every_soft_start_that_is_found_keeps_feet_out_of_surfaces(
    plan: Plan, seen: JointProfile, kinematics: Kinematics
) -> None:
    motion, first, rng = PlanMotion(plan), seen.angles_rad[0], np.random.default_rng(0)
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


def test_torques_along_the_path_are_those_of_the_motion(plan: Plan, kinematics: Kinematics) -> None:
    bent = with_joints(plan, kinematics)
    motion = PlanMotion(bent)
    profile = joint_profile(motion, kinematics)
    table = path_torques(bent, kinematics)
    moving = [k for k, phase in enumerate(motion.phases) if phase.segment.part == 1]
    ends = np.cumsum([phase.seconds for phase in motion.phases])
    first = profile.static_nm[round(ends[moving[0] - 1] * RATE_HZ)]
    last = profile.static_nm[round(ends[moving[-1]] * RATE_HZ)]
    np.testing.assert_allclose(table[0], first, atol=0.1)
    np.testing.assert_allclose(table[-1], last, atol=0.1)
    assert np.abs(first).max() > 2.0
