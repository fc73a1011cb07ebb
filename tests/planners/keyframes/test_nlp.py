"""The whole plan on IPOPT: derivatives, agreement with the convex planners, and no claim that it cannot show."""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from stancekit.planners.keyframes.layout import Layout
from stancekit.planners.keyframes.nlp import STARTS, NlpCoursePlanner, nominal_point, plan_program
from stancekit.planners.keyframes.scaled import ScaledCourse
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.outcome import InvalidInput, Status
from stancekit.planners.scene.course import Course
from stancekit.planners.scene.course_spec import read_course
from stancekit.planners.verify import check_plan


@pytest.mark.parametrize("start", STARTS)
def test_it_plans_what_the_two_stage_planner_plans_and_nothing_that_is_refuted(start, climb, models):
    planner = NlpCoursePlanner(start=start, models=models)
    best = TwoStageCoursePlanner(models=models, gap=1e-4)
    found = refuted = 0
    for seed in range(8):
        course = climb(seed)
        ours, theirs = planner.solve(course), best.solve(course)
        if theirs.status is Status.INFEASIBLE:
            assert ours.status is Status.UNDECIDED
            assert ours.plan is None
            assert ours.message == f"no plan from the {start} start; IPOPT said {ours.claim}"
            refuted += 1
        elif ours.status is Status.FEASIBLE:
            assert check_plan(ours.plan).accepted
            assert ours.claim == "Solve_Succeeded"
            assert ours.objective >= theirs.bound - 1e-8
            # Both are local where the lift is not tight; they meet on nearly all of these.
            found += ours.objective <= theirs.objective * 1.01
    assert found >= 5
    assert refuted >= 2


def test_a_built_in_course_of_one_frame_and_one_with_regions(models):
    planner = NlpCoursePlanner(models=models)
    for name, frames in (("walls", 1), ("icy-walls", 2)):
        outcome = planner.solve(read_course(name, frames=frames))
        assert outcome.status is Status.FEASIBLE
        assert check_plan(outcome.plan).accepted
        assert 0.0 < outcome.details["ipopt_s"] <= outcome.seconds
    friction = [outcome.plan.course.patch(p, outcome.plan.choice).friction for p in range(len(outcome.plan.toes_m))]
    assert min(friction) > 0.0


def numbers(course: Course) -> tuple[dict[str, object], np.ndarray, np.ndarray]:
    """The program of a course, its data and a random point."""
    from stancekit.planners.keyframes import nlp

    scaled = ScaledCourse.of(course)
    program, _ = plan_program(scaled.layout, course.weights, course.length_scale_m)
    start = nlp._vector(scaled, nominal_point(scaled))
    x = start + 0.1 * np.random.default_rng(0).normal(size=len(start))
    return program, nlp._parameters(scaled, start), x


def test_derivatives_match_finite_differences_and_the_objectives_gradient_is_dense(climb):
    program, data, at = numbers(climb(1))
    x, p = program["x"], program["p"]
    both = cs.vertcat(program["f"], program["g"])
    value, slope = cs.Function("v", [x, p], [both]), cs.Function("s", [x, p], [cs.jacobian(both, x)])
    steps = 1e-6 * np.eye(x.numel())
    measured = np.column_stack([np.asarray(value(at + h, data) - value(at - h, data)).ravel() / 2e-6 for h in steps])
    np.testing.assert_allclose(np.asarray(slope(at, data)), measured, atol=1e-7)
    assert cs.gradient(program["f"], x).nnz() == x.numel()


def test_the_rows_vanish_at_a_verified_plan_and_the_objective_is_its_own(climb, models):
    from stancekit.planners.keyframes import nlp
    from stancekit.planners.keyframes.project import PlanPoint

    course = climb(2, frames=3)
    outcome = TwoStageCoursePlanner(models=models).solve(course)
    assert outcome.status is Status.FEASIBLE
    scaled, plan, length = ScaledCourse.of(course), outcome.plan, course.length_scale_m
    stance, limb, placement = scaled.layout.bearing
    world = plan.forces_n[stance, limb] / course.weight_n
    point = PlanPoint(
        com=plan.com_m / length, rotation=plan.rotation_rad, toes=plan.toes_m / length,
        forces=np.einsum("bji,bj->bi", scaled.frames[placement], world), residual=0.0,
    )  # fmt: skip
    program, equal = plan_program(scaled.layout, course.weights, length)
    x = nlp._vector(scaled, point)
    rows = cs.Function("rows", [program["x"], program["p"]], [program["f"], program["g"]])
    f, g = (np.asarray(part).ravel() for part in rows(x, nlp._parameters(scaled, x)))
    assert np.abs(g[:equal]).max() < 1e-6
    assert g[equal:].max() < 1e-6
    assert f[0] * length**2 == pytest.approx(outcome.objective, rel=1e-9)
    back = nlp._point(scaled, x, converged=True)
    np.testing.assert_allclose(back.toes, point.toes, atol=1e-9)
    assert back.residual < 1e-7
    assert nlp._point(scaled, x, converged=False).residual == np.inf


def test_without_time_it_is_undecided(climb, models):
    outcome = NlpCoursePlanner(models=models, time_limit_s=1e-6).solve(climb(1))
    assert outcome.status is Status.UNDECIDED
    assert outcome.claim == "Maximum_WallTime_Exceeded"
    assert NlpCoursePlanner(models=models, max_iterations=1).solve(climb(1)).claim == "Maximum_Iterations_Exceeded"


def test_programs_are_shared_by_courses_of_one_layout(climb, models):
    planner = NlpCoursePlanner(models=models)
    planner.solve(climb(1))
    other = replace(climb(2), name="other")
    assert Layout.of(other) == Layout.of(climb(1))
    assert planner.solve(other).compile_s == 0.0


def test_bad_settings_are_refused():
    with pytest.raises(InvalidInput, match="start: expected one of nominal, p1, got 'random'"):
        NlpCoursePlanner(start="random")
