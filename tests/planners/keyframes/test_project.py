"""P2 over key frames: what each projection keeps, that it lands on the surface, and that descent only descends."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.keyframes.clock import Clock
from stancekit.planners.keyframes.descent import cost
from stancekit.planners.keyframes.planner import objective_of, plan_of
from stancekit.planners.keyframes.project import PlanPoint
from stancekit.planners.keyframes.scaled import ScaledCourse
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.verify import check_plan

FEASIBLE = (1, 2, 4, 7)


@pytest.fixture(scope="module")
def starts(climb, models):
    """(scaled course, its lift's point) of courses that have a plan."""
    found = []
    for seed in FEASIBLE:
        scaled = ScaledCourse.of(climb(seed))
        lifted = models.lift(scaled, Clock.start()).solve(scaled)
        frames = scaled.frames[scaled.layout.bearing[2]]
        forces = np.matmul(frames.transpose(0, 2, 1), lifted.forces[..., None])[..., 0]
        start = PlanPoint(
            com=lifted.com, rotation=lifted.rotation, toes=lifted.toes[:, 0], forces=forces, residual=np.inf
        )
        found.append((scaled, start))
    return found


def plan(scaled, point):
    return plan_of(scaled, np.zeros(scaled.layout.placements, dtype=int), point, provenance={})


def test_scp_ends_on_a_plan_that_the_verifier_accepts_whose_objective_is_no_less_than_the_lifts(starts, models):
    stepped = 0
    for scaled, start in starts:
        lifted = models.lift(scaled, Clock.start()).solve(scaled)
        projector = models.projector(scaled)
        stepped += not projector.fix_toes(scaled, start, Clock.start()).found
        point = projector.scp(scaled, start, Clock.start())
        assert point.found
        assert check_plan(plan(scaled, point)).accepted
        assert cost(scaled, point) >= lifted.objective - 1e-7
    assert stepped > 0  # otherwise no linearised step was looked at


def test_fix_toes_finds_what_a_second_writing_finds_with_these_toes(climb, written, starts, models):
    # With one vertex a patch the lift is the problem with toes held: λ is 1 there, wherever the others are.
    for scaled, start in starts[:2]:
        course = scaled.course
        point = models.projector(scaled).scp(scaled, start, Clock.start())
        toes = point.toes * course.length_scale_m
        problem, shares = written(course)
        weights = []
        for put, row, toe in zip(course.placements, shares, toes, strict=True):
            corners = put.candidates[0].vertices_m
            weights.append(cp.sum_squares(corners.T @ row[0] - toe) <= 1e-18)
        held = cp.Problem(problem.objective, [*problem.constraints, *weights])
        held.solve(cp.CLARABEL)
        assert held.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)
        # A relaxation of it, since forces may still differ by vertex.
        assert held.value <= objective_of(plan(scaled, point)) + 1e-6


def test_fix_p_keeps_toes_and_body_and_solves_for_forces_alone(starts, models):
    for scaled, start in starts:
        point = models.projector(scaled).scp(scaled, start, Clock.start())
        again = models.projector(scaled).fix_p(scaled, replace(point, forces=0.0 * point.forces), Clock.start())
        np.testing.assert_array_equal(again.toes, point.toes)
        np.testing.assert_array_equal(again.com, point.com)
        np.testing.assert_array_equal(again.rotation, point.rotation)
        assert again.residual < 1e-7
        assert check_plan(plan(scaled, again)).accepted


def test_toes_that_cannot_hold_the_robot_have_no_answer(starts, models):
    scaled, start = starts[0]
    below = replace(start, toes=start.toes - [0.0, 0.0, 1.0])
    assert not models.projector(scaled).fix_toes(scaled, below, Clock.start()).found


def test_descent_ends_on_a_better_plan_and_never_on_a_worse_one(starts, models):
    gains = []
    for scaled, start in starts:
        point = models.projector(scaled).scp(scaled, start, Clock.start())
        better = models.descent(scaled).improve(scaled, point, Clock.start())
        assert better.found
        assert check_plan(plan(scaled, better)).accepted
        gains.append(1.0 - cost(scaled, better) / cost(scaled, point))
    assert min(gains) >= 0.0
    assert max(gains) > 0.01


def test_cost_is_the_objective_of_the_finished_plan(climb, models):
    planner = TwoStageCoursePlanner(models=models)
    for course in (climb(1), climb(4, regions=2, ice=0.4), climb(2, frames=1)):
        outcome = planner.solve(course)
        scaled, found = ScaledCourse.of(course), outcome.plan
        length = course.length_scale_m
        point = PlanPoint(
            com=found.com_m / length, rotation=found.rotation_rad, toes=found.toes_m / length,
            forces=np.zeros((1, 3)), residual=0.0,
        )  # fmt: skip
        assert cost(scaled, point) * length**2 == pytest.approx(outcome.objective, rel=1e-12)
