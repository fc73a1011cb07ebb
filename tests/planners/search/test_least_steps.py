"""Least steps of toes and of the rotation: sides, plans, proofs, forged ones, closed forms, SCIP."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import StepLimits, half_space, parts, too_small
from stancekit.planners.projection.force_distribution import along, lengths_of
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.micp import NlpPlanner
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate, check_plan, explain
from tests.planners.oracle import OraclePrograms
from tests.refusals import assert_names, refuses

from .test_exact import scip

TILT_RAD = 0.03
FARTHEST_RAD = 2.0 * np.sqrt(3.0) * TILT_RAD
"""From one corner of the box |Θ| ≤ tilt to the other: no turn is larger."""


def least(course: Problem, **lengths: float) -> Problem:
    return replace(course, steps=replace(course.steps, **lengths))


def turned(course: Problem, share: float) -> Problem:
    steps = replace(course.steps, rotation_rad=0.5, least_rotation_rad=share * FARTHEST_RAD)
    return replace(course, tilt_limit_rad=TILT_RAD, steps=steps)


def stepped(course: Problem, share: float) -> Problem:
    """A course on which each toe has to go this share of what the corners of its patches are apart."""
    farthest = min(
        np.linalg.norm(one[:, None] - other, axis=2).max()
        for one, other in (
            [course.footholds[p].candidates[0].vertices_m for p in move] for move in course.moves
        )
    )
    return least(course, toe_m=2.0 * farthest, least_toe_m=share * farthest)


def test_sides_cover_all_directions_and_each_half_space_holds_its_own_long_enough_steps():
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(300, 3))
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    sides, seen, tightest = parts(None), 0, []
    assert len(sides) == 8
    for depth in range(4):
        within = np.array(
            [(np.linalg.solve(side.T, steps.T) >= -1e-9).all(axis=0) for side in sides]
        )
        assert within.any(axis=0).all()
        for side, inside in zip(sides, within, strict=True):
            normal, bound = np.split(half_space(side, 0.3), [3])
            assert np.linalg.norm(normal) == pytest.approx(1.0)
            assert (0.3 * steps[inside] @ normal >= bound).all()
            seen += int(inside.sum())
        tightest.append(min(half_space(side, 1.0)[3] for side in sides))
        if depth < 3:
            sides = [part for side in sides for part in parts(side)]
    assert seen >= 4 * len(steps)
    assert tightest[0] == pytest.approx(1.0 / np.sqrt(3.0))
    assert (np.diff(1.0 - np.array(tightest)) < 0.0).all()
    assert 1.0 - tightest[3] < 0.02
    assert not too_small(sides[0])


@pytest.mark.parametrize("make", [TwoStagePlanner, partial(ExactPlanner, max_nodes=20), NlpPlanner])
def test_plans_step_as_far_and_would_not_without(climb, programs, make):
    course = climb(4, frames=3)
    asked = least(course, least_toe_m=0.06, least_rotation_rad=0.04)
    planner = make(programs=programs)
    free, kept = planner.solve(course), planner.solve(asked)
    assert free.status is Status.FEASIBLE
    judged = check_plan(replace(free.solution, problem=asked))
    short = asked.least_steps - lengths_of(free.solution, asked)[1]
    toes = len(asked.moves)
    for name, worst in (
        ("least_toe_step", short[:toes].max()),
        ("least_rotation_step", short[toes:].max()),
    ):
        assert worst > 1e-3
        assert judged.group(name).value == pytest.approx(worst)
        assert judged.group(name).verdict == "violated"
    assert kept.status is Status.FEASIBLE
    assert kept.solution.problem.sides is None
    assert (lengths_of(kept.solution, asked)[1] >= asked.least_steps - 1e-6).all()
    assert check_plan(kept.solution).accepted
    assert kept.details["asked"] >= 2.0


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_a_turn_from_corner_to_corner_is_found_and_no_farther_one(climb, programs, share):
    course = climb(4, frames=2)
    found = TwoStagePlanner(programs=programs).solve(turned(course, share))
    assert found.status is Status.FEASIBLE
    refuted = TwoStagePlanner(programs=programs).solve(turned(course, 2.0 - share))
    assert refuted.status is Status.INFEASIBLE
    assert_names(explain(refuted.certificate).message, "steps.least_rotation_rad")


def test_a_toe_steps_from_corner_to_corner_and_no_farther(climb, programs):
    course = climb(4, frames=2)
    assert len(course.moves) >= 1
    found = TwoStagePlanner(programs=programs).solve(stepped(course, 0.6))
    assert found.status is Status.FEASIBLE
    refuted = TwoStagePlanner(programs=programs).solve(stepped(course, 1.05))
    assert refuted.status is Status.INFEASIBLE
    proof = refuted.certificate
    assert (proof.tree[:, 0] == 4.0).any()
    assert_names(explain(proof).message, "steps.least_toe_m")


def test_forged_proofs_are_refused(climb, programs):
    course = turned(climb(4, frames=2), 1.3)
    proof = TwoStagePlanner(programs=programs).solve(course).certificate
    assert check_certificate(proof).accepted
    feasible = turned(climb(4, frames=2), 0.5)
    assert not check_certificate(proof.of(feasible)).accepted
    assert not check_certificate(proof.of(climb(4, frames=2))).accepted  # it has no such rows
    tree = np.array(proof.tree)
    for forged, name in (
        (np.vstack([[4.0, 1.0, 0.0, 0.0, 0.0], tree[1:]]), "least step"),
        (np.vstack([[4.0, 0.0, 1.0, 0.0, 0.0], tree[1:]]), "least step"),
        (tree[:-1], "tree"),
        (np.tile([4.0, 0.0, 0.0, 0.0, 0.0], (20, 1)), "tree"),
    ):
        report = check_certificate(replace(proof, tree=forged))
        assert not report.accepted
        assert_names(report.message, name)
    one = replace(proof, tree=np.zeros((1, 5)), multipliers=proof.multipliers[:1])
    assert not check_certificate(one).accepted  # an open side proves nothing


def test_a_row_that_is_used_backwards_proves_nothing(climb, programs):
    course = turned(climb(4, frames=2), 1.3)
    proof = TwoStagePlanner(programs=programs).solve(course).certificate
    rows = np.array(proof.multipliers)
    rows[:, -1] *= -1.0
    assert not check_certificate(replace(proof, multipliers=rows)).accepted


def test_the_reference_solves_the_same_programs(climb, programs):
    course = least(climb(6, frames=3), least_toe_m=0.05, least_rotation_rad=0.03)
    free = TwoStagePlanner(programs=programs).solve(climb(6, frames=3))
    scaled = Scaled.of(along(course, free.solution))
    ours = solve_lift(programs, scaled, least_moment=False)
    theirs = solve_lift(OraclePrograms(), scaled, least_moment=False)
    assert ours.solved
    assert theirs.solved
    assert ours.bound == pytest.approx(theirs.bound, rel=1e-4)


@pytest.mark.parametrize("seed", [2])
def test_scip_agrees_on_the_problem_with_its_nonconvex_rows(climb, programs, seed):
    course = climb(seed, frames=2)
    for lengths in ({"least_toe_m": 0.08}, {"least_rotation_rad": 0.05}):
        asked = least(course, **lengths)
        outcome = ExactPlanner(programs=programs).solve(asked)
        best, bound = scip(asked, nodes=200)
        assert outcome.status is Status.FEASIBLE
        assert bound <= outcome.objective * 1.002
        assert outcome.bound <= best * 1.002


def test_within_the_time_limit_nothing_is_claimed(climb, programs):
    course = turned(climb(4, frames=2), 1.02)
    outcome = TwoStagePlanner(programs=programs, time_limit_s=1e-3).solve(course)
    assert outcome.status is Status.UNDECIDED
    assert outcome.certificate is None
    assert outcome.message


def test_a_course_without_them_has_neither_rows_nor_sides(climb):
    course = climb(4, frames=2)
    assert course.least_steps.shape == (0,)
    assert along(course, None) is course
    asked = least(course, least_toe_m=0.1)
    assert asked.least_steps.shape == (len(course.moves),)
    assert Problem.from_json(asked.to_json()).steps.least_toe_m == 0.1
    assert "sides" not in asked.to_json()
    assert "least_toe_m" not in course.to_json()["steps"]


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"least_toe_m": 0.4}, "least_toe_m"),
        ({"least_rotation_rad": 0.2}, "least_rotation_rad"),
        ({"least_toe_m": -0.1}, "least_toe_m"),
        ({"least_rotation_rad": float("nan")}, "least_rotation_rad"),
    ],
)
def test_bad_lengths_are_refused(changes, name):
    with refuses(name):
        StepLimits(**changes)


def test_sides_of_another_shape_are_refused(climb):
    with refuses("sides"):
        replace(climb(4, frames=2), sides=np.zeros((3, 4)))
