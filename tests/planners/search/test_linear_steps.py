"""A limit of the body's step in one axis: plans, proofs, forged ones, the reference, the NLP,
files.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import StepLimits
from stancekit.planners.problem.course_file import described, spec_from
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.micp import Nlp
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan, explain
from stancekit.planners.verify.lagrangian import multipliers_of
from stancekit.planners.verify.stances import Schedule
from tests.planners.oracle import OraclePrograms
from tests.refusals import refuses

YAW_RAD = 2e-3


def largest_yaw(plan) -> float:
    return float(np.abs(np.diff(plan.rotation_rad[:, 2])).max())


@pytest.fixture
def turning(climb):
    """Climbs whose plans turn about the vertical by more than ``YAW_RAD`` where nothing keeps them
    from it.
    """
    return [climb(seed, frames=3) for seed in range(12)]


def limited(course, yaw_rad: float):
    return replace(course, steps=replace(course.steps, yaw_rad=yaw_rad))


@pytest.mark.parametrize("make", [TwoStage, Nlp])
def test_plans_turn_no_farther_and_would_without(turning, programs, make):
    planner, turned = make(programs=programs), 0
    for course in turning:
        free = planner.solve(course)
        if free.solution is None or largest_yaw(free.solution) < 2.0 * YAW_RAD:
            continue
        turned += 1
        judged = check_plan(replace(free.solution, problem=limited(course, YAW_RAD)))
        assert judged.refused[0].name == "yaw_step"
        assert judged.group("yaw_step").value == pytest.approx(largest_yaw(free.solution) - YAW_RAD)
        outcome = planner.solve(limited(course, YAW_RAD))
        if outcome.solution is not None:
            assert largest_yaw(outcome.solution) <= YAW_RAD + 1e-6
            assert check_plan(outcome.solution).accepted
    assert turned >= 2


def test_the_lift_is_that_of_the_reference_and_below_every_plan(turning, programs):
    reference, compared = OraclePrograms(), 0
    for course in turning:
        scaled = Scaled.of(limited(course, YAW_RAD))
        mine, theirs = (
            solve_lift(each, scaled, least_moment=False) for each in (programs, reference)
        )
        assert mine.status is theirs.status
        plan = TwoStage(programs=programs).solve(limited(course, YAW_RAD))
        if plan.solution is not None:
            compared += 1
            assert mine.bound == pytest.approx(theirs.bound, rel=1e-4, abs=1e-8)
            assert mine.bound * course.length_scale_m**2 <= plan.objective + 1e-9
    assert compared >= 2


@pytest.fixture
def pinned(climb):
    """A climb that has a plan, and none without a turn about the vertical: its legs are short."""
    course = climb(2, frames=4)
    limbs = tuple(replace(limb, reach_m=0.86 * limb.reach_m) for limb in course.robot.limbs)
    return replace(course, robot=replace(course.robot, limbs=limbs))


def test_a_proof_weighs_the_limit_and_proves_nothing_of_a_course_that_has_a_plan(pinned, programs):
    planner, rng = (
        TwoStage(programs=programs, time_limit_s=600.0),
        np.random.default_rng(4),
    )
    tight = limited(pinned, 0.0)
    assert planner.solve(pinned).solution is not None
    proof = planner.solve(tight).certificate
    assert check_certificate(proof.of(tight)).accepted
    weights = multipliers_of(Schedule.of_course(tight), proof.multipliers)["linear_step"]
    assert weights.max() > 0.1
    assert weights.min() >= 0.0
    wide = limited(pinned, 0.3)
    assert planner.solve(wide).solution is not None
    for scale in (0.0, 0.01, 0.1, 1.0):
        for _ in range(20):
            noise = rng.normal(scale=scale, size=proof.multipliers.shape)
            assert not check_certificate(
                replace(proof, multipliers=proof.multipliers + noise).of(wide)
            ).accepted
    negative = proof.multipliers.copy()
    negative[0, -1] = -0.5
    assert not check_certificate(replace(proof, multipliers=negative).of(tight)).accepted
    assert "steps.yaw_rad" in {one.parameter for one in explain(proof.of(tight)).relaxations}


def test_it_is_a_key_of_files_and_older_ones_have_none(climb):
    course = climb(1)
    assert "yaw_rad" not in course.to_json()["steps"]
    again = Problem.from_json(limited(course, 0.02).to_json())
    assert again.steps == replace(course.steps, yaw_rad=0.02)
    described_course = dict(described("walls"))
    described_course["steps"] = {**described_course.get("steps", {}), "yaw_rad": 0.01}
    assert spec_from(described_course).steps.yaw_rad == 0.01
    with refuses("yaw_rad"):
        StepLimits(yaw_rad=-0.1)
