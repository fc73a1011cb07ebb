"""A problem of one frame and a course are one type: what is made as one is read, scaled and judged
as the other.
"""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from tests.refusals import at_once, refuses


@pytest.fixture
def problem(drawn) -> Problem:
    return drawn("wall-3", 1)


def rebuilt(problem: Problem) -> Problem:
    """The same by the constructor, which looks at everything, as one that nothing was worked out
    of.
    """
    return replace(problem)


def test_a_posture_problem_is_a_problem_of_one_frame(problem):
    assert (problem.frames, problem.is_posture, problem.weights, len(problem.stances)) == (
        1,
        True,
        None,
        1,
    )
    assert problem.com_nominal_m.shape == (1, 3)
    assert problem.com_radius_m.shape == (1,)
    again = rebuilt(problem)
    assert again.to_json() == problem.to_json()
    np.testing.assert_array_equal(again.holds, problem.holds)
    assert again.stances == problem.stances
    assert [contact.leg for contact in again.contacts] == list(problem.legs)


def test_both_ways_of_making_it_have_the_same_numbers_and_the_same_answer(
    drawn, mixed, bounded, soled
):
    planner = Exact()
    for made in (
        drawn("wall-3", 8),
        mixed(1, (3, 4, 5)),
        bounded(drawn("ground-3", 2), 2, 0.05),
        soled(drawn("wall-3", 3), 3),
    ):
        one, other = Scaled.of(made), Scaled.of(rebuilt(made))
        assert one.layout == other.layout
        for name in (
            "vertices",
            "frames",
            "friction",
            "shoulders",
            "reach",
            "force_min",
            "force_max",
            "com",
            "goal",
        ):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        first, second = planner.solve(made), planner.solve(rebuilt(made))
        assert (first.status, first.bound) == (second.status, second.bound)


def test_forces_are_bounded_foothold_by_foothold(drawn):
    problem = drawn("ground-3", 3)
    weak = [
        replace(problem.contacts[0], force_max=np.array([0.05, 1.0, 1.0])),
        *problem.contacts[1:],
    ]
    held = Exact().solve(problem.posture_with(contacts=tuple(weak)))
    assert held.solution is not None
    share = (
        float(held.solution.forces_n[0, 0] @ problem.contacts[0].patch.normal) / problem.weight_n
    )
    assert share <= 0.05 + 1e-6
    free = Exact().solve(problem)
    assert not check_plan(
        replace(free.solution, problem=problem.posture_with(contacts=tuple(weak)))
    ).accepted


def test_bounds_of_footholds_count_in_plans_and_in_files():
    course = read_course("walls", frames=3)
    strong = TwoStage().solve(course)
    first = course.footholds[0]
    weak = replace(
        first, force_min=np.array([0.0, -1.0, -1.0]), force_max=np.array([0.1, 1.0, 1.0])
    )
    changed = replace(course, footholds=(weak, *course.footholds[1:]))
    answer = TwoStage().solve(changed)
    assert answer.solution is not None
    on = [
        (s, i)
        for s, of in enumerate(course.stances)
        for i in of.limbs
        if course.holds[of.frame, i] == 0
    ]
    assert on
    for stance, limb in on:
        force = answer.solution.forces_n[stance, limb]
        assert (
            float(force @ weak.candidates[int(answer.solution.choice[0])].normal)
            <= 0.1 * course.weight_n + 1e-4
        )
    loaded = max(np.linalg.norm(strong.solution.forces_n[s, i]) for s, i in on)
    assert loaded > 0.1 * course.weight_n
    again = Problem.from_json(changed.to_json())
    np.testing.assert_array_equal(again.footholds[0].force_max, weak.force_max)
    assert again.footholds[1].force_max is None


def test_another_force_scale_changes_no_plan():
    course = read_course("walls", frames=2)
    scaled = replace(
        course,
        force_scale_n=40.0,
        force_min=course.force_min * course.weight_n / 40.0,
        force_max=course.force_max * course.weight_n / 40.0,
    )
    one, other = (TwoStage().solve(each) for each in (course, scaled))
    assert one.status is other.status
    assert one.objective == pytest.approx(other.objective, rel=1e-3)
    assert stancekit.verify(other.solution).contacts
    assert Problem.from_json(scaled.to_json()).force_scale_n == 40.0


def test_a_problem_of_several_frames_needs_an_objective(problem):
    course = read_course("walls", frames=2)
    with refuses("weights"):
        replace(course, weights=None)
    with refuses("weights"):
        _ = problem.aim
    with refuses("contacts"):
        _ = course.contacts


def test_bounds_come_in_pairs_in_order_and_let_a_limb_that_moves_go():
    course = read_course("walls", frames=2)
    first, *others = course.footholds
    for bounds, name in (
        ({"force_min": np.zeros(3)}, "force_max"),
        ({"force_min": np.ones(3), "force_max": np.zeros(3)}, "force_min"),
    ):
        with refuses(name):
            replace(first, **bounds)
    pushed = replace(first, force_min=np.array([0.0, 0.1, 0.0]), force_max=np.ones(3))
    with refuses("placements[0]", "force_min", "force_max"):
        replace(course, footholds=(pushed, *others))


def test_copies_and_pickles_are_the_same_problem(problem):
    for again in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        assert again.to_json() == problem.to_json()


def test_one_is_made_fast_enough_for_environments(problem):
    given = {
        "contacts": problem.contacts,
        "mass_kg": 10.0,
        "com_nominal_m": np.zeros(3),
        "com_radius_m": 0.1,
    }
    with at_once(300):
        Problem.posture(**given)
