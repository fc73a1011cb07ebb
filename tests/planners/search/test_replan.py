"""Receding horizon: the coming frames from where the robot stands, by nothing but the arguments."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.pieces import Standing, course_window, joined
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.refusals import refuses


@pytest.fixture(scope="module")
def course():
    return read_course("walls", frames=6)


def same(one, other):
    return (one.status, one.effort.solves) == (other.status, other.effort.solves) and all(
        np.array_equal(getattr(one.solution, name), getattr(other.solution, name))
        for name in ("com_m", "rotation_rad", "toes_m", "forces_n", "choice")
    )


def test_windows_planned_one_after_the_other_are_one_plan_of_the_course(course):
    state, plans, frame = None, [], 0
    while frame < course.frames - 1:
        outcome = replan(state, course, frame=frame, horizon=2)
        assert outcome.status is Status.FEASIBLE
        assert outcome.solution.problem.frames == 3 - (frame + 2 > course.frames - 1)
        if state is not None:
            np.testing.assert_array_equal(
                outcome.solution.toes_m[: len(state.toes_m)], state.toes_m
            )
            assert np.linalg.norm(outcome.solution.com_m[0] - state.com_m) <= 1.001e-4
        plans.append(outcome.solution)
        state, frame = (
            Standing.at_end(outcome.solution),
            frame + outcome.solution.problem.frames - 1,
        )
    walk = joined(course, plans)
    assert walk.problem.frames == course.frames
    assert check_plan(walk).accepted


def test_it_is_the_planner_on_the_window_and_without_a_horizon_on_all_that_is_left(course):
    assert same(replan(None, course), TwoStage().solve(course_window(course, 0, course.frames - 1)))
    state = Standing.at_end(replan(None, course, horizon=2).solution)
    window = course_window(course, 2, course.frames - 1, state)
    assert same(replan(state, course, frame=2), TwoStage().solve(window))


def test_the_answer_depends_on_the_arguments_alone(course, climb, rough):
    state = Standing.at_end(replan(None, course, horizon=2).solution)
    planner = TwoStage(programs=Programs())
    first, kept = (
        replan(state, course, frame=2, horizon=2, planner=some) for some in (None, planner)
    )
    assert same(first, kept)
    for other in (climb(5, regions=2), rough(2), read_course("icy-walls", frames=3)):
        planner.solve(other)
        replan(None, other, planner=planner)
    for frame in (3, 2):
        replan(state, course, frame=frame, horizon=1, planner=planner)
    for some in (None, planner):
        assert same(first, replan(state, course, frame=2, horizon=2, planner=some))


def test_a_policy_is_asked_for_the_window_and_its_planner_answers(course):
    seen = []

    def policy(window):
        seen.append(window)
        return TwoStage(projection="fix-toes")

    outcome = replan(None, course, horizon=1, planner=policy)
    assert [window.frames for window in seen] == [2]
    assert outcome.solution.provenance["projection"] == "fix-toes"


def test_with_shares_it_keeps_a_reserve_of_friction_where_there_is_one(course):
    outcome = replan(None, course, horizon=1, shares=(0.01, 0.9, 1.0))
    assert outcome.solution.provenance["friction_share"] == 0.9
    assert check_plan(outcome.solution).accepted
    window = slippery(course_window(course, 0, 1), 0.9)
    np.testing.assert_array_equal(outcome.solution.com_m, TwoStage().solve(window).solution.com_m)


def test_a_frame_that_cannot_be_held_has_no_plan_and_a_proof(course):
    state = Standing.at_end(replan(None, course, horizon=2).solution)
    outcome = replan(state, slippery(course, 0.2), frame=2, horizon=1)
    assert (outcome.status, outcome.solution) == (Status.INFEASIBLE, None)


def test_frames_that_there_are_not_are_refused(course):
    with refuses("window"):
        replan(None, course, frame=1, horizon=2)
    state = Standing.at_end(replan(None, course, horizon=1).solution)
    with refuses("window"):
        replan(state, course, frame=6)
    with refuses("window"):
        replan(state, course, frame=2, horizon=-1)


def test_the_coming_frames_are_bent_to_what_joints_have_and_it_says_so(course):
    """Windows of two steps, each from where the one before ended, where the second asks for more
    than 10 Nm.
    """
    pytest.importorskip("pinocchio")
    limits, state, bent = WholeBodyLimits(torque_nm=10.0), None, 0
    for frame in (0, 2):
        plain = replan(state, course, frame=frame, horizon=2)
        outcome = replan(state, course, frame=frame, horizon=2, limits=limits)
        assert outcome.status is Status.FEASIBLE, outcome.message
        assert set(outcome.details) - set(plain.details) == {
            "torque_steps",
            "torque_nm_before",
            "torque_nm",
            "torque_share_before",
            "torque_share",
            "depth_m_before",
            "depth_m",
        }
        assert outcome.details["torque_nm"] <= 10.0
        assert outcome.details["depth_m"] <= 0.001
        bent += outcome.details["torque_nm_before"] > 10.0
        report = check_plan(outcome.solution, joints=True)
        assert report.accepted
        assert report.checked[-1] == "motion"
        if state is not None:
            np.testing.assert_allclose(
                outcome.solution.toes_m[: len(state.toes_m)], state.toes_m, atol=1e-9
            )
            assert np.linalg.norm(outcome.solution.com_m[0] - state.com_m) <= 1.001e-4
        state = Standing.at_end(outcome.solution)
    assert bent >= 1
