"""The two-stage planner of courses: plans at their bounds, answers that are checked, and the same
ones every time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.project import PROJECTIONS, cost
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M
from stancekit.planners.search import cuts
from stancekit.planners.search.answer import Acceptance, Clock
from stancekit.planners.search.two_stage import TwoStage, decide
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names, refuses

TORN = {"regions": 2, "ice": 0.5}


@pytest.fixture(scope="module")
def planner(programs):
    return TwoStage(programs=programs)


@pytest.mark.parametrize("name", ["walls", "stairs"])
def test_a_built_in_course_gets_a_verified_plan_at_its_bound(name, planner):
    outcome = planner.solve(read_course(name, frames=2))
    assert outcome.status is Status.FEASIBLE
    assert check_plan(outcome.solution).accepted
    assert outcome.objective == pytest.approx(outcome.bound, rel=1e-4)
    assert outcome.effort.solves == 2


@pytest.mark.parametrize("projection", PROJECTIONS.names())
def test_a_status_is_always_one_that_the_verifier_confirms_whatever_the_projection(
    climb, rough, programs, planner, projection
):
    ours, seen = (
        TwoStage(projection=projection, programs=programs, time_limit_s=600.0),
        set(),
    )
    for course in [
        *(climb(seed) for seed in (0, 1, 3, 5)),
        *(rough(seed, regions=2, ice=0.2) for seed in (0, 1, 3)),
    ]:
        outcome, full = ours.solve(course), planner.solve(course)
        seen.add(outcome.status)
        if outcome.status is Status.FEASIBLE:
            assert check_plan(outcome.solution).accepted
            assert outcome.solution.provenance["projection"] == projection
            assert full.status is not Status.INFEASIBLE
        elif outcome.status is Status.INFEASIBLE:
            assert check_certificate(outcome.certificate.of(course)).accepted
            assert full.status is not Status.FEASIBLE
        else:
            assert outcome.solution is outcome.certificate is None
            assert outcome.message
    assert {Status.FEASIBLE, Status.INFEASIBLE} <= seen


def test_without_cuts_what_p1_admits_and_p2_does_not_find_stays_open_and_with_them_it_is_refuted(
    drawn, as_course, programs, monkeypatch
):
    monkeypatch.setattr(cuts, "NODES", 1)  # or its stance alone would tell
    course = as_course(drawn("wall-3", 225))
    blunt = TwoStage(programs=programs, cuts=False).solve(course)
    assert (blunt.status, blunt.certificate) == (Status.UNDECIDED, None)
    assert_names(blunt.message, "P1", "P2")
    sharp = TwoStage(programs=programs).solve(course)
    assert sharp.status is Status.INFEASIBLE
    assert sharp.details["cuts"] > 1.0


def test_decided_by_cuts_alone_courses_have_the_verdict_of_the_planner(
    climb, rough, programs, planner
):
    seen = set()
    for course in [climb(0), climb(1), climb(2), rough(2), rough(4), climb(5, **TORN)]:
        found, proof, nodes = decide(programs, Scaled.of(course), Clock.start(30.0), 500)
        assert nodes > 0
        outcome = planner.solve(course)
        assert (found is not None) == (outcome.status is Status.FEASIBLE)
        if proof is not None:
            assert check_certificate(proof.of(course)).accepted
        if found is not None:
            lift = solve_lift(programs, Scaled.of(course), least_moment=False)
            assert cost(Scaled.of(course), found[1]) >= lift.bound * (1.0 - 1e-6)
        seen.add(outcome.status)
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}


def test_the_first_plan_may_be_far_from_the_best_and_a_gap_closes_that(climb, programs):
    first, best = (
        TwoStage(programs=programs, gap=gap).solve(climb(7, **TORN)) for gap in (None, 1e-4)
    )
    assert first.details["guessed"]
    assert best.objective < 0.5 * first.objective
    assert best.bound <= best.objective * (1.0 + 1e-6)


def test_the_same_course_gets_the_same_plan_whatever_was_solved_before(climb, programs):
    planner = TwoStage(programs=programs)
    first = planner.solve(climb(1, **TORN))
    planner.solve(climb(3, **TORN))
    again = planner.solve(climb(1, **TORN))
    np.testing.assert_array_equal(first.solution.com_m, again.solution.com_m)
    np.testing.assert_array_equal(first.solution.toes_m, again.solution.toes_m)


def test_neither_new_programs_nor_few_of_them_change_an_answer(climb, rough):
    courses = [climb(1), climb(5, **TORN), rough(1, regions=2), climb(2, frames=1), rough(2)]
    shared, few = Programs(), Programs(most=2)
    for course in [*courses, *courses[::-1]]:
        said = [TwoStage(programs=some).solve(course) for some in (Programs(), shared, few)]
        for other in said[1:]:
            assert (other.status, other.effort.solves) == (said[0].status, said[0].effort.solves)
            if other.solution is None:
                np.testing.assert_array_equal(other.certificate.tree, said[0].certificate.tree)
                np.testing.assert_array_equal(
                    other.certificate.multipliers, said[0].certificate.multipliers
                )
            else:
                np.testing.assert_array_equal(other.solution.com_m, said[0].solution.com_m)
                np.testing.assert_array_equal(other.solution.forces_n, said[0].solution.forces_n)


def test_units_do_not_matter(climb, programs):
    course = climb(2)
    other = TwoStage(programs=programs).solve(replace(course, length_scale_m=0.5))
    assert other.bound == pytest.approx(TwoStage(programs=programs).solve(course).bound, rel=1e-4)


# --------------------------------------------------------------------------------------------------------
# acceptance


def test_no_claim_about_a_course_is_believed(climb, planner):
    feasible, refuted, other = (planner.solve(climb(seed)) for seed in (1, 0, 3))
    assert (refuted.status, other.status) == (Status.INFEASIBLE, Status.INFEASIBLE)

    def accept(seed, **said):
        return Acceptance().answer(climb(seed), method="liar", clock=Clock.start(), **said)

    wrong = accept(1, certificate=refuted.certificate)
    assert (wrong.status, wrong.certificate) == (Status.UNDECIDED, None)
    assert_names(wrong.message, "certificate", "leaf 0")
    moved = replace(feasible.solution, com_m=feasible.solution.com_m + np.array([0.0, 0.02, 0.0]))
    both = accept(1, plan=moved, certificate=refuted.certificate)
    assert (both.status, both.solution) == (Status.UNDECIDED, None)
    assert_names(both.message, "plan")
    assert both.residual > 1e-3
    assert accept(0, certificate=refuted.certificate).status is Status.INFEASIBLE


def test_toes_on_stairs_keep_a_foots_radius_from_risers(planner):
    course = read_course("stairs")
    outcome = planner.solve(course)
    assert outcome.solution is not None
    risers = [patch.vertices_m for patch in course.terrain if abs(patch.normal[2]) < 0.5]
    assert len(risers) == 4
    toes = outcome.solution.toes_m
    assert len(toes) == len(course.footholds)
    gaps = [
        np.linalg.norm(toes - np.clip(toes, riser.min(axis=0), riser.max(axis=0)), axis=1)
        for riser in risers
    ]
    assert np.min(gaps) > FOOT_RADIUS_M


def test_settings_that_mean_nothing_are_refused():
    with refuses("relaxation"):
        TwoStage(relaxation="nosuch")  # without envelopes, too
    with refuses("envelopes"):
        TwoStage(envelopes=3).check("postures")
