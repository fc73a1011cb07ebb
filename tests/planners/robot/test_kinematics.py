"""Inverse kinematics and torques, against rotations by scipy, finite differences and virtual
work.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from stancekit import Motion
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import directions, link_lengths, outward_rad, swivels
from stancekit.planners.robot.leg import FOOT_RADIUS_M, Servo

pytest.importorskip("pinocchio")
from stancekit.planners.motion.joints import plan_angles
from stancekit.planners.robot.kinematics import REACHED_M, Kinematics, rotation_of
from stancekit.planners.verify.postures import joint_groups
from tests.refusals import assert_names, refuses

ROBOT = hexapod()
SHOULDERS = np.array([limb.shoulder_m for limb in ROBOT.limbs])
OUTWARD = SHOULDERS / np.linalg.norm(SHOULDERS, axis=1)[:, None]


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(ROBOT)


@pytest.fixture(scope="module")
def plan(course_plan: Callable[[str, int], Motion]) -> Motion:
    return course_plan("walls", 3)


def foot_by_hand(limb: int, angles: np.ndarray) -> np.ndarray:
    """The foot's centre in the body frame: shoulder, then yaw about z, hip about y, roll about x,
    knee about y.
    """
    owner = ROBOT.limbs[limb]
    thigh, shank = link_lengths(owner)
    yaw, hip, roll, knee = angles
    upper = Rotation.from_euler("ZYX", [yaw + outward_rad(owner), hip, roll])
    return (
        owner.shoulder_m
        + upper.apply([thigh, 0, 0])
        + (upper * Rotation.from_euler("Y", knee)).apply([shank, 0, 0])
    )


def test_feet_are_where_the_joints_put_them(kinematics: Kinematics) -> None:
    angles = np.random.default_rng(0).uniform(-1.5, 1.5, 24)
    by_hand = [foot_by_hand(i, angles[4 * i : 4 * i + 4]) for i in range(6)]
    np.testing.assert_allclose(kinematics.feet(angles), by_hand, atol=1e-12)


def test_every_posture_of_a_family_reaches_its_target() -> None:
    rng, lengths = np.random.default_rng(1), link_lengths(ROBOT.limbs[0])
    for _ in range(40):
        target = rng.normal(size=3)
        target *= rng.uniform(0.02, 0.37) / np.linalg.norm(target)
        upper, lower = directions(swivels(lengths, target))
        np.testing.assert_allclose(
            lengths[0] * upper + lengths[1] * lower, np.tile(target, (len(upper), 1)), atol=1e-9
        )


def test_the_workspace_away_from_the_body_and_not_steeply_above_the_shoulder_is_reached(
    kinematics: Kinematics,
) -> None:
    rng = np.random.default_rng(2)
    for _ in range(40):
        way = rng.normal(size=(6, 3))
        way *= rng.uniform(0.08, 0.35, (6, 1)) / np.linalg.norm(way, axis=1)[:, None]
        way = np.where(np.einsum("ij,ij->i", way, OUTWARD)[:, None] < 0.0, -way, way)
        way[:, 2] = np.where(way[:, 2] > 0.8 * np.linalg.norm(way, axis=1), -way[:, 2], way[:, 2])
        turn = rng.uniform(-0.2618, 0.2618, 3)
        toes = [0.3, -0.2, 0.5] + (SHOULDERS + way) @ rotation_of(turn).T
        angles, error, _ = kinematics.solve([0.3, -0.2, 0.5], turn, toes)
        assert np.all(error <= REACHED_M)
        by_hand = [foot_by_hand(i, angles[4 * i : 4 * i + 4]) for i in range(6)]
        np.testing.assert_allclose(
            rotation_of(turn) @ np.transpose(by_hand), (toes - [0.3, -0.2, 0.5]).T, atol=1e-6
        )


def test_a_foot_below_its_shoulder_and_one_beside_that_are_reached_with_nearby_angles(
    kinematics: Kinematics,
) -> None:
    below = SHOULDERS + np.array([0.0, 0.0, -0.2])
    first, error, _ = kinematics.solve(np.zeros(3), np.zeros(3), below)
    second, missed, _ = kinematics.solve(
        np.zeros(3), np.zeros(3), below + np.array([0.004, -0.003, 0.0]), seed=first
    )
    assert np.all(error <= REACHED_M)
    assert np.all(missed <= REACHED_M)
    assert np.abs(second - first).max() < 0.15


def test_feet_touch_at_their_toes(kinematics: Kinematics) -> None:
    toes = SHOULDERS + 0.15 * OUTWARD + [0.0, 0.0, -0.2]
    angles, _, _ = kinematics.solve(
        np.zeros(3), np.zeros(3), toes, normals=np.tile([0.0, 0.0, 1.0], (6, 1))
    )
    np.testing.assert_allclose(
        kinematics.feet(angles), toes + np.array([0.0, 0.0, FOOT_RADIUS_M]), atol=1e-6
    )


def test_what_is_out_of_reach_is_said_by_how_much(kinematics: Kinematics) -> None:
    toes = SHOULDERS + 0.2 * OUTWARD
    toes[3] = SHOULDERS[3] + 0.5 * OUTWARD[3]
    _, error, _ = kinematics.solve(np.zeros(3), np.zeros(3), toes)
    assert not np.all(error <= REACHED_M)
    assert error[3] == pytest.approx(0.5 - link_lengths(ROBOT.limbs[3]).sum(), abs=1e-4)
    assert np.delete(error, 3).max() < 1e-5


def test_a_joint_that_would_have_to_go_beyond_its_limit_is_said_by_how_much() -> None:
    narrow = Kinematics(
        ROBOT, Servo(lower_rad=(-0.1, -1.8, -0.05, -0.05), upper_rad=(0.1, 1.8, 0.05, 2.75))
    )
    aside = Rotation.from_euler("z", 0.7).apply(OUTWARD[0])
    toes = SHOULDERS + 0.25 * OUTWARD
    toes[0] = SHOULDERS[0] + 0.25 * aside
    angles, error, limit = narrow.solve(np.zeros(3), np.zeros(3), toes)
    assert error[0] > 0.05
    assert limit[0] > 0.1
    assert np.all(np.abs(angles.reshape(6, 4)[:, 0]) <= 0.1 + 1e-12)


def test_joints_at_a_limit_wait_and_the_others_reach(kinematics: Kinematics) -> None:
    """Four joints a leg: with the hip at its limit three are left, and a start beyond it is no
    answer.
    """
    rng, count = np.random.default_rng(0), len(kinematics.robot.limbs)
    lower, upper = (
        limit.reshape(count, 4) for limit in (kinematics.lowest_rad, kinematics.highest_rad)
    )
    for _ in range(20):
        goal = np.tile([0.0, -1.79, 0.3, 2.0], (count, 1)) + rng.uniform(-0.1, 0.1, (count, 4))
        goal = np.clip(goal, lower, upper)
        begun = np.clip(goal + rng.uniform(-0.05, 0.05, goal.shape), lower, upper)
        begun[:, 1] = lower[:, 1] - 0.01
        wished = begun.copy()
        wished[:, 1] -= 0.1  # beyond
        angles, error = kinematics.reach(
            kinematics.feet(goal.ravel()), begun.ravel(), wished.ravel()
        )
        assert error.max() < 1e-6
        assert kinematics.beyond(angles).max() == 0.0


def test_torques_are_those_of_virtual_work(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(3)
    angles, turn, forces = (
        rng.uniform(-1.0, 1.0, 24),
        rotation_of([0.1, -0.2, 0.05]),
        rng.normal(size=(6, 3)) * 30.0,
    )

    def work(q: np.ndarray) -> float:
        """Potential energy of the limbs less the work of the contact forces, the body held."""
        height = float((turn @ kinematics.com_offset(q))[2])
        return ROBOT.mass_kg * 9.81 * height - float(np.sum(forces * (kinematics.feet(q) @ turn.T)))

    step = 1e-6
    slope = [(work(angles + step * e) - work(angles - step * e)) / (2.0 * step) for e in np.eye(24)]
    np.testing.assert_allclose(kinematics.torques(angles, turn, forces), slope, atol=1e-5)


def test_rotations_are_exact_not_linearised() -> None:
    vector = np.array([0.2, -0.1, 0.25])
    x, y, z = vector
    np.testing.assert_allclose(
        rotation_of(vector), expm([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), atol=1e-14
    )
    np.testing.assert_allclose(rotation_of(np.zeros(3)), np.eye(3))


def test_a_plan_has_angles_that_stay_close_where_toes_stay(plan: Motion) -> None:
    answers, _, _ = plan_angles(plan)
    assert len(answers) == plan.problem.frames
    for k in range(1, plan.problem.frames):
        stays = plan.problem.holds[k] == plan.problem.holds[k - 1]
        moved = np.abs(answers[k] - answers[k - 1]).reshape(6, 4)[stays]
        assert moved.max() < 0.6


@pytest.mark.parametrize("limb", [0, 2, 4])
def test_a_robot_that_stands_keeps_its_posture_until_a_limb_lifts(
    plan: Motion, kinematics: Kinematics, limb: int
) -> None:
    """It begins with the knee at the far side of its circle about the line from shoulder to
    foot.
    """
    usual, its = plan_angles(plan)[0], slice(4 * limb, 4 * limb + 4)
    foot = kinematics.feet(usual[0])[limb] - SHOULDERS[limb]
    outward = rotation_of([0.0, 0.0, outward_rad(ROBOT.limbs[limb])])
    family = swivels(link_lengths(ROBOT.limbs[limb]), outward.T @ foot)
    servo = Servo()
    within = family[np.all((family > servo.lower_rad) & (family < servo.upper_rad), axis=1)]
    start = np.array(usual[0])
    start[its] = max(within, key=lambda other: float(np.abs(other - start[its]).max()))
    assert np.abs(start - usual[0]).max() > 2.0
    assert plan.problem.holds[1, limb] == plan.problem.holds[0, limb]

    found, error, _ = plan_angles(plan, start_rad=start)
    assert np.all(error <= REACHED_M)
    np.testing.assert_allclose(
        found[0], start, atol=0.02
    )  # only feet are put where the plan has them
    assert np.abs(found[1] - found[0])[its].max() <= 0.5


def test_a_good_plan_is_within_the_joints(plan: Motion) -> None:
    angles, joints, torque = joint_groups(plan)
    assert [joints.verdict, torque.verdict] == ["holds", "holds"], joints.message + torque.message
    assert angles.shape == (plan.problem.frames, len(ROBOT.joint_names))
    assert 1.0 < torque.figures["torque_nm"] < 40.0
    assert (
        0.0 < joints.figures["shift_m"] < 0.02
    )  # paper E: "assumed to always be at the geometric center"


def test_weak_servos_are_found_with_frame_and_limb(plan: Motion, kinematics: Kinematics) -> None:
    angles, _, strong = joint_groups(plan)
    each = [
        np.abs(
            kinematics.torques(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]), forces)
        )
        for of, forces in zip(plan.problem.stances, plan.forces_n, strict=True)
    ]
    row, joint = np.unravel_index(int(np.argmax(each)), np.shape(each))
    place = plan.problem.stances[row].frame, ROBOT.limb_names[int(kinematics.legs[joint])]
    *_, torque = joint_groups(plan, Servo(torque_nm=5.0))
    assert torque.verdict == "violated"
    assert torque.figures["torque_nm"] == strong.figures["torque_nm"] > 5.0
    assert torque.value == pytest.approx(torque.figures["torque_nm"] / 5.0)
    assert (torque.when, torque.limb) == place
    assert_names(torque.message, f"frame {place[0]}", f"limb {place[1]}")


def test_a_toe_out_of_reach_is_found_with_frame_and_limb(plan: Motion) -> None:
    toes = plan.toes_m.copy()
    foothold = int(plan.problem.holds[2][4])
    toes[foothold] += [0.0, 0.0, 0.6]
    _, joints, _ = joint_groups(replace(plan, toes_m=toes))
    assert joints.verdict == "violated"
    assert joints.limb == ROBOT.limb_names[4]
    assert_names(joints.message, f"limb {ROBOT.limb_names[4]}")


def test_without_pinocchio_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with refuses("pinocchio", "[robots]"):
        Kinematics(ROBOT)
