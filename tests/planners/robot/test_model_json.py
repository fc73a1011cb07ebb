"""A robot's own model inside a course: the same robot when read back, and whatever was forged about
it refused.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.leg import Servo
from stancekit.planners.robot.robot_file import (
    FOOT_RADIUS_M,
    MOST_LETTERS,
    named_robot,
)
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

pytest.importorskip("pinocchio")

COURSE = """
name: ground
robot: dog.yaml
frames: 2
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.05, 0.0, 0.44]
terrain: {kind: flat, friction: 0.7}
"""
SRDF = (
    '<robot name="quadruped"><disable_collisions link1="base" link2="LF_THIGH"/>'
    '<disable_collisions link1="RF_HIP" link2="base"/></robot>'
)


@pytest.fixture(scope="module")
def course(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder = tmp_path_factory.mktemp("course")
    text = quadruped().replace(
        '<box size="0.6 0.25 0.1"/>', '<mesh filename="package://dog/trunk.obj"/>'
    )
    (folder / "dog.urdf").write_text(text)
    (folder / "dog.srdf").write_text(SRDF)
    (folder / "dog").mkdir()
    (folder / "dog/trunk.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "dog.yaml").write_text(
        "urdf: dog.urdf\nsrdf: dog.srdf\npackages: [.]\nname: dog\n"
        "joints: {'*_KFE': {torque_nm: 33.0}, LH_KFE: {limits_rad: [-2.4, 0.0]}}\n"  # no leg: it hangs
        "posture_rad: {'*_HAA': 0.0, '*_HFE': 0.7, '*_KFE': -1.3}\nfeet: {RH: RH_FOOT, LF: LF_FOOT, RF: RF_FOOT}\n"
    )
    (folder / "ground.yaml").write_text(COURSE)
    return read_course(folder / "ground.yaml")


@pytest.fixture
def written(course: Problem) -> dict[str, Any]:
    return dict(json.loads(json.dumps(course.to_json())))


def test_the_model_comes_back_as_it_was_from_the_file_alone(
    course: Problem, written: dict[str, Any]
) -> None:
    model, read = course.robot.model, Problem.from_json(written).robot.model
    assert model is not None
    assert read is not None
    assert read.name == "dog"
    assert read.digest == model.digest
    assert read.urdf == model.urdf
    assert read.leg_names == ("RH", "LF", "RF")
    assert read.disabled_pairs == {frozenset({"base", "LF_THIGH"}), frozenset({"base", "RF_HIP"})}
    assert any(shape.mesh is not None for shape in model.shapes)
    assert all(shape.mesh is None for shape in read.shapes)
    hulls = [shape.corners_m for shape in model.shapes if shape.corners_m is not None]
    for mine, its in zip(
        [s.corners_m for s in read.shapes if s.corners_m is not None], hulls, strict=True
    ):
        np.testing.assert_array_equal(mine, its)
    for mine, its in zip(read.legs, model.legs, strict=True):
        assert mine.joints == its.joints
        assert mine.joints[-1].torque_nm == 33.0
        assert mine.radius_m == its.radius_m == 0.02
        np.testing.assert_array_equal(mine.stance_rad, its.stance_rad)
        np.testing.assert_array_equal(
            mine.chain.feet(mine.stance_rad[None]), its.chain.feet(its.stance_rad[None])
        )
    np.testing.assert_array_equal(read.com_m, model.com_m)
    np.testing.assert_array_equal(Problem.from_json(written).robot.origin_m, model.com_m)
    assert Problem.from_json(written).to_json() == written


def test_no_folder_of_this_machine_is_in_a_file(written: dict[str, Any], tmp_path: Path) -> None:
    assert str(tmp_path) not in json.dumps(written)


def edited(old: str, new: str) -> Callable[[dict[str, Any]], None]:
    def edit(model: dict[str, Any]) -> None:
        assert old in model["urdf"]
        model["urdf"] = model["urdf"].replace(old, new)

    return edit


def _renamed(model: dict[str, Any]) -> None:
    model["legs"][0]["name"], model["legs"][1]["name"] = "LF", "RH"


def _twice(model: dict[str, Any]) -> None:
    model["legs"][1]["name"] = "RH"


def _other_foot(model: dict[str, Any]) -> None:
    model["legs"][0]["foot"] = "RH_SHANK"


def _other_joints(model: dict[str, Any]) -> None:
    stance = model["legs"][0]["stance_rad"]
    model["legs"][0]["stance_rad"] = dict(reversed(stance.items()))


def _crouched(model: dict[str, Any]) -> None:
    model["legs"][0]["stance_rad"]["RH_KFE"] = -1.2


def _doctype(model: dict[str, Any]) -> None:
    model["urdf"] = model["urdf"].replace("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot', 1)


@pytest.mark.parametrize(
    ("forge", "message"),
    [
        (
            edited('upper="1.4"', 'upper="1.5"'),
            "digest mismatch: the URDF or its legs are not those that were written",
        ),
        (
            edited('effort="33.0"', 'effort="1e9"'),
            "digest mismatch: the URDF or its legs are not those that were",
        ),
        (
            edited("0 0 -.3", "0 0 -.31"),
            "digest mismatch: the URDF or its legs are not those that were written",
        ),
        (_renamed, "digest mismatch: the URDF or its legs are not those that were written"),
        (_other_foot, "digest mismatch: the URDF or its legs are not those that were written"),
        (_crouched, "digest mismatch: the URDF or its legs are not those that were written"),
        (_twice, "legs: expected different names, got RH, RH, RF"),
        (
            _other_joints,
            "leg RH: expected the joints RH_HAA, RH_HFE, RH_KFE, got RH_KFE, RH_HFE, RH_HAA",
        ),
        (_doctype, "urdf: expected a URDF: expected XML without a document type and entities"),
        (edited("<robot", "<robo"), "urdf: expected a URDF: expected a robot, got 'robo'"),
    ],
)
def test_a_model_that_was_changed_is_refused(
    written: dict[str, Any], forge: Callable[[dict[str, Any]], None], message: str
) -> None:
    forge(written["robot"]["model"])
    with pytest.raises(InvalidInput) as caught:
        Problem.from_json(written)
    assert str(caught.value).startswith(f"robot dog: model: {message}")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (
            "urdf",
            " " * (MOST_LETTERS + 1),
            "robot dog: model.urdf: String should have at most 2000000 characters",
        ),
        ("legs", [], "robot dog: model.legs: List should have at least 1 item"),
        (
            "disabled_pairs",
            [["a", "b", "c"]],
            "robot dog: model.disabled_pairs[0]: List should have at most 2 items",
        ),
        ("more", 1, "robot dog: model.more: unknown key"),
    ],
)
def test_a_model_out_of_bounds_is_refused(
    written: dict[str, Any], key: str, value: Any, message: str
) -> None:
    written["robot"]["model"][key] = value
    with pytest.raises(InvalidInput) as caught:
        Problem.from_json(written)
    assert message in str(caught.value)


def test_limbs_and_mass_are_those_of_the_model(course: Problem, written: dict[str, Any]) -> None:
    robot = course.robot
    with refuses("robot dog", "RH"):
        replace(robot, limbs=robot.limbs[1:])
    written["robot"]["mass_kg"] += 0.001
    with refuses("robot dog", "22.401"):
        Problem.from_json(written)
    sole = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]])
    with refuses("robot dog", "soles"):
        replace(robot, limbs=(replace(robot.limbs[0], sole_m=sole), *robot.limbs[1:]))


def test_a_robot_of_balls_gets_the_legs_that_are_drawn_up_and_another_one_its_own(
    course: Problem,
) -> None:
    robot = hexapod()
    drawn = robot.legs
    assert drawn.digest == named_robot("hexapod").digest
    assert tuple(name for leg in drawn.legs for name in leg.joint_names) == robot.joint_names
    np.testing.assert_array_equal(robot.foot_radii_m, [FOOT_RADIUS_M] * 6)
    np.testing.assert_array_equal(robot.origin_m, np.zeros(3))
    assert course.robot.legs is course.robot.model
    np.testing.assert_array_equal(course.robot.foot_radii_m, [0.02] * 3)
    few = tuple(replace(limb, reach_m=0.1) for limb in robot.limbs[:2])
    small = Robot(name="crab", mass_kg=2.0, limbs=few, drawn=Servo())
    for leg, limb in zip(small.legs.legs, small.limbs, strict=True):
        far = float(np.linalg.norm(leg.nominal_m - limb.shoulder_m))
        assert far == pytest.approx(0.1 * np.hypot(0.15, 0.2) / 0.35, abs=1e-6)
