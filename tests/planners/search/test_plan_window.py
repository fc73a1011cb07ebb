"""A course planned window by window: every window begins where the last one ended, and the walk is
a plan again.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.pieces import (
    STANDING_M,
    Standing,
    _one,
    beginning,
    course_window,
    joined,
    one_at_a_time,
    turning_on,
)
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.refusals import refuses


@pytest.fixture(scope="module")
def planner():
    return TwoStage()


@pytest.fixture(scope="module")
def course():
    return read_course("walls", frames=5)


@pytest.fixture(scope="module")
def plan(planner, course):
    outcome = planner.solve(course)
    assert outcome.status is Status.FEASIBLE
    return outcome.solution


def walked(planner, course, horizon):
    """The plans of all windows, the first of frame 0 alone."""
    plans = [planner.solve(course_window(course, 0, 0)).solution]
    for first in range(0, course.frames - 1, horizon):
        last = min(first + horizon, course.frames - 1)
        plans.append(
            planner.solve(course_window(course, first, last, Standing.at_end(plans[-1]))).solution
        )
    return plans


def test_the_window_of_all_frames_is_the_course(course):
    assert json.dumps(course_window(course, 0, 4).to_json()) == json.dumps(course.to_json())


@pytest.mark.parametrize("horizon", [1, 2, 3])
def test_windows_join_to_a_walk_that_the_verifier_accepts(planner, course, horizon):
    plans = walked(planner, course, horizon)
    walk = joined(course, plans)
    report = check_plan(walk)
    assert report.accepted, report.message
    assert walk.problem.frames == course.frames
    np.testing.assert_array_equal(walk.com_m[-1], plans[-1].com_m[-1])
    for before, after in pairwise(plans):
        assert np.linalg.norm(after.com_m[0] - before.com_m[-1]) <= STANDING_M + 1e-9
        np.testing.assert_allclose(
            after.toes_at(0), before.toes_at(before.problem.frames - 1), atol=1e-9
        )


def test_a_body_turns_on_from_how_it_stands_and_steps_from_where_it_may_be(course, plan):
    standing, most = np.array([0.0, 0.0, 0.3]), plan.problem.steps.rotation_rad
    turned = turning_on(plan, standing).rotation_rad
    np.testing.assert_array_equal(turned[0], standing)
    assert (np.linalg.norm(np.diff(turned, axis=0), axis=1) < most).all()
    assert np.linalg.norm(turned[-1] - plan.rotation_rad[-1]) < 1e-9
    begun, seen = beginning(plan, 1), list[Problem]()
    fast = replace(course, steps=replace(course.steps, progress_m=course.steps.com_m))
    for each in (course, fast):
        _one(each, 1, 3, [begun], lambda window, *_: seen.append(window), np.inf)
    assert all(window.steps.com_m + STANDING_M <= course.steps.com_m for window in seen)
    alone = course_window(course, 1, 3, Standing.at_end(begun))  # what is proved of it is proved
    assert alone.steps.com_m == course.steps.com_m


def test_a_walk_that_stops_early_is_a_plan_of_the_beginning(planner, course):
    walk = joined(course, walked(planner, course, 2)[:2])
    assert walk.problem.frames == 3
    assert check_plan(walk).accepted
    assert {stance.limbs for stance in walk.problem.stances if stance.frame == 2} == {
        stance.limbs for stance in course.stances if stance.frame == 2
    }


def test_one_plan_joined_is_itself(course, plan):
    again = joined(course, [plan])
    for name in ("com_m", "rotation_rad", "toes_m", "choice", "forces_n"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name))


def test_windows_that_do_not_fit_together_are_refused_by_the_verifier(planner, course):
    plans = walked(planner, course, 2)
    report = check_plan(
        joined(course, [plans[0], plans[2]])
    )  # as if it had leapt over the first window
    assert not report.accepted
    assert report.groups


def test_a_window_keeps_schedule_placements_and_modes(course, plan):
    here = Standing(
        com_m=plan.com_m[1],
        rotation_rad=plan.rotation_rad[1],
        toes_m=plan.toes_at(1),
        patches=tuple(course.patch(int(i), plan.choice) for i in course.holds[1]),
    )
    window = course_window(course, 1, 3, here)
    assert window.lifts == ((), course.lifts[2], course.lifts[3])
    assert window.next_lift == course.lifts[4]
    assert window.modes == course.modes[1:4]
    np.testing.assert_array_equal(window.com_nominal_m[1:], course.com_nominal_m[2:4])
    np.testing.assert_array_equal(window.goal_m, course.com_nominal_m[3])
    ours = [(p.frame, p.limb, id(p.candidates)) for p in window.footholds if p.frame]
    assert ours == [
        (p.frame - 1, p.limb, id(p.candidates)) for p in course.footholds if 1 < p.frame <= 3
    ]
    for foothold, toe in zip(window.footholds, plan.toes_at(1), strict=False):
        np.testing.assert_array_equal(foothold.toe_m, toe)


def test_a_body_ahead_of_its_path_need_not_step_back_to_make_progress(course, plan):
    here = Standing.at_end(plan)
    ahead = replace(here, com_m=course.com_nominal_m[1] + [0.0, 0.0, 0.01])
    assert course_window(course, 0, 2, ahead).steps.progress_m == 0.0
    behind = replace(here, com_m=course.com_nominal_m[0])
    assert course_window(course, 0, 2, behind).steps.progress_m == course.steps.progress_m > 0.0


@pytest.mark.parametrize(("first", "last"), [(0, 5), (3, 2), (-1, 2)])
def test_frames_that_there_are_not_are_refused(course, plan, first, last):
    with refuses("window", f"{first} to {last}"):
        course_window(course, first, last, Standing.at_end(plan))


def test_a_later_window_needs_a_standing_robot(course):
    with refuses("window", "1 to 2"):
        course_window(course, 1, 2)


def test_one_limb_at_a_time_is_a_longer_way_to_the_same_footholds(planner, course):
    alone = one_at_a_time(course, 2, 3)
    assert [len(lifted) for lifted in alone.lifts] == [0, 3, 1, 1, 1, 1, 1, 1, 3]
    assert [name for lifted in alone.lifts[2:5] for (name,) in [lifted]] == sorted(
        course.lifts[2], key=course.robot.limb_names.index
    )
    ways = [
        {(each.limb, tuple(map(id, each.candidates))) for each in of.footholds}
        for of in (course, alone)
    ]
    assert ways[0] == ways[1]
    np.testing.assert_allclose(
        alone.com_nominal_m[[0, 1, 4, 7, 8]], course.com_nominal_m, atol=1e-12
    )
    steps = np.diff(alone.com_nominal_m[1:5], axis=0)
    np.testing.assert_allclose(steps, np.tile(steps.mean(axis=0), (3, 1)), atol=1e-12)
    assert alone.steps.progress_m == pytest.approx(course.steps.progress_m / 3.0)
    found = planner.solve(alone).solution
    assert found is not None
    assert check_plan(found).accepted
    assert {len(stance.limbs) for stance in alone.stances if 2 <= stance.frame <= 6} == {5}


@pytest.mark.parametrize(("first", "last"), [(0, 1), (2, 5), (3, 2)])
def test_of_frames_that_there_are_not_nothing_is_lifted_alone(course, first, last):
    with refuses("frames", f"{first} to {last}"):
        one_at_a_time(course, first, last)
