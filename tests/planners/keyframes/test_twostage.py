"""The two-stage planner and its search over patches: against every choice tried one by one, and at its limits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.conic import ConicStatus
from stancekit.planners.keyframes.clock import Clock
from stancekit.planners.keyframes.rays import MARGIN, Rays
from stancekit.planners.keyframes.scaled import ScaledCourse
from stancekit.planners.keyframes.search import farkas, nearest
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.outcome import Certificate, InvalidInput, Status
from stancekit.planners.scene.course_spec import read_course
from stancekit.planners.verify import check_certificate, check_plan

TORN = {"regions": 2, "ice": 0.5}


@pytest.fixture(scope="module")
def planner(models):
    return TwoStageCoursePlanner(models=models)


@pytest.mark.parametrize("name", ["walls", "stairs"])
def test_a_built_in_course_gets_a_verified_plan_at_its_bound(name, planner):
    outcome = planner.solve(read_course(name, frames=2))
    assert outcome.status is Status.FEASIBLE
    assert check_plan(outcome.plan).accepted
    assert outcome.objective == pytest.approx(outcome.bound, rel=1e-4)
    assert outcome.solves == 2


def test_the_search_says_what_trying_every_choice_says(climb, planner):
    best = TwoStageCoursePlanner(models=planner._models, gap=1e-4)
    seen = set()
    for seed in (5, 8):
        course = climb(seed, **TORN)
        singly = [
            best.solve(course.with_choice(choice))
            for choice in itertools.product(range(2), repeat=len(course.placements))
        ]
        objectives = [outcome.objective for outcome in singly if outcome.status is Status.FEASIBLE]
        first, whole = planner.solve(course), best.solve(course)
        seen.add(first.status)
        if objectives:
            assert first.status is whole.status is Status.FEASIBLE
            assert first.objective >= min(objectives) * (1.0 - 1e-4)
            assert whole.objective <= min(objectives) * 1.001
            assert whole.bound <= min(objectives) * (1.0 + 1e-6)
        else:
            assert first.status is Status.INFEASIBLE
            assert all(outcome.status is Status.INFEASIBLE for outcome in singly)
            assert check_certificate(course, first.certificate).accepted
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}


def test_nearest_is_the_first_candidate_with_friction(climb):
    scaled = ScaledCourse.of(climb(3, regions=3, ice=0.6))
    friction = scaled.friction.reshape(-1, 3)
    choice = nearest(scaled).argmax(axis=1)
    for row, r in zip(friction, choice, strict=True):
        assert row[r] > 0.0 or not row.any()
        assert not row[:r].any()
    assert choice.max() > 0


def test_a_ray_refutes_exactly_the_parts_for_which_the_verifier_accepts_it(climb, models):
    agreed = {True: 0, False: 0}
    for seed in range(6):
        course = climb(seed, **TORN)
        scaled = ScaledCourse.of(course)
        lift, rng = models.lift(scaled, Clock.start()), np.random.default_rng(seed)
        for _ in range(4):
            choice = rng.integers(2, size=len(course.placements))
            lifted = lift.solve(scaled.only(np.eye(2)[choice]))
            if lifted.status is not ConicStatus.INFEASIBLE:
                continue
            row = farkas(scaled.layout, lift.model, lifted.solution)
            rays = Rays(scaled)
            rays.add(row)
            for other in (choice, *rng.integers(2, size=(4, len(choice)))):
                proof = Certificate(tree=[[0, 0, 0, 0, 0]], multipliers=row[None])
                accepted = check_certificate(course.with_choice(other), proof).accepted
                said = rays.refuting(np.eye(2)[other]) is not None
                assert not said or accepted
                if said != accepted:  # only a bound between zero and the margin
                    assert rays.refuting(np.eye(2)[other]) is None
                    tables = rays._tables[0][np.arange(len(other)), other].sum() + rays._constants[0]
                    assert -1e-4 < tables <= MARGIN
                agreed[said] += 1
    assert min(agreed.values()) > 5


def test_relief_is_what_the_kindest_candidates_take_from_a_ray(climb, models):
    course = climb(5, **TORN)
    scaled = ScaledCourse.of(course)
    lift = models.lift(scaled, Clock.start())
    lifted = lift.solve(scaled)
    assert lifted.status is ConicStatus.INFEASIBLE
    rays = Rays(scaled)
    rays.add(farkas(scaled.layout, lift.model, lifted.solution))
    table, opened = rays._tables[0], np.ones(lifted.shares.shape)
    choice = np.zeros(len(table), dtype=int)
    relief = rays.relief(0, choice, opened)
    np.testing.assert_allclose(relief, table[:, 0] - table.min(axis=1))
    closed = opened * [1.0, 0.0]
    np.testing.assert_array_equal(rays.relief(0, choice, closed), 0.0)


def test_at_its_limit_it_says_which_and_keeps_the_plan_that_it_has(climb, models):
    course = climb(8, **TORN)
    assert not TwoStageCoursePlanner(models=models).solve(course).details["guessed"]
    outcome = TwoStageCoursePlanner(models=models, time_limit_s=0.0).solve(course)
    assert outcome.status is Status.UNDECIDED
    assert outcome.certificate is None
    assert outcome.message == "the search for patches met its limit (its time limit)"
    outcome = TwoStageCoursePlanner(models=models, gap=1e-4, max_nodes=2).solve(course)
    assert outcome.status is Status.FEASIBLE
    assert outcome.message == "the search for patches met its limit (2 nodes)"
    assert outcome.bound <= TwoStageCoursePlanner(models=models, gap=1e-4).solve(course).objective


def test_the_first_plan_may_be_far_from_the_best_and_a_gap_closes_that(climb, models):
    first, best = (TwoStageCoursePlanner(models=models, gap=gap).solve(climb(7, **TORN)) for gap in (None, 1e-4))
    assert first.details["guessed"]
    assert best.objective < 0.5 * first.objective
    assert best.bound <= best.objective * (1.0 + 1e-6)


def test_the_same_course_gets_the_same_plan_whatever_was_solved_before(climb, models):
    planner = TwoStageCoursePlanner(models=models)
    first = planner.solve(climb(1, **TORN))
    planner.solve(climb(3, **TORN))
    again = planner.solve(climb(1, **TORN))
    np.testing.assert_array_equal(first.plan.com_m, again.plan.com_m)
    np.testing.assert_array_equal(first.plan.toes_m, again.plan.toes_m)


def test_units_do_not_matter(climb, models):
    course = climb(2)
    other = TwoStageCoursePlanner(models=models).solve(replace(course, length_scale_m=0.5))
    same = TwoStageCoursePlanner(models=models).solve(course)
    assert other.bound == pytest.approx(same.bound, rel=1e-4)


def test_bad_settings_are_refused():
    with pytest.raises(InvalidInput, match="projection: expected one of fix-p, fix-toes, scp, got 'magic'"):
        TwoStageCoursePlanner(projection="magic")
    with pytest.raises(InvalidInput, match="gap: expected a number above 0"):
        TwoStageCoursePlanner(gap=0.0)
