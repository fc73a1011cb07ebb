"""Whose legs are known: a robot's own, the hexapod's, and those that a file asks to be drawn up."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.answer.plan import WHOLE_BODY
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import Servo
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.reach_sets import workspaces_of
from stancekit.planners.robot.robot_file import drawn_urdf
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import contact_robot, sets_of
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.refusals import assert_names, refuses

from .small_urdfs import quadruped

FOUR: dict[str, Any] = {
    "name": "four",
    "frames": 3,
    "gait": "wave",
    "start_m": [0.0, 0.0, 0.3],
    "goal_m": [0.1, 0.0, 0.3],
    "stance": {"outward_m": 0.1, "down_m": 0.3},
    "terrain": {"kind": "flat", "friction": 0.6},
    "robot": {
        "name": "anymal",
        "mass_kg": 30.0,
        "limbs": {
            name: {"shoulder_m": [x, y, 0.0], "reach_m": 0.45}
            for name, x, y in (
                ("LF", 0.3, 0.15),
                ("LH", -0.3, 0.15),
                ("RF", 0.3, -0.15),
                ("RH", -0.3, -0.15),
            )
        },
    },
}
UNKNOWN = (
    "robot anymal: no legs are known, only its reach: name its URDF, or, in a course, ask for "
    "drawn-up legs (legs: {})"
)


def four(**legs: Any) -> dict[str, Any]:
    """The course, with these legs where any are given."""
    return {**FOUR, "robot": {**FOUR["robot"], **({"legs": legs} if legs else {})}}


@pytest.fixture(scope="module")
def plan() -> Motion:
    """A plan for four limbs that nobody gave legs."""
    found = plan_course(build_course(spec_from(FOUR)), TwoStage()).solution
    assert found is not None
    return found


def test_limbs_alone_have_no_legs() -> None:
    robot = build_course(spec_from(FOUR)).robot
    assert robot.joint_names == ()
    for ask in (lambda: robot.legs, lambda: Kinematics(robot)):
        with pytest.raises(InvalidInput) as error:
            ask()
        assert str(error.value) == UNKNOWN


def test_a_plan_of_limbs_alone_is_accepted_as_far_as_checked(plan: Motion) -> None:
    report = check_plan(plan, joints=True)
    assert report.accepted
    assert {report.group(name).message for name in WHOLE_BODY} == {UNKNOWN}
    assert list(report.unchecked) == list(WHOLE_BODY)
    assert plan.hindrance(()) == UNKNOWN


def test_legs_are_drawn_up_where_a_file_asks_for_them(tmp_path: Path) -> None:
    servo = Servo(torque_nm=12.0, velocity_rad_s=3.0)
    course = build_course(spec_from(four(torque_nm=12.0, velocity_rad_s=3.0)))
    assert course.robot.drawn == servo
    assert len(course.robot.joint_names) == 16
    kinematics = Kinematics(course.robot)
    assert set(kinematics.torque_nm) == {12.0}
    assert set(kinematics.velocity_rad_s) == {3.0}
    assert Problem.from_json(json.loads(json.dumps(course.to_json()))).robot.drawn == servo
    found = plan_course(course, TwoStage()).solution
    assert found is not None
    report = check_plan(found, joints=True)
    assert set(report.unchecked).isdisjoint(WHOLE_BODY)
    write_motion(tmp_path / "plan.json", found, report)
    assert read_motion(tmp_path / "plan.json")[0].problem.robot.drawn == servo


@pytest.mark.parametrize(
    ("legs", "limb", "message"),
    [
        ({"torque_nm": -1}, {}, "robot.legs.torque_nm"),
        ({"torque": 12}, {}, "robot.legs.torque"),
        (
            {"lower_rad": [0.0, 2.0, 0.0, 0.0]},
            {},
            "robot.legs.lower_rad[1]",
        ),
        (
            {"torque_nm": 12},
            {"sole_m": [[0, 0], [0.1, 0], [0, 0.1]]},
            "robot.legs",
        ),
    ],
)
def test_legs_that_make_no_sense_are_refused(
    legs: dict[str, Any], limb: dict[str, Any], message: str
) -> None:
    data = four(**legs)
    data["robot"]["limbs"] = {
        **data["robot"]["limbs"],
        "LF": {**FOUR["robot"]["limbs"]["LF"], **limb},
    }
    with refuses(message):
        spec_from(data)


def test_the_hexapod_is_its_limbs_in_files_and_its_urdf_ships() -> None:
    course = read_course("walls")
    assert set(course.to_json()["robot"]) == {"name", "mass_kg", "limbs"}
    assert Problem.from_json(course.to_json()).robot.drawn == Servo()
    heavy = replace(hexapod(), mass_kg=14.0)
    assert Problem.from_json(replace(course, robot=heavy).to_json()).robot.drawn == Servo()
    assert Robot(name="hexapod", mass_kg=10.0, limbs=hexapod().limbs[:4]).drawn is None
    from stancekit.configs import config_path

    assert config_path("robots/hexapod.urdf").read_text(encoding="utf-8") == drawn_urdf(hexapod())


def test_a_plan_of_unknown_legs_has_no_joints(plan: Motion) -> None:
    report = check_plan(replace(plan, joints_rad=np.zeros((plan.problem.frames, 16))))
    assert not report.accepted
    assert_names(report.message, "joints_rad", "(3, 16)")


def test_a_robot_pickles_as_its_source_and_never_as_a_solvers_objects() -> None:
    """Text, angles and corners go over; what pinocchio has made of them is made again where it is
    asked for.
    """
    own = model_of(quadruped())
    for robot in (robot_of(own), hexapod(), build_course(spec_from(FOUR)).robot):
        names = robot.joint_names
        if names:
            assert Kinematics(robot).joints == names  # parsed and built
        content = pickle.dumps(robot)
        assert b"pinocchio" not in content
        assert b"ElementTree" not in content
        again = pickle.loads(content)
        assert (again.joint_names, again.identity) == (names, robot.identity)
        assert again.digest == robot.digest
        if names:
            assert Kinematics(again).joints == names


def test_a_robot_over_other_sets_is_the_same_robot() -> None:
    robot = contact_robot(model := model_of(quadruped()), workspaces_of(model))
    outer = robot.sets("outer")
    assert (sets_of(outer), sets_of(outer.sets("inner"))) == ("outer", "inner")
    assert outer.identity == robot.identity
    with refuses("robot"):
        hexapod().sets("outer")


def test_the_key_alone_asks_for_legs() -> None:
    """``legs:`` with nothing behind it, which YAML reads as null."""
    keys = four()
    keys["robot"] = {**keys["robot"], "legs": None}
    assert build_course(spec_from(keys)).robot.drawn == Servo()
