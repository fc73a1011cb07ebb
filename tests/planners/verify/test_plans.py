"""The verifier of plans: accepts a walk in closed form, and names the group, frame and limb of
every single fault.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import WHOLE_BODY
from stancekit.planners.errors import InvalidInput
from stancekit.planners.verify import BETWEEN, PLAN_GROUPS, check_plan
from stancekit.planners.verify.stances import Schedule
from tests.refusals import assert_names


def worst_of(report):
    return max(report.groups, key=lambda g: g.worst)


def changed(plan, name, at, by):
    """The plan with something added to one entry of an array."""
    array = np.array(getattr(plan, name))
    array[at] += by
    return replace(plan, **{name: array})


def foothold_of(plan, frame, limb):
    return next(
        p for p, put in enumerate(plan.problem.footholds) if (put.frame, put.limb) == (frame, limb)
    )


def row_of(plan, frame, limb, *, carries):
    course = plan.problem
    i = course.robot.limb_names.index(limb)
    return next(
        r for r, s in enumerate(course.stances) if s.frame == frame and (i in s.limbs) == carries
    ), i


def test_a_schedule_says_who_carries_on_which_foothold(walk):
    course = walk(5, "tripod").problem
    table = [
        np.arange(len(course.footholds)) == course.holds[stance.frame, limb]
        for stance in course.stances
        for limb in stance.limbs
    ]
    np.testing.assert_array_equal(Schedule.of_course(course).on_foothold, table)


@pytest.mark.parametrize(("gait", "ways"), [("tripod", 4), ("wave", 4), ("shift", 4), ("all", 0)])
def test_a_walk_in_closed_form_is_accepted(gait, ways, walk):
    report = check_plan(walk(5, gait))
    assert report.accepted
    assert bool(report.hindrance) == (not ways)
    assert report.worst < 1e-12
    assert tuple(group.name for group in report.groups) == (*PLAN_GROUPS, *WHOLE_BODY)
    assert report.figures["proved"] == ways
    assert report.figures["between"] <= 1e-12
    assert report.figures["goal_m"] == pytest.approx(0.1)
    assert report.figures["linearisation_m"] == 0.0


def test_points_between_frames_may_be_left_to_the_proof(walk):
    report = check_plan(walk(), between=False)
    assert report.accepted
    assert report.figures["proved"] == 4
    assert np.isnan(report.figures["between"])


def test_a_single_frame_is_a_plan(walk):
    assert check_plan(walk(1, "tripod")).accepted


FAULTS = {
    "patch": ("toes_m", "put", [0.0, 0.0, 0.01], 0.01),
    "com_step": ("com_m", 2, [0.025, 0.0, 0.0], 0.005),
    "progress": ("com_m", 2, [-0.015, 0.0, 0.0], 0.005),
    "rotation_step": ("rotation_rad", 2, [0.0, 0.0, 0.2], 0.05),
    "tilt": ("rotation_rad", slice(None), [0.3, 0.0, 0.0], 0.3 - 0.2618),
    "com": ("com_m", slice(None), [0.0, 0.05, 0.0], 0.03),
}


@pytest.mark.parametrize("group", FAULTS)
def test_a_fault_of_the_body_is_measured_in_its_own_group(group, walk):
    plan = walk()
    name, at, by, off = FAULTS[group]
    bad = changed(plan, name, foothold_of(plan, 2, "RM") if at == "put" else at, by)
    report = check_plan(bad)
    assert not report.accepted
    found = next(g for g in report.groups if g.name == group)
    assert found.value == pytest.approx(off, rel=1e-6)
    assert found.frame in ((0, 2) if group in ("tilt", "com", "patch") else (2,))


@pytest.mark.parametrize(("limb", "frame"), [("RF", 1), ("LR", 2), ("RM", 4)])
def test_a_toe_off_its_patch_is_named_with_frame_and_limb(limb, frame, walk):
    plan = walk()
    bad = changed(plan, "toes_m", (foothold_of(plan, frame, limb), 2), -0.004)
    found = next(g for g in check_plan(bad).groups if g.name == "patch")
    assert (found.frame, found.where) == (frame, limb)
    assert found.value == pytest.approx(0.004)


def test_a_long_step_of_a_toe_is_named_with_frame_and_limb(walk):
    plan = walk()
    limits = replace(plan.problem.steps, toe_m=0.06)
    plan = replace(plan, problem=replace(plan.problem, steps=limits))
    assert check_plan(plan).accepted  # two steps of the body, one after the other: 0.06 m
    bad = changed(plan, "toes_m", (foothold_of(plan, 3, "LM"), 0), 0.03)
    found = next(g for g in check_plan(bad).groups if g.name == "toe_step")
    assert (found.frame, found.where) == (3, "LM")
    assert found.value == pytest.approx(0.03)


def test_a_toe_that_stood_elsewhere_is_refused(walk):
    plan = walk()
    report = check_plan(changed(plan, "toes_m", (foothold_of(plan, 0, "LF"), 1), 0.002))
    found = next(g for g in report.groups if g.name == "start")
    assert (found.frame, found.where) == (0, "LF")
    assert found.value == pytest.approx(0.002)


def test_a_limb_out_of_reach_is_named_also_where_it_does_not_carry(walk):
    plan = walk()
    last = plan.problem.frames - 1
    plan = replace(
        plan, problem=replace(plan.problem, next_lift=())
    )  # who moved last carries nowhere
    plan = replace(plan, forces_n=plan.forces_n[: len(plan.problem.stances)])
    assert check_plan(plan).accepted
    limb = plan.problem.lifts[last][0]
    patch = plan.problem.footholds[foothold_of(plan, last, limb)]
    wide = replace(
        patch.candidates[1],
        vertices_m=3.0 * (patch.candidates[1].vertices_m - patch.candidates[1].centre_m)
        + patch.candidates[1].centre_m,
    )
    put = tuple(
        replace(p, candidates=(wide, wide)) if p is patch else p for p in plan.problem.footholds
    )
    steps = replace(plan.problem.steps, toe_m=1.0)
    plan = replace(plan, problem=replace(plan.problem, footholds=put, steps=steps))
    report = check_plan(changed(plan, "toes_m", (foothold_of(plan, last, limb), 0), 0.29))
    found = worst_of(report)
    assert (found.name, found.frame, found.where) == ("reach", last, limb)


@pytest.mark.parametrize(
    ("group", "by"), [("friction", [40.0, 0.0, 0.0]), ("force_bounds", [0.0, 0.0, -60.0])]
)
def test_a_bad_force_is_named_with_frame_and_limb(group, by, walk):
    plan = walk()
    row, i = row_of(plan, 3, "RR", carries=True)
    found = next(
        g for g in check_plan(changed(plan, "forces_n", (row, i), by)).groups if g.name == group
    )
    assert (found.frame, found.limb) == (3, "RR")
    assert found.value > 5.0


def test_a_force_on_a_limb_in_the_air_is_refused(walk):
    plan = walk()
    row, i = row_of(plan, 2, "LM", carries=False)
    found = worst_of(check_plan(changed(plan, "forces_n", (row, i, 2), 1.0)))
    assert (found.name, found.frame, found.where) == ("idle_force", 2, "LM")
    assert found.value == pytest.approx(1.0)


def test_a_body_that_leaves_its_tripod_loses_its_moment_balance(walk):
    report = check_plan(changed(walk(), "com_m", (2, 1), 0.01))
    found = worst_of(report)
    assert (found.name, found.frame) == ("moment_balance", 2)
    assert found.value == pytest.approx(0.01 * 98.1, rel=1e-9)
    way = BETWEEN[-1] * found.worst  # the way there is as bad as its end
    assert report.figures["between"] == pytest.approx(way, rel=1e-6)


@pytest.mark.parametrize("chosen", [-1, 2, 7])
def test_a_candidate_that_there_is_not_is_refused(chosen, walk):
    plan = walk()
    choice = np.array(plan.choice)
    choice[foothold_of(plan, 1, "RF")] = chosen
    report = check_plan(replace(plan, choice=choice))
    assert not report.accepted
    assert_names(report.message, "choice", "frame 1", "limb RF", str(chosen))
    assert (worst_of(report).frame, worst_of(report).limb) == (1, "RF")


def test_the_other_candidate_is_not_where_the_toe_is(walk):
    plan = walk()
    choice = np.array(plan.choice)
    choice[foothold_of(plan, 1, "RF")] = 0
    report = check_plan(replace(plan, choice=choice))
    assert next(g for g in report.groups if g.name == "patch").value == pytest.approx(0.1)


@pytest.mark.parametrize("name", ["com_m", "rotation_rad", "toes_m", "forces_n", "choice"])
def test_a_plan_of_another_shape_is_refused_and_not_raised(name, walk):
    plan = walk()
    report = check_plan(replace(plan, **{name: getattr(plan, name)[:-1]}))
    assert_names(report.message, name)
    assert not report.accepted


@pytest.mark.parametrize("name", ["com_m", "rotation_rad", "toes_m", "forces_n"])
@pytest.mark.parametrize("number", [np.nan, np.inf, 1e300])
def test_a_number_that_is_none_is_refused_and_not_raised(name, number, walk):
    report = check_plan(changed(walk(), name, 1, number))
    assert not report.accepted
    assert report.to_json()["accepted"] is False


def test_the_linearised_rotation_is_reported_against_the_exact_one(walk):
    plan = walk()
    theta = np.array([0.05, -0.1, 0.12])
    report = check_plan(replace(plan, rotation_rad=np.tile(theta, (5, 1))))
    mounts = np.array([limb.shoulder_m for limb in plan.problem.robot.limbs])
    exact = Rotation.from_rotvec(theta).apply(mounts)
    assert report.figures["linearisation_m"] == pytest.approx(
        np.linalg.norm(exact - mounts - np.cross(theta, mounts), axis=1).max()
    )
    beyond = [
        np.linalg.norm(plan.toes_at(k) - plan.com_m[k] - exact, axis=1)
        - plan.problem.robot.limbs[0].reach_m
        for k in range(5)
    ]
    assert report.figures["exact_reach_m"] == pytest.approx(max(0.0, np.max(beyond)))


@given(st.integers(0, 10_000))
def test_no_change_of_a_force_or_of_level_com_goes_unseen(walk, seed):
    """With three toes the balances fix every vertical force and where the COM is above them."""
    rng = np.random.default_rng(seed)
    plan = walk()
    if rng.random() < 0.5:
        row = rng.integers(len(plan.forces_n))
        limbs = plan.problem.stances[row].limbs
        at, name = (row, rng.choice(limbs), rng.integers(3)), "forces_n"
    else:
        at, name = (rng.integers(5), rng.integers(2)), "com_m"
    size = 10.0 ** rng.uniform(-3.0, 1.0) * rng.choice([-1.0, 1.0])
    report = check_plan(changed(plan, name, at, size))
    assert not report.accepted
    assert worst_of(report).frame == (
        plan.problem.stances[at[0]].frame if name == "forces_n" else at[0]
    )


def test_joints_that_cannot_be_asked_are_said_to_be_unchecked(walk, monkeypatch):
    def missing():
        raise InvalidInput("pinocchio is missing")

    monkeypatch.setattr("stancekit.planners.robot.kinematics.pinocchio", missing)
    report = check_plan(walk(2), joints=True)
    assert report.accepted
    joints = report.group("joints")
    assert (joints.verdict, joints.message) == ("not checked", "pinocchio is missing")


def test_joints_are_a_section_of_their_own(walk):
    pytest.importorskip("pinocchio")
    plan = walk(2)
    report = check_plan(plan, joints=True)
    assert report.group("joints").verdict == "holds"
    assert report.group("joints").figures["error_m"] < 1e-3
    assert report.group("torque").verdict == "holds"
    assert 0.0 < report.group("torque").figures["share"] < 1.0
    assert report.group("bodies").verdict == "holds"
    assert report.checked == ("contacts", "joints", "torque", "bodies")
    assert check_plan(plan).checked == ("contacts",)
    heavy = check_plan(replace(plan, forces_n=30.0 * plan.forces_n), joints=True)
    assert heavy.group("joints").verdict == "holds"
    assert heavy.group("torque").verdict == "violated"
    assert_names(heavy.group("torque").message, "Nm")
    assert (
        heavy.group("torque").to_json()["figures"]["worst"]["limb"] in plan.problem.robot.limb_names
    )


def test_a_limb_that_stays_but_stands_elsewhere_is_refused_with_its_frame(walk):
    """A forged schedule: who is put down at frame 2 is said to stay."""
    plan = walk(5, "tripod")
    course = replace(plan.problem)
    stays, *others = course.lifts[2]
    vars(course)["lifts"] = (*course.lifts[:2], tuple(others), *course.lifts[3:])
    (group,) = (
        each for each in check_plan(replace(plan, problem=course)).groups if each.name == "schedule"
    )
    assert (group.worst, group.frame, group.where) == (np.inf, 2, stays)
