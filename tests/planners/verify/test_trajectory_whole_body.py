"""Walks judged by the robot's own legs: joints, torques, bodies, and what legs that weigh something
change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.obstacles import Ground
from stancekit.planners.verify.bodies import WholeBodyMeasurements
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY, TrajectoryMeasurements
from tests.forgeries.stepping import COUNT, STEP_S, stepping
from tests.planners.robot.link_frames import link_frames

pin = pytest.importorskip("pinocchio")
pytest.importorskip("coal")


def swaying() -> Motion:
    """The body turns and sways while LF swings: everything moves."""
    walk = stepping()
    share = 0.1 * np.sin(4.0 * walk.times_s)[:, None]
    rotation = np.array([pin.exp3(turn) for turn in share * [1.0, -0.6, 0.8]])
    return replace(walk, rotation=rotation, torso_m=walk.torso_m + share * [0.1, 0.2, -0.3])


def measured(walk: Motion) -> WholeBodyMeasurements:
    return WholeBodyMeasurements(TrajectoryMeasurements(walk))


def own(walk: Motion) -> RobotModel:
    assert walk.robot.model is not None
    return walk.robot.model


def test_a_step_in_place_is_accepted_with_every_group_checked() -> None:
    report = check_trajectory(stepping())
    assert report.accepted, report.message
    assert not report.unchecked
    found = {group.name: group.value for group in report.groups}
    assert found["joints"] < 1e-5
    assert 0.0 < found["torque"] < 0.9
    assert 0.0 < found["joint_speed"] < 0.9


def test_the_whole_robots_centre_of_mass_is_where_the_walk_has_it() -> None:
    walk = swaying()
    body = measured(walk)
    for k in range(0, COUNT, 20):
        shift = body.kinematics.com_offset(body.postures.angles[k])
        centre = body.postures.origin_m[k] + walk.rotation[k] @ shift
        np.testing.assert_allclose(centre, walk.torso_m[k], atol=1e-5)


def test_torques_at_rest_are_what_the_energy_of_the_posture_changes_by() -> None:
    """τ = ∂/∂q (m g z − Σ fᵢ·pᵢ) with the base held, by differences; z of the centre of mass, pᵢ of
    the feet.
    """
    walk = stepping()
    solver, body = Kinematics(robot_of(own(walk))), measured(walk)
    angles, forces = body.postures.angles[5], walk.forces_n[5]

    def energy(q: np.ndarray) -> float:
        weight = walk.robot.mass_kg * 9.81 * float(solver.com_offset(q)[2])
        return weight - float(np.sum(forces * solver.feet(q)))

    steps = 1e-6 * np.eye(len(angles))
    slope = [(energy(angles + step) - energy(angles - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(body.torques_nm[4], slope, atol=1e-4)


def test_power_of_joints_feet_and_base_is_what_the_energy_changes_by() -> None:
    """d/dt (T + U) = τ·q̇ + Σ f·v + w·v_B: what the base lacks, w, is the residual of the walk's
    balances.
    """
    walk = swaying()
    body = measured(walk)
    model = pin.buildModelFromXML(own(walk).urdf, pin.JointModelFreeFlyer())
    data, (states, between) = model.createData(), body._states
    energy = [
        pin.computeKineticEnergy(model, data, pin.integrate(model, q, 0.5 * STEP_S * v), v)
        + pin.computePotentialEnergy(model, data, pin.integrate(model, q, 0.5 * STEP_S * v))
        for q, v in zip(states[:-1], between, strict=True)
    ]
    rotors = 0.5 * np.square(between[:, body.kinematics.columns]) @ body.kinematics.rotor_kg_m2
    change = np.diff(energy + rotors) / STEP_S
    velocity = 0.5 * (between[1:] + between[:-1])
    rates = velocity[:, body.kinematics.columns]
    feet = np.array([body.kinematics.feet(q) for q in body.postures.angles])
    placed = body.postures.origin_m[:, None] + np.einsum("kij,knj->kni", walk.rotation, feet)
    centres = (placed[2:] - placed[:-2]) / (2.0 * STEP_S)
    torso = (body.postures.origin_m[2:] - body.postures.origin_m[:-2]) / (2.0 * STEP_S)
    lacks = TrajectoryMeasurements(walk).force_residual
    spin = np.einsum("kij,kj->ki", walk.rotation[1:-1], velocity[:, 3:6])
    about = np.cross((walk.torso_m - body.postures.origin_m)[1:-1], lacks)
    rolled = np.cross(placed[1:-1] - walk.feet_m[1:-1], walk.forces_n[1:-1]).sum(axis=1)
    moment = body.legs_moment() - rolled
    power = np.einsum("kj,kj->k", body.torques_nm, rates) + np.einsum(
        "kni,kni->k", walk.forces_n[1:-1], centres
    )
    power += np.einsum("ki,ki->k", lacks, torso) + np.einsum("ki,ki->k", moment + about, spin)
    np.testing.assert_allclose(power, change, atol=0.02 * np.abs(change).max())


def test_moments_of_legs_that_weigh_are_those_of_their_links() -> None:
    """L = Σ mᵢ (pᵢ − c) × vᵢ + Rᵢ Iᵢ Rᵢᵀ ωᵢ over the links, placed by chains of our own, by
    differences.
    """
    walk = swaying()
    body, model = measured(walk), own(walk)
    masses = {
        name: 10.0 if name == "base" else 0.1 if name.endswith("FOOT") else 1.0
        for name in model.mounts
    }
    inertias = {
        name: 1e-4 if name.endswith("FOOT") else 0.01 for name in masses
    }  # as small_urdfs has them
    frames = [
        link_frames(model, np.split(angles, len(model.legs))) for angles in body.postures.angles
    ]  # all legs have three joints
    turns = {n: walk.rotation @ np.array([frame[n][0] for frame in frames]) for n in masses}
    places = {
        n: body.postures.origin_m
        + np.einsum("kij,kj->ki", walk.rotation, np.array([frame[n][1] for frame in frames]))
        for n in masses
    }
    momentum = np.zeros((COUNT - 1, 3))
    centre = sum(masses[n] * places[n] for n in masses) / sum(masses.values())
    for n, mass in masses.items():
        arm = 0.5 * (places[n][1:] + places[n][:-1]) - 0.5 * (centre[1:] + centre[:-1])
        speed = np.diff(places[n] - centre, axis=0) / STEP_S
        spin = (
            np.array([pin.log3(b @ a.T) for a, b in zip(turns[n][:-1], turns[n][1:], strict=True)])
            / STEP_S
        )
        momentum += mass * np.cross(arm, speed) + inertias[n] * spin
    arms = walk.feet_m - walk.torso_m[:, None]
    expected = np.diff(momentum, axis=0) / STEP_S - np.cross(arms, walk.forces_n).sum(axis=1)[1:-1]
    found = body.legs_moment()
    assert np.abs(found).max() > 1.0
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_there_is_a_fault_for_every_group_of_the_whole_body() -> None:
    lf = own(stepping()).leg_names.index("LF")
    far = np.array(stepping().feet_m)
    far[:, lf, :2] += [0.3, 0.3]
    heavy = np.array(stepping().forces_n)
    heavy[40:43] *= 4.0
    thrown = np.array(stepping().forces_n)
    thrown[::2, 0, 0] += 200.0
    line = np.linspace(-2.0, 2.0, 17)
    raised = HeightField(
        line, line, np.where(np.abs(line[:, None] - 0.0 * line) < 0.2, 0.45, 0.0), "ridge"
    )
    faults = {
        "joints": (replace(stepping(), feet_m=far), "LF"),
        "joint_speed": (stepping(swing_s=0.06), "LF_"),
        "torque": (replace(stepping(), forces_n=heavy), "_"),
        "legs_moment": (replace(stepping(), forces_n=thrown), "torso"),
        "bodies": (stepping().asked(terrain=raised), "in the ground"),
    }
    assert set(faults) == set(WHOLE_BODY)
    for name, (walk, where) in faults.items():
        found = {group.name: group for group in check_trajectory(walk).refused}
        assert name in found, name
        assert where in found[name].where


def test_a_weak_robot_is_refused_by_torque_alone_and_one_without_limits_is_not_checked() -> None:
    needed = float(np.abs(measured(stepping()).torques_nm).max())
    report = check_trajectory(stepping(effort=1.05 * needed))
    assert [group.name for group in report.refused] == ["torque"]
    assert report.refused[0].value == pytest.approx(1.0 / 1.05, rel=1e-6)
    assert check_trajectory(stepping(effort=1.2 * needed)).accepted
    unlimited = check_trajectory(stepping(effort=0.0))
    assert unlimited.accepted
    assert unlimited.unchecked == ("torque",)
    assert "torque" not in unlimited.to_json()["checked"]


def test_links_that_go_through_each_other_are_told_with_their_names() -> None:
    walk = stepping()
    model = own(walk)
    lf, lh = model.leg_names.index("LF"), model.leg_names.index("LH")
    feet = np.array(walk.feet_m)
    feet[:, lf, 0], feet[:, lh, 0] = -0.1, 0.1
    found = {group.name: group for group in check_trajectory(replace(walk, feet_m=feet)).refused}
    assert {part.split("_")[0] for part in found["bodies"].where.split(" in ")} == {"LF", "LH"}


def test_depth_in_heights_is_that_of_a_box_in_a_slope() -> None:
    """A box's lowest corner below a plane, along its normal; nothing of a box that is above is
    looked at.
    """
    line, slope = np.linspace(-2.0, 2.0, 33), np.array([0.3, -0.2])
    ground = Ground(HeightField(line, line, slope[0] * line[:, None] + slope[1] * line, "slope"))
    point = np.array([0.4, 0.7, -0.1])
    expected = (slope @ point[:2] - point[2]) / np.sqrt(1.0 + slope @ slope)
    assert ground.depth(point[None])[0] == pytest.approx(expected, abs=1e-9)
    low = np.array([[0.1, 0.1, 0.5], [0.1, 0.1, -0.5], [-30.0, 0.0, 5.0]])
    assert (low[:, 2] < ground.tops(low, low + 0.1)).tolist() == [False, True, False]
