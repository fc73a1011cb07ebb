"""`stancekit plan` and `verify` on a robot's own legs: one verdict, and what a file does not say is
told.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from stancekit import courses
from stancekit.cli.main import parse, run
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names

COURSE = """
name: flat
robot: dog.urdf
frames: 3
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.1, 0.0, 0.45]
terrain: {kind: flat, friction: 0.7}
"""


HEIGHTS = """
name: step
robot: dog.urdf
frames: 2
gait: wave
start_m: [0.0, 0.0, {0}]
goal_m: [0.1, 0.0, {0}]
body: {{com_radius_m: 0.005, first_radius_m: 0.005, tilt_limit_rad: 0.01}}
terrain: {{kind: flat, friction: 0.7}}
"""


def group(verdict, name):
    """A group of a report's JSON."""
    return next(each for each in verdict["groups"] if each["group"] == name)


@pytest.fixture
def call(stancekit):
    """``call("verify", "plan.json")`` in a folder with a course and its robot: exit code, output,
    errors.
    """
    Path("dog.urdf").write_text(quadruped())
    Path("flat.yaml").write_text(COURSE)

    return lambda *arguments: astuple(stancekit(*arguments))


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """The text of the plan's file over the course, planned once."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(COURSE)
    with contextlib.redirect_stdout(io.StringIO()):
        assert (
            run(parse(["plan", str(folder / "flat.yaml"), "--out", str(folder / "plan.json")])) == 0
        )
    return (folder / "plan.json").read_text()


def test_a_plan_has_joints_and_verify_says_the_same_of_its_file(call):
    code, out, err = call("plan", "flat.yaml", "--out", "plan.json")
    assert (code, err) == (0, "")
    assert "verifier: accepted as far as checked: bodies and motion are not; " in out
    assert "\njoints: checked; torque: checked; bodies, motion: NOT CHECKED (joints LF_HFE, " in out
    Path("dog.urdf").unlink()  # the plan's file is enough
    code, out, err = call("verify", "plan.json")
    assert (code, err) == (0, "")
    assert out.startswith("plan.json: accepted as far as checked: bodies and motion are not; ")
    assert "; joints: checked; torque: checked; bodies, motion: NOT CHECKED (joints LF_HFE, " in out
    code, out, err = call("verify", "plan.json", "--json")
    record = json.loads(out)
    assert record["report"]["checked"] == ["contacts", "joints", "torque"]
    assert group(record["report"], "torque")["figures"]["share"] < 1.0


@pytest.mark.parametrize(
    ("height_m", "code", "status"),
    [(0.5, 0, "feasible"), (0.58, 1, "undecided"), (0.7, 1, "infeasible")],
)
def test_plans_are_in_inner_sets_and_proofs_over_outer_ones(call, height_m, code, status):
    Path("step.yaml").write_text(HEIGHTS.format(height_m))
    ended, out, _ = call("plan", "step.yaml", "--json")
    record = json.loads(out)
    assert (ended, record["status"]) == (code, status)
    if status == "undecided":
        assert record["message"] == (
            "no plan in the inner sets of the legs, and no proof in the outer ones that there is none"
        )


def test_numbers_for_programs_have_the_joints(call):
    code, out, _ = call("plan", "flat.yaml", "--json")
    record = json.loads(out)
    assert code == 0
    assert np.array(record["plan"]["joints_rad"]).shape == (3, 12)
    joints, torque = (group(record["verdict"], name) for name in ("joints", "torque"))
    assert (joints["verdict"], torque["verdict"]) == ("holds", "holds")
    assert joints["figures"]["error_m"] < 1e-6


def test_a_robot_that_is_too_weak_has_a_plan_that_nobody_calls_accepted(call, monkeypatch):
    monkeypatch.setattr(courses, "ALTERNATIVES", courses.ALTERNATIVES[:1])  # as it is asked alone
    Path("dog.urdf").write_text(quadruped(effort=4.0))
    Path("flat.yaml").write_text(COURSE.replace("frames: 3", "frames: 2"))
    code, out, err = call("plan", "flat.yaml", "--out", "plan.json")
    assert code == 1
    assert " undecided " in out  # nothing is proved of other plans
    assert "feasible" not in out
    assert "accepted" not in out + err
    assert "verifier: rejected: torque: frame " in out
    assert "joints: checked; torque: failed;" in out
    code, out, err = call("verify", "plan.json")
    assert code == 1
    assert out.startswith("plan.json: rejected: torque: frame ")
    assert "joints: checked; torque: failed; " in out
    assert "another verdict" not in out


def test_a_torque_limit_that_the_file_does_not_say_is_not_checked(call):
    Path("dog.urdf").write_text(quadruped(effort=0.0))
    code, out, _ = call("plan", "flat.yaml", "--out", "plan.json")
    assert code == 0
    assert "joints: checked; torque: NOT CHECKED (joints LF_HAA, " in out
    assert "verifier: accepted as far as checked: torque, bodies and motion are not; " in out
    assert out.count("torque: NOT CHECKED") == 1
    assert out.count("RH_KFE: no torque limit or no velocity limit") == 1  # why it cannot be run
    code, out, _ = call("verify", "plan.json")
    assert code == 0
    assert "torque: NOT CHECKED (joints LF_HAA, " in out


def test_verify_refuses_a_plan_for_another_robot_than_the_one_that_is_named(call, refusal, plan):
    Path("plan.json").write_text(plan)
    assert call("verify", "plan.json", "--robot", "dog.urdf")[0] == 0
    Path("cat.urdf").write_text(quadruped(effort=41.0).replace('name="quadruped"', 'name="cat"'))
    assert refusal("verify", "plan.json", "--robot", "cat.urdf") == (
        "plan.json: expected a plan for the robot cat as its file is, got one for quadruped with "
        "legs or numbers of its own"
    )
    assert_names(refusal("verify", "flat.yaml", "--robot", "cat.urdf"), "flat.yaml", "motion")


@pytest.mark.parametrize(
    ("change", "other"),
    [
        (("frames: 3", "frames: 4"), ""),  # how many there are is the plan's
        (("friction: 0.7", "friction: 0.6"), "terrain[0].friction: expected 0.6, got 0.7"),
        (("0.0, 0.45]", "0.0, 0.46]"), "com_nominal_m[1][2]: expected "),
        (
            ("start_m: [0.0", "start_m: [0.02"),
            "terrain[0].vertices_m[0][0]: expected -0.58, got -0.6",
        ),
        (("dog.urdf", "cat.urdf"), "robot.model.digest: expected "),
    ],
)
def test_a_plan_has_to_be_of_the_course_that_is_named(call, plan, change, other):
    Path("cat.urdf").write_text(quadruped(effort=41.0))
    Path("plan.json").write_text(plan)
    Path("flat.yaml").write_text(COURSE.replace(*change))
    code, _, err = call("verify", "plan.json", "--course", "flat.yaml")
    if other:
        assert (code, err.count("\n")) == (2, 1)
        assert "plan.json: expected a plan of that course, got one of another: " in err
        assert other in err
    else:
        assert (code, err) == (0, "")


def test_legs_that_are_drawn_up_are_checked_by_plan_as_by_verify(call):
    whole = "joints: checked; torque: checked; bodies: checked; motion: checked"
    code, out, err = call("plan", "stairs", "--frames", 2, "--out", "plan.json")
    assert (code, err) == (0, "")
    assert whole in out
    header = json.loads(Path("plan.json").read_text())
    assert len(header["columns"]["joints"]) == 24
    assert header["verdict"]["checked"] == ["contacts", "joints", "torque", "bodies", "motion"]
    assert group(header["verdict"], "motion")["figures"]["postures"] > 10
    assert whole in call("verify", "plan.json")[1]


def test_without_pinocchio_the_extra_is_named(refusal, plan, monkeypatch):
    Path("plan.json").write_text(plan)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    said = refusal("verify", "plan.json")
    assert said.startswith("plan.json: question: robot quadruped: ")
    assert said.endswith('[robots]"')


def test_a_climb_is_planned_within_the_torque_that_is_asked_for_and_verified_within_it(call):
    code, out, err = call("plan", "walls", "--frames", 3, "--torque-nm", 10, "--out", "plan.json")
    assert (code, err) == (0, "")
    message = re.search(r"^torque: ([\d.]+) → ([\d.]+) Nm in (\d) steps?$", out, re.MULTILINE)
    before, after, steps = map(float, message.groups())
    assert before > 10.0
    assert after <= 9.0
    assert 1 <= steps <= 6
    assert "joints: checked; torque: checked" in out
    assert "joints: checked; torque: checked" in call("verify", "plan.json")[1]


def test_a_climb_that_asks_too_much_of_its_joints_is_undecided_in_both_commands(call, monkeypatch):
    monkeypatch.setattr(courses, "ALTERNATIVES", courses.ALTERNATIVES[:1])  # as it is asked alone
    code, out, _ = call(
        "plan",
        "walls",
        "--frames",
        2,
        "--torque-nm",
        1,
        "--json",
        "--out",
        "plan.json",
    )
    assert code == 1
    record = json.loads(out)
    assert record["status"] == "undecided"
    assert re.match(
        r"torque: frame \d, limb \w\w: [\d.]+ Nm in a joint, where \w\w_\w+ has 1",
        record["message"],
    )
    assert record["details"]["torque_nm"] < record["details"]["torque_nm_before"]
    code, out, _ = call("verify", "plan.json")
    assert code == 1
    assert re.search(
        r"rejected: torque: frame \d, limb \w\w: [\d.]+ Nm in a joint, where \w\w_\w+ has 1;", out
    )


def test_torques_that_make_no_sense_are_refused(refusal):
    message = "--torque-nm: expected a number above 0, got -1"
    assert refusal("plan", "walls", "--torque-nm", -1) == message
    message = "--torque-share: expected a number in (0, 1], got 2"
    assert refusal("plan", "walls", "--torque-share", 2) == message
