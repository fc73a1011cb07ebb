"""The lift over key frames: against the same model written a second time, against one posture's, and as a bound."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.conic import ConicStatus
from stancekit.planners.contact.lift import LiftModel
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.keyframes.clock import Clock
from stancekit.planners.keyframes.lift import LiftedCourse
from stancekit.planners.keyframes.scaled import ScaledCourse


@pytest.mark.parametrize(
    ("seeds", "shape"),
    [((1, 3, 4), {}), ((0, 5), {"regions": 2, "ice": 0.4}), ((4, 5), {"frames": 3})],
    ids=["two frames", "two regions", "three frames"],
)
def test_its_least_objective_is_that_of_the_model_written_a_second_time(seeds, shape, climb, written, models):
    answers = set()
    for seed in seeds:
        course = climb(seed, **shape)
        scaled = ScaledCourse.of(course)
        ours = models.lift(scaled, Clock.start()).solve(scaled)
        problem, _ = written(course)
        problem.solve(cp.CLARABEL)
        assert (ours.status is ConicStatus.INFEASIBLE) == (problem.status == cp.INFEASIBLE)
        if ours.status is ConicStatus.SOLVED:
            assert ours.objective * course.length_scale_m**2 == pytest.approx(problem.value, rel=1e-5, abs=1e-8)
        answers.add(ours.status)
    assert answers == {ConicStatus.SOLVED, ConicStatus.INFEASIBLE}


def test_with_one_frame_and_one_stance_it_leaves_the_moments_that_one_postures_lift_leaves(climb):
    seen = []
    for seed in range(8):
        course = climb(seed, frames=1)
        scaled = ScaledCourse.of(course)
        if not seen:
            soft = LiftedCourse(scaled.layout, course.weights, course.length_scale_m, scaled, soft=True)
        assert len(course.stances) == 1
        problem = ScaledProblem.of(course.posture_problem(course.stances[0], np.zeros(4, dtype=int)))
        alone, ours = LiftModel(3, 4, whole_box=True).solve(problem), soft.solve(scaled)
        if np.isfinite(alone.bound) and ours.status is ConicStatus.SOLVED:
            # The fourth limb must be in reach, too: that can only leave more.
            assert ours.residual >= alone.bound - 1e-6
            seen.append(ours.residual - alone.bound)
    assert len(seen) > 4
    assert np.sum(np.abs(seen) < 1e-6) > 4


def test_shares_of_a_toe_sum_to_one_and_toes_are_on_their_patches(climb, models):
    course = climb(0, regions=2, ice=0.4)
    scaled = ScaledCourse.of(course)
    lifted = models.lift(scaled, Clock.start()).solve(scaled)
    np.testing.assert_allclose(lifted.shares.sum(axis=1), 1.0, atol=1e-6)
    choice, toes = lifted.rounded()
    for p, put in enumerate(course.placements):
        patch = put.candidates[choice[p]]
        off = toes[p] * course.length_scale_m - patch.centre_m
        assert abs(off @ patch.normal) < 1e-6
        assert np.linalg.norm(off) < 0.08


def test_closing_slots_never_lowers_the_objective_and_a_closed_slot_has_no_share(climb, models):
    course = climb(4, regions=2, ice=0.4)
    scaled = ScaledCourse.of(course)
    lift = models.lift(scaled, Clock.start())
    whole, rng, looked_at = lift.solve(scaled), np.random.default_rng(0), 0
    for _ in range(6):
        opened = np.ones((len(course.placements), 2))
        p, r = int(rng.integers(len(opened))), int(rng.integers(2))
        opened[p, r] = 0.0
        part = lift.solve(scaled.only(opened))
        if part.status is ConicStatus.SOLVED:
            assert part.objective >= whole.objective - 1e-7
            assert part.shares[p, r] < 1e-6
            looked_at += 1
    assert looked_at > 2
