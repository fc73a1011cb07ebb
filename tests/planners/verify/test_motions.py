"""The verifier of motions from elsewhere: ours hold, with and without contacts and forces; spoiled ones are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("coal")

import stancekit
from stancekit.planners.answer.motion_table import MotionTable
from stancekit.planners.answer.report import Report
from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.terrain.ground import Ground
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify.motions import check_motion, nearest
from stancekit.runner.export.formats import moved_of
from stancekit.runner.export.moved import Moved


@pytest.fixture(scope="module")
def moved() -> Moved:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    assert walk is not None
    return moved_of(walk, "npz")


def judged(table: MotionTable, moved: Moved) -> Report[MotionTable]:
    assert moved.robot is not None
    return check_motion(table, moved.robot, moved.terrain)


def arrays(table: MotionTable) -> tuple[np.ndarray, np.ndarray]:
    """Angles and origins that may be changed."""
    known = table.known()
    return np.array(known["angles_rad"]), np.array(known["origin_m"])


def test_an_exported_walk_holds_in_every_group(moved: Moved) -> None:
    report = judged(moved.table, moved)
    assert report.message == "accepted: all 11 groups within their limits"
    assert report.checked == tuple(group.name for group in report.groups)


def test_without_contacts_and_forces_the_verdicts_that_are_known_are_the_same(moved: Moved) -> None:
    whole, bare = judged(moved.table, moved), judged(replace(moved.table, contact=None, forces_n=None), moved)
    assert bare.unchecked == ("contact_gap", "forces", "cone", "swing_force")
    assert bare.group("cone").message == "no forces in the file"
    for one, other in zip(whole.groups, bare.groups, strict=True):
        assert other.verdict in (one.verdict, "not checked")


def test_joints_alone_say_little_and_that_is_said(moved: Moved) -> None:
    report = judged(replace(moved.table, origin_m=None, quaternion=None), moved)
    assert report.checked == ("joints", "joint_speed", "torque")
    assert report.group("balance").message == "where the body is and how it is turned is not known"


def test_joints_in_another_order_are_the_same_motion(moved: Moved) -> None:
    table = moved.table
    turned = {
        name: None if getattr(table, name) is None else getattr(table, name)[:, ::-1]
        for name in ("angles_rad", "rates_rad_s", "torques_nm")
    }
    report = judged(replace(table, joints=table.joints[::-1], **turned), moved)
    assert [group.value for group in report.groups] == [group.value for group in judged(table, moved).groups]


def test_a_joint_beyond_its_limit_is_named(moved: Moved) -> None:
    assert moved.robot is not None
    angles, _ = arrays(moved.table)
    joint = int(np.argmax(np.isfinite(Kinematics(moved.robot).highest_rad)))
    angles[100:120, joint] = Kinematics(moved.robot).upper_rad[joint] + 0.05
    group = judged(replace(moved.table, angles_rad=angles), moved).group("joints")
    assert (group.verdict, group.where) == ("violated", moved.table.joints[joint])
    assert group.value == pytest.approx(0.05)


def test_a_body_beside_its_feet_tips_over(moved: Moved) -> None:
    angles, origin = arrays(moved.table)
    known, kinematics = moved.table.known(), Kinematics(moved.robot)
    origin[:, 1] += 0.6 * np.sin(np.pi * np.linspace(0.0, 1.0, len(origin))) ** 2
    for row, turn in enumerate(moved.table.rotation):
        feet = known["origin_m"][row] + kinematics.feet(known["angles_rad"][row]) @ turn.T
        angles[row] = kinematics.reach((feet - origin[row]) @ turn, angles[max(0, row - 1)], angles[row], limits=False)[
            0
        ]
    report = judged(replace(moved.table, angles_rad=angles, origin_m=origin, forces_n=None), moved)
    assert "balance" in [group.name for group in report.refused]


def test_a_body_that_is_too_low_has_its_feet_in_the_ground(moved: Moved) -> None:
    _, origin = arrays(moved.table)
    report = judged(replace(moved.table, origin_m=origin - [0.0, 0.0, 0.02], contact=None, forces_n=None), moved)
    assert report.group("penetration").value == pytest.approx(0.02, abs=2e-3)
    assert report.group("penetration").verdict == "violated"


def test_a_body_that_slides_while_its_feet_stand_slips(moved: Moved) -> None:
    _, origin = arrays(moved.table)
    origin[:, 0] += 0.03 * np.linspace(0.0, 1.0, len(origin))
    group = judged(replace(moved.table, origin_m=origin), moved).group("slip")
    assert group.verdict == "violated"
    assert 5e-3 < group.value < 0.03


def test_forces_outside_of_their_cones_and_in_the_air_are_found(moved: Moved) -> None:
    forces, contact = np.array(moved.table.forces_n), moved.table.contact
    assert contact is not None
    forces[..., 0] += np.where(contact, 0.9 * forces[..., 2], 5.0)
    report = judged(replace(moved.table, forces_n=forces), moved)
    assert {"cone", "swing_force", "forces"} <= {group.name for group in report.refused}


def test_other_joints_are_refused_by_name(moved: Moved) -> None:
    with pytest.raises(InvalidInput, match=r"^joints: expected those of .*; the robot has no arm$|it lacks"):
        judged(replace(moved.table, joints=("arm", *moved.table.joints[1:])), moved)
    with pytest.raises(InvalidInput, match="angles of the joints"):
        judged(replace(moved.table, angles_rad=None), moved)


def test_a_ball_over_a_patch_its_edge_and_heights() -> None:
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    patch = Patch(vertices_m=square, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
    centres = np.array([[0.5, 0.5, 0.1], [1.3, 0.5, 0.4], [0.5, 0.5, -0.01], [1.3, 0.5, -0.4]])
    gap, normal, friction = nearest([patch], centres, np.full(4, 0.02))
    np.testing.assert_allclose(gap, [0.08, 0.48, -0.03, 0.48])
    assert (normal == [0, 0, 1]).all()
    assert (friction == 0.6).all()
    level = Ground(heights=stancekit.HeightField.from_array(np.full((41, 41), 0.2), spacing_m=0.1), friction=0.5)
    gap, _, _ = nearest(level, np.array([[0.0, 0.0, 0.3]]), np.array([0.02]))
    assert gap[0] == pytest.approx(0.08)


def test_a_walker_without_legs_is_refused() -> None:
    from stancekit.planners.robot.walker import named_walker

    with pytest.raises(InvalidInput):
        walking_robot(named_walker("anymal-boxes"))
