"""IPOPT on postures and whole plans: agreement with what is proved, and no claim that it cannot
show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Nlp, starting_points
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan
from tests.refusals import assert_names


@pytest.fixture(scope="module")
def scenes():
    """Natural wall-3 scenes with the exact planner's answer, the trivially infeasible ones left
    out.
    """
    rng, exact = np.random.default_rng(1), Exact()
    drawn = [DISTRIBUTIONS["wall-3"].sample(rng) for _ in range(20)]
    answered = [(problem, exact.solve(problem)) for problem in drawn]
    kept = [(problem, outcome) for problem, outcome in answered if not outcome.details["trivial"]]
    assert {outcome.status for _, outcome in kept} == {Status.FEASIBLE, Status.INFEASIBLE}
    return kept


def test_it_finds_a_verified_witness_exactly_where_there_is_one(scenes, programs):
    planner = Nlp(programs=programs)
    for problem, exact in scenes:
        outcome = planner.solve(problem)
        assert (outcome.status is Status.FEASIBLE) == (exact.status is Status.FEASIBLE)
        if outcome.status is Status.FEASIBLE:
            assert check_plan(outcome.solution).accepted
            assert outcome.claim == "Solve_Succeeded"
        else:
            assert outcome.status is Status.UNDECIDED
            assert_names(outcome.message, "5 starts", outcome.claim)


def test_five_legs_and_the_ground_are_no_different(drawn):
    for name in ("wall-5", "ground-3"):
        assert Exact().solve(drawn(name, 3)).status is Status.FEASIBLE
        assert Nlp().solve(drawn(name, 3)).status is Status.FEASIBLE


def test_patches_may_have_different_numbers_of_vertices(scenes):
    problem = next(problem for problem, outcome in scenes if outcome.status is Status.FEASIBLE)
    first, *rest = problem.contacts
    a, b, c = first.patch.vertices_m
    square = replace(first.patch, vertices_m=np.array([a, 0.5 * (a + b), b, c]))
    same = problem.posture_with(contacts=(replace(first, patch=square), *rest))
    assert Nlp().solve(same).status is Status.FEASIBLE


def test_ice_on_level_ground_is_no_obstacle(drawn):
    problem = drawn("ground-3", 3)
    level = tuple(
        replace(
            contact,
            patch=Patch(
                vertices_m=np.column_stack([contact.patch.vertices_m[:, :2], np.full(3, -0.2)]),
                normal=np.array([0.0, 0.0, 1.0]),
                shear_reference=np.array([1.0, 0.0, 0.0]),
                friction=0.0,
            ),
        )
        for contact in problem.contacts
    )
    problem = problem.posture_with(contacts=level)
    assert Exact().solve(problem).status is Status.FEASIBLE
    assert Nlp().solve(problem).status is Status.FEASIBLE


@pytest.mark.parametrize("start", ["nominal", "p1"])
def test_it_plans_what_the_two_stage_planner_plans_and_nothing_that_is_refuted(
    start, ragged, programs
):
    planner, best = Nlp(start=start, programs=programs), TwoStage(gap=1e-4)
    found = refuted = 0
    for seed in range(19):
        course = ragged(seed, candidates=1, ice=0.0)
        ours, theirs = planner.solve(course), best.solve(course)
        if theirs.status is Status.INFEASIBLE:
            assert ours.status is Status.UNDECIDED
            assert ours.solution is None
            assert_names(ours.message, "1 starts", ours.claim)
            refuted += 1
        elif ours.status is Status.FEASIBLE:
            assert check_plan(ours.solution).accepted
            assert ours.claim == "Solve_Succeeded"
            assert ours.objective >= theirs.bound - 1e-8
            # Both are local where the lift is not tight; they meet on nearly all of these.
            found += ours.objective <= theirs.objective * 1.01
    assert found >= 5
    assert refuted >= 5


def test_a_built_in_course_of_one_frame_and_one_with_choices(programs):
    planner = Nlp(programs=programs, time_limit_s=600.0)
    for name, frames in (("walls", 1), ("icy-walls", 2)):
        outcome = planner.solve(read_course(name, frames=frames))
        assert outcome.status is Status.FEASIBLE
        assert check_plan(outcome.solution).accepted
        assert 0.0 < outcome.effort.solver_s <= outcome.effort.seconds
    friction = [
        outcome.solution.problem.patch(p, outcome.solution.choice).friction
        for p in range(len(outcome.solution.toes_m))
    ]
    assert min(friction) > 0.0


def test_a_posture_and_its_course_of_one_frame_have_the_same_answer(ragged, programs):
    course = ragged(2, frames=1, candidates=1, ice=0.0)
    problem = course.posture_problem(course.stances[0], np.zeros(4, dtype=int))
    answers = [Nlp(programs=programs).solve(some) for some in (course, problem)]
    assert {answer.status for answer in answers} == {Status.FEASIBLE}


def test_starts_are_the_centroids_and_then_seeded_points_of_the_patches(drawn):
    scaled = Scaled.of(drawn("wall-5", 0))
    starts = starting_points(scaled, 4, seed=7)
    np.testing.assert_allclose(starts[0].toes, scaled.patches.mean(axis=1))
    assert len({start.toes.tobytes() for start in starts}) == 4
    for start, again in zip(starts, starting_points(scaled, 4, seed=7), strict=True):
        np.testing.assert_array_equal(start.toes, again.toes)
        assert np.all((start.forces >= scaled.force_min) & (start.forces <= scaled.force_max))


def test_a_limit_leaves_the_problem_undecided(scenes, ragged, programs):
    problem = next(problem for problem, outcome in scenes if outcome.status is Status.FEASIBLE)
    few = Nlp(max_iterations=1, starts=2).solve(problem)
    assert (few.status, few.claim, few.effort.solves) == (
        Status.UNDECIDED,
        "Maximum_Iterations_Exceeded",
        2,
    )
    course = ragged(2, candidates=1, ice=0.0)
    assert solve_lift(programs, Scaled.of(course), least_moment=False).bound < np.inf
    for some in (problem, course):
        short = Nlp(time_limit_s=1e-6).solve(some)
        assert (short.status, short.claim) == (Status.UNDECIDED, "Maximum_WallTime_Exceeded")


def test_programs_are_shared_by_courses_of_one_layout():
    course = read_course("walls", frames=1)
    planner = Nlp()
    first = planner.solve(course)
    again = planner.solve(replace(course, name="other"))
    assert again.effort.compile_s < 0.1 * first.effort.compile_s


def test_it_prints_nothing(scenes, capfd):
    for problem, _ in scenes[:3]:
        Nlp().solve(problem)
    assert capfd.readouterr() == ("", "")
