"""The decoupled planner: plans where forces come easily, fails where friction decides, proves what
has no positions.
"""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.problem import StepLimits
from stancekit.planners.search.micp import DecoupledPlanner, Positions
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names


@pytest.fixture(scope="module")
def planner(programs):
    return DecoupledPlanner(programs=programs)


def test_on_level_ground_it_plans_as_the_two_stage_planner_does(planner, programs):
    course = read_course("stairs", frames=2)
    outcome = planner.solve(course)
    assert outcome.status is Status.FEASIBLE
    assert check_plan(outcome.solution).accepted
    assert outcome.objective == pytest.approx(
        TwoStagePlanner(programs=programs).solve(course).objective, rel=1e-4
    )
    assert outcome.details["on_ice"] == 0.0


def test_on_walls_half_of_ice_it_fails_and_says_why_where_the_two_stage_planner_has_a_plan(
    planner, programs
):
    failed = on_ice = 0
    coupled = TwoStagePlanner(programs=programs)
    for seed in range(8):
        course = walls_of_ice(seed)
        ours, theirs = coupled.solve(course), planner.solve(course)
        if ours.status is not Status.FEASIBLE:
            assert theirs.status is not Status.FEASIBLE
            continue
        if theirs.status is Status.UNDECIDED and theirs.details.get("on_ice", 0.0) > 0.0:
            assert theirs.solution is None
            assert_names(theirs.message, "forces", "frame")
            failed += 1
            on_ice += theirs.details["on_ice"]
    assert failed > 3
    assert 0.2 < on_ice / failed < 0.8


def walls_of_ice(seed):
    """The built-in walls with two candidates a toe, one of which grips: the nearer or the farther,
    by chance.
    """
    rng, course = np.random.default_rng(seed), read_course("icy-walls", frames=2)
    footholds = []
    for put in course.footholds:
        grips = int(rng.integers(2))
        pair = [
            replace(patch, friction=float(r == grips)) for r, patch in enumerate(put.candidates[:2])
        ]
        footholds.append(replace(put, candidates=tuple(pair)))
    terrain = tuple(patch for put in footholds for patch in put.candidates)
    return replace(course, terrain=terrain, footholds=tuple(footholds))


def test_the_positions_know_nothing_of_friction(climb):
    course = climb(1, regions=2)
    icy = replace(
        course,
        footholds=tuple(
            replace(put, candidates=tuple(replace(patch, friction=0.0) for patch in put.candidates))
            for put in course.footholds
        ),
    )
    scaled = Scaled.of(course)
    positions = Positions(scaled.layout)
    first, second = positions.solve(scaled), positions.solve(Scaled.of(icy))
    np.testing.assert_array_equal(first[2].toes, second[2].toes)


def test_the_positions_bound_the_objective_of_the_lift_from_below(climb, written_course):
    looked_at = 0
    for seed in (1, 2):
        course = climb(seed)
        scaled = Scaled.of(course)
        if looked_at == 0:
            positions = Positions(scaled.layout)
        solution, _, _ = positions.solve(scaled)
        problem, _ = written_course(course)
        problem.solve(cp.CLARABEL)
        assert solution.status is ConicStatus.SOLVED
        assert solution.objective * course.length_scale_m**2 <= problem.value + 1e-7
        looked_at += 1
    assert looked_at == 2


def test_steps_too_short_to_get_anywhere_are_refuted_with_a_certificate_without_forces(
    climb, planner
):
    course = climb(1)
    near = replace(course, steps=StepLimits(com_m=0.2, toe_m=1e-3, progress_m=0.01))
    outcome = planner.solve(near)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(near)).accepted
    forces = outcome.certificate.multipliers[0, : 6 * len(near.stances)]
    np.testing.assert_array_equal(forces, 0.0)
    assert not check_certificate(outcome.certificate.of(course)).accepted
