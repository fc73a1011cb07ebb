"""Leaps on the robot's own body: what the judge measures, against momentum worked out anew, and what
it refuses.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit import Motion
from stancekit.configs import config_path
from stancekit.planners.answer.plan import LEAP_BODY
from stancekit.planners.formats.motion_file import check_file, read_motion, write_motion
from stancekit.planners.formats.question_file import read_leap
from stancekit.planners.leap.bend import joint_rows, legged_numbers, point_of as point_of_plan
from stancekit.planners.leap.finder import find_leap
from stancekit.planners.leap.numbers import LeapGiven
from stancekit.planners.leap.scp import reserved
from stancekit.planners.motion.leap_motion import LeapBody
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import LeapBodyMeasurements, check_leap, with_body
from tests.refusals import assert_names, refuses

pin = pytest.importorskip("pinocchio")
FILE = Path(__file__).parents[2] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def plan() -> Motion:
    found = read_motion(FILE)[0]
    assert found is not None
    return found


@pytest.fixture(scope="module")
def measured(plan: Motion) -> LeapBodyMeasurements:
    return LeapBodyMeasurements(LeapBody(plan))


def test_a_leap_that_was_bent_is_accepted_with_its_legs_and_says_so_of_every_group():
    check = check_file(FILE)
    assert check.accepted
    assert check.report.unchecked == ()
    assert {name: check.report.group(name).verdict for name in LEAP_BODY} == dict.fromkeys(
        LEAP_BODY, "holds"
    )


def test_the_whole_robot_keeps_its_angular_momentum_in_the_air(measured: LeapBodyMeasurements):
    body = measured.leap_body
    known, data = measured.kinematics.known, measured.kinematics.known.createData()
    states, velocity = measured._states
    air = np.flatnonzero(~body.contact.any(axis=1))[2:-3]
    assert len(air) > 20
    mass = body.plan.problem.robot.mass_kg
    for k in air:
        middle = pin.integrate(known, states[k], 0.5 * measured.step_s * velocity[k])
        spins = pin.computeCentroidalMomentum(known, data, middle, velocity[k]).angular
        wanted = mass * 0.5 * (body.momentum_m2_s[k] + body.momentum_m2_s[k + 1])
        np.testing.assert_allclose(spins, wanted, atol=0.02)


def test_rows_of_joints_say_at_the_plan_what_was_measured_there(measured: LeapBodyMeasurements):
    plan = measured.leap_body.plan
    numbers = legged_numbers(measured)
    scaled = reserved(numbers, plan.choice, 0.8)
    given = LeapGiven(scaled, loaded_numbers=numbers, at=point_of_plan(numbers, plan))
    rows = joint_rows(measured, given)
    ahead, back = rows.over(given)
    share = np.maximum(ahead, back).max() + rows.share
    assert share == pytest.approx(measured.line.max(), abs=0.25)


def test_a_leap_twice_as_fast_is_refused_by_its_joints(plan: Motion):
    leap = replace(plan.problem, timings_s=(tuple(0.5 * s for s in plan.problem.timings_s[0]),))
    fast = replace(plan, problem=leap, velocity_m_s=2.0 * plan.velocity_m_s)
    groups = {g.name: g for g in LeapBodyMeasurements(LeapBody(fast)).groups(bodies=False)}
    assert groups["joint_speed"].verdict == "violated"
    assert groups["joint_speed"].where


def test_a_leap_of_limbs_alone_is_not_judged_with_legs_and_says_so():
    report = check_leap(find_leap(leap_class("leap-given").draw(np.random.default_rng(0))).solution)
    assert report.unchecked == LEAP_BODY
    assert report.accepted
    assert with_body(report).unchecked == LEAP_BODY


def test_a_plan_keeps_how_legs_are_drawn_up_in_its_file(plan: Motion, tmp_path):
    write_motion(tmp_path / "again.json", plan, check_leap(plan))
    again, _ = read_motion(tmp_path / "again.json")
    np.testing.assert_array_equal(again.gather, plan.gather)
    np.testing.assert_array_equal(again.legs_turn_rad, plan.legs_turn_rad)
    bad = check_leap(replace(plan, gather=np.array([0.0, 0.5])))
    assert not bad.accepted
    assert_names(bad.message, "gather")


def test_legs_that_nobody_knows_turn_nothing():
    plan = find_leap(leap_class("leap-given").draw(np.random.default_rng(0))).solution
    swung = np.zeros((plan.problem.intervals, 3))
    assert check_leap(replace(plan, legs_turn_rad=None)).accepted
    report = check_leap(replace(plan, legs_turn_rad=swung))
    assert not report.accepted
    assert_names(report.message, "legs_turn_rad")


@pytest.mark.parametrize(
    ("was", "groups"),
    [('velocity="12"', ("joint_speed", "torque")), ('effort="80"', ("torque",))],
)
def test_joints_without_limits_are_not_checked_by_them(plan: Motion, was: str, groups, tmp_path):
    from stancekit.planners.robot.walker import leaping_robot

    text = config_path("robots/anymal.urdf").read_text()
    (tmp_path / "other.urdf").write_text(text.replace(was, was.split('"')[0] + '"0"'))
    model = leaping_robot(tmp_path / "other.urdf").own_model()
    robot = replace(plan.problem.robot, model=model)
    report = check_leap(replace(plan, problem=replace(plan.problem, robot=robot)), body=True)
    assert report.unchecked == groups
    assert_names(report.group("torque").message, "limit")


def test_a_body_that_still_spins_after_its_leap_is_refused_whatever_spin_the_leap_allows(
    plan: Motion,
):
    leap, forces = plan.problem, np.array(plan.forces_n)
    more = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * [0.0, 0.0, 1.0]  # left and right, 1 N each
    forces[-1] += more
    step_s, toes = leap.timings_s[0][-1] / leap.phases[-1].intervals, plan.toes_m[leap.holds[-1]]
    gained = step_s * np.cross(toes, more).sum(axis=0)
    momentum, turn = np.array(plan.momentum_m2_s), np.array(plan.rotation_rad)
    momentum[-1] += gained / leap.robot.mass_kg
    turn[-1] += 0.5 * step_s * np.linalg.solve(leap.robot.inertia, gained)
    leap = replace(leap, limits=replace(leap.limits, momentum_m2_s=1e6))
    assert check_leap(replace(plan, problem=leap), body=True).accepted
    spun = replace(plan, problem=leap, forces_n=forces, momentum_m2_s=momentum, rotation_rad=turn)
    assert [group.name for group in check_leap(spun).refused] == ["momentum"]


def test_a_leap_of_microseconds_is_refused_in_words(plan: Motion):
    leap = replace(plan.problem, timings_s=((1e-6, 1e-6, 1e-6),))
    report = check_leap(replace(plan, problem=leap), body=True)
    assert not report.accepted
    assert report.unchecked == ()


def test_a_robot_without_limits_of_its_joints_is_refused(tmp_path):
    text = config_path("robots/anymal.urdf").read_text().replace('velocity="12"', 'velocity="0"')
    (tmp_path / "slow.urdf").write_text(text)
    with refuses():
        read_leap("leap-hop:0", tmp_path / "slow.urdf")


def test_another_robot_is_for_leaps_that_are_drawn():
    with refuses("robot"):
        read_leap(FILE, "anymal")
