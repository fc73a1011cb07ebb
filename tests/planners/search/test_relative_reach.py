"""Reach of feet from one another, from a course to an answer: closed forms, proofs, forged answers,
other planners.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.problem import Problem
from stancekit.planners.robot.model import ReachRows, RelativeReach
from stancekit.planners.search.micp import Decoupled, Nlp
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses

SEEDS = range(8)


def farthest(course: Problem, toes_m: np.ndarray) -> float:
    """How far a foot that moved is beyond a half-space, one after the other [m]."""
    names, worst = course.robot.limb_names, -np.inf
    for frame, lifted in enumerate(course.lifts):
        for pair in course.robot.relative_reach:
            if pair.limb in lifted:
                here, there = (
                    course.holds[frame, names.index(name)] for name in (pair.limb, pair.other)
                )
                apart = toes_m[there] - toes_m[here]
                worst = max(worst, float((pair.rows.normals @ apart - pair.rows.bounds_m).max()))
    return worst


@pytest.mark.parametrize("make", [TwoStage, Nlp, Decoupled])
def test_plans_keep_feet_within_reach_of_one_another(ragged, paired, programs, make):
    """And what a planner finds without it does not, so that there is something to keep."""
    planner, found, broken = make(programs=programs), 0, 0
    for seed in SEEDS:
        free = ragged(seed, frames=2, ice=0.0)
        course = paired(free, seed, 0.06)
        outcome = planner.solve(course)
        if outcome.solution is not None:
            found += 1
            assert check_plan(outcome.solution).accepted
            assert farthest(course, outcome.solution.toes_m) <= 1e-6
        without = planner.solve(free)
        broken += without.solution is not None and farthest(course, without.solution.toes_m) > 1e-3
    assert found > 0
    assert broken > 0


def test_proofs_are_verified_and_prove_nothing_of_a_course_that_has_a_plan(
    ragged, paired, programs
):
    planner, proved, rng = (
        TwoStage(programs=programs, time_limit_s=600.0),
        0,
        np.random.default_rng(3),
    )
    for seed in SEEDS:
        free = ragged(seed, frames=2)
        if planner.solve(free).status is not Status.FEASIBLE:
            continue
        tight = paired(free, seed, 0.004)
        proof = planner.solve(tight).certificate
        if proof is None:
            continue
        proved += 1
        assert check_certificate(proof.of(tight)).accepted
        wide = paired(free, seed, 5.0)
        assert planner.solve(wide).status is Status.FEASIBLE
        for scale in (0.0, 0.1, 1.0):
            noise = np.abs(rng.normal(scale=scale, size=proof.multipliers.shape))
            forged = Certificate(tree=proof.tree, multipliers=proof.multipliers + noise)
            assert not check_certificate(forged.of(wide)).accepted
    assert proved > 0


def test_a_half_space_that_cuts_a_step_off_decides_it_to_a_millimetre(ragged, programs):
    """All limbs have room but one pair, whose distance along x is pinned beyond what the patches
    leave.
    """
    planner = TwoStage(programs=programs, time_limit_s=600.0)
    free = next(
        c
        for c in (ragged(s, frames=2) for s in SEEDS)
        if planner.solve(c).status is Status.FEASIBLE
    )
    limb = free.lifts[1][0]
    other = next(name for name in free.robot.limb_names if name != limb)
    feet = [free.holds[1, free.robot.limb_names.index(name)] for name in (limb, other)]
    corners = [
        np.concatenate([patch.vertices_m for patch in free.footholds[p].candidates])[:, 0]
        for p in feet
    ]
    toe_m = free.footholds[feet[1]].toe_m
    most = float((corners[1].max() if toe_m is None else toe_m[0]) - corners[0].min())
    for beyond, holds in ((1e-3, False), (-5.0, True)):
        rows = ReachRows(normals=[[-1.0, 0.0, 0.0]], bounds_m=[-(most + beyond)])
        pair = RelativeReach(limb=limb, other=other, rows=rows)
        outcome = planner.solve(replace(free, robot=replace(free.robot, relative_reach=(pair,))))
        assert outcome.status is (Status.FEASIBLE if holds else Status.INFEASIBLE)


def test_a_toe_that_is_drawn_away_is_a_foot_out_of_reach(ragged, paired, programs):
    planner = TwoStage(programs=programs, time_limit_s=600.0)
    plans = [planner.solve(paired(ragged(seed, frames=2), seed, 0.2)).solution for seed in SEEDS]
    plan = next(plan for plan in plans if plan is not None)
    toes = plan.toes_m.copy()
    toes[-1] += 1.0
    report = check_plan(replace(plan, toes_m=toes))
    worst = {group.name: group for group in report.groups}["relative_reach"]
    assert worst.value == pytest.approx(farthest(plan.problem, toes))
    assert worst.frame == plan.problem.footholds[-1].frame
    assert not report.accepted


def test_it_survives_its_file(ragged, paired):
    course = paired(ragged(3, frames=2), 3)
    again = Problem.from_json(course.to_json())
    assert again.to_json() == course.to_json()
    assert len(again.robot.relative_reach) == 12


def test_pairs_that_are_none_are_refused(ragged, paired):
    robot = paired(ragged(3, frames=2), 3).robot
    pair = robot.relative_reach[0]
    with refuses("relative_reach"):
        replace(pair, limb="LF", other="LF")
    with refuses("relative_reach"):
        replace(robot, relative_reach=(pair, pair))
    with refuses("leg", "tail"):
        replace(robot, relative_reach=(replace(pair, other="tail"),))
