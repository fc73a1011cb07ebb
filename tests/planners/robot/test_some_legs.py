"""A robot on some of its legs: the others weigh, and are nobody's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Limb, Robot, hexapod
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.robot.walker import on_limbs, sets_of
from tests.refusals import refuses

ANT = Path(__file__).parents[3] / "configs/demo/ant.yaml"


@pytest.fixture(scope="module")
def ant() -> Robot:
    return robot_of(ANT)


def some(robot: Robot, names: tuple[str, ...]) -> Robot:
    return on_limbs(robot, robot.select(names), robot.mass_kg)


def test_the_legs_that_stand_are_the_robots_own_and_the_others_weigh(ant: Robot) -> None:
    three = some(ant, ("LF", "LH", "RM"))
    assert three.limb_names == ("LF", "LH", "RM")
    own, its = ant.legs, three.legs
    np.testing.assert_allclose(its.com_m, own.com_m, atol=1e-12)
    np.testing.assert_allclose(its.inertia_kgm2, own.inertia_kgm2, atol=1e-12)
    assert its.mass_kg == pytest.approx(own.mass_kg, rel=1e-12)
    whole, solver = Kinematics(ant), Kinematics(three)
    stands = np.isin(whole.joints, solver.joints)
    angles = np.concatenate([leg.stance_rad for leg in own.legs])
    rows = [ant.limb_names.index(name) for name in three.limb_names]
    np.testing.assert_allclose(solver.feet(angles[stands]), whole.feet(angles)[rows], atol=1e-12)
    for mine, others in zip(
        solver.loads(angles[stands], np.eye(3)), whole.loads(angles, np.eye(3)), strict=True
    ):
        np.testing.assert_allclose(mine, others[stands], atol=1e-9)
    np.testing.assert_allclose(solver.com_offset(angles[stands]), own.com_m, atol=1e-12)


def test_shapes_of_legs_that_do_not_stand_are_left_out(ant: Robot) -> None:
    three = some(ant, ("LF", "LH", "RM"))
    links = {shape.link for shape in three.legs.shapes}
    gone = {shape.link for shape in ant.legs.shapes} - links
    assert gone == {link for link in gone if link.startswith(("LM", "RF", "RH"))} != set()
    assert sets_of(three) == "inner"


def test_all_legs_are_the_robot_itself(ant: Robot) -> None:
    assert some(ant, ant.limb_names).legs is ant.legs


def test_legs_are_drawn_up_for_the_limbs_that_stand() -> None:
    three = some(hexapod(), ("LM", "RF", "RR"))
    assert len(three.legs.joint_names) == 12
    assert three.legs.mass_kg == pytest.approx(10.0)


def test_limbs_without_legs_are_refused() -> None:
    bare = Robot(
        name="bare", mass_kg=3.0, limbs=(Limb(name="A", shoulder_m=np.zeros(3), reach_m=0.3),)
    )
    with refuses("robot bare"):
        some(bare, ("A",))
