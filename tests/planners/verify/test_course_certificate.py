"""Proofs that a course has no plan: accepted where true, worthless where not, whatever multipliers
and trees say.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate
from stancekit.planners.verify.lagrangian import multiplier_count, multiplier_shapes
from stancekit.planners.verify.stances import Schedule
from tests.planners.oracle import with_choice
from tests.refusals import assert_names

PROGRAMS = Programs()
LEAF = (0, 0, 0, 0, 0)


@pytest.fixture(scope="module")
def slippery():
    """``slippery(friction, regions=1)``: the built-in walls of two frames, and the planner's
    answer.
    """
    base = read_course("walls", frames=2)

    def made(friction, regions=1):
        footholds = tuple(
            replace(
                put,
                candidates=tuple(
                    replace(put.candidates[0], friction=friction) for _ in range(regions)
                ),
            )
            for put in base.footholds
        )
        course = replace(base, footholds=footholds)
        return course, TwoStage(programs=PROGRAMS).solve(course)

    return made


def count_of(course):
    return multiplier_count(Schedule.of_course(course))


def leaf(row):
    return Certificate(tree=np.array([LEAF]), multipliers=np.atleast_2d(row))


def test_friction_decides_on_two_walls_and_every_no_is_proved(slippery):
    # A tripod has one limb on one side, which presses with at most the weight: both sides carry 2 μ
    # w at the most.
    said = {}
    for friction in (0.3, 0.45, 0.49, 0.7, 0.9):
        course, outcome = slippery(friction)
        said[friction] = outcome.status
        if outcome.status is Status.INFEASIBLE:
            proof = check_certificate(outcome.certificate.of(course))
            assert proof.accepted
            assert proof.figures["leaves"] == 1
            assert proof.message == outcome.message
    assert [said[mu] for mu in (0.3, 0.45, 0.49)] == [Status.INFEASIBLE] * 3
    assert said[0.9] is Status.FEASIBLE


def test_the_same_proof_says_nothing_of_a_course_with_more_friction_or_reach(slippery):
    course, outcome = slippery(0.45)
    for friction in (0.6, 0.9):
        assert slippery(friction)[1].status is Status.FEASIBLE
        assert not check_certificate(outcome.certificate.of(slippery(friction)[0])).accepted
    stronger = replace(course, force_max=3.0 * course.force_max, force_min=3.0 * course.force_min)
    assert not check_certificate(outcome.certificate.of(stronger)).accepted


@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-3, 1e3), few=st.booleans())
@settings(max_examples=40)
def test_no_multipliers_refute_a_course_that_has_a_plan(walk, seed, size, few):
    course, rng = walk(3, "tripod").problem, np.random.default_rng(seed)
    row = size * rng.normal(size=count_of(course))
    if few:
        row *= rng.random(row.size) < 0.05
    proof = check_certificate(leaf(row).of(course))
    assert not proof.accepted
    assert_names(proof.message, "leaf 0")


@given(scale=st.floats(1e-3, 1e3), noise=st.floats(0.0, 1e-4), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_proof_is_a_ray_any_length_will_do_and_small_errors_do_no_harm(
    slippery, scale, noise, seed
):
    course, outcome = slippery(0.3)
    row = outcome.certificate.multipliers[0]
    moved = scale * (row + noise * np.random.default_rng(seed).normal(size=row.size))
    shapes = multiplier_shapes(Schedule.of_course(course))
    first = sum(int(np.prod(shape)) for name, shape in shapes.items() if name != "toe_step")
    at = slice(first - (course.frames - 1), first)
    moved[at] = np.maximum(moved[at], 0.0)  # of progress: an inequality
    assert check_certificate(leaf(moved).of(course)).accepted


def test_multipliers_of_progress_have_a_sign(slippery):
    course, outcome = slippery(0.3)
    shapes = multiplier_shapes(Schedule.of_course(course))
    names = list(shapes)
    before = sum(int(np.prod(shapes[name])) for name in names[: names.index("progress")])
    row = outcome.certificate.multipliers[0].copy()
    row[before] = -1e-6
    assert not check_certificate(leaf(row).of(course)).accepted


def test_random_infeasible_courses_are_proved_and_their_proofs_do_not_fit_feasible_ones():
    rng = np.random.default_rng(3)
    base = read_course("walls", frames=2)
    proofs, feasible = [], []
    for _ in range(16):
        footholds = tuple(
            replace(
                put,
                candidates=(replace(put.candidates[0], friction=float(rng.uniform(0.25, 0.75))),),
            )
            for put in base.footholds
        )
        robot = replace(
            base.robot,
            limbs=tuple(
                replace(limb, reach_m=limb.reach_m * rng.uniform(0.8, 1.2))
                for limb in base.robot.limbs
            ),
        )
        course = replace(base, footholds=footholds, robot=robot)
        outcome = TwoStage(programs=PROGRAMS).solve(course)
        if outcome.status is Status.FEASIBLE:
            feasible.append(course)
        else:
            assert outcome.status is Status.INFEASIBLE, outcome.message
            proofs.append((course, outcome.certificate))
    assert len(proofs) > 3
    assert len(feasible) > 3
    assert all(check_certificate(proof.of(course)).accepted for course, proof in proofs)
    assert not any(
        check_certificate(proof.of(course)).accepted for course in feasible for _, proof in proofs
    )


def test_a_tree_must_cover_every_choice(slippery):
    course, outcome = slippery(0.3, regions=2)
    assert outcome.status is Status.INFEASIBLE
    row = outcome.certificate.multipliers[0]
    both = np.array([row, row])
    good = Certificate(tree=np.array([(1, 0, 1, 0, 0), LEAF, LEAF]), multipliers=both)
    assert check_certificate(good.of(course)).accepted
    faults = (
        ("tree", [(1, 0, 1, 0, 0), LEAF], both[:1]),
        ("tree[1]", [LEAF, LEAF], both),
        ("2 leaves", [(1, 0, 1, 0, 0), LEAF, LEAF], both[:1]),
        ("1 leaves", [LEAF], both),
        ("candidate", [(1, 0, 2, 0, 0), LEAF, LEAF], both),
        ("foothold", [(1, 99, 0, 0, 0), LEAF, LEAF], both),
        ("tree", [(0, 1)], both[:1]),
        ("multipliers", [LEAF], both[:1, :-1]),
        ("certificate", [LEAF], np.full_like(both[:1], np.nan)),
    )
    for name, tree, rows in faults:
        proof = check_certificate(Certificate(tree=np.array(tree), multipliers=rows).of(course))
        assert not proof.accepted
        assert_names(proof.message, name)


def test_a_leaf_must_refute_all_candidates_that_are_open_there(slippery):
    course, outcome = slippery(0.3, regions=2)
    row = outcome.certificate.multipliers[0]
    better = tuple(
        replace(put, candidates=(put.candidates[0], replace(put.candidates[1], friction=1.0)))
        for put in course.footholds
    )
    mixed = replace(course, footholds=better)
    assert not check_certificate(leaf(row).of(mixed)).accepted
    chain, rows = [(1, p, 0, 0, 0) for p in range(len(better))], [row] * len(better)
    # Only where every foothold takes its first candidate does the row prove anything; the other
    # leaves do not.
    tree = [*chain, *[LEAF] * (len(chain) + 1)]
    proof = check_certificate(
        Certificate(tree=np.array(tree), multipliers=np.array([*rows, row])).of(mixed)
    )
    assert not proof.accepted
    assert check_certificate(leaf(row).of(with_choice(mixed, [0] * len(better)))).accepted


def test_moves_are_those_of_the_schedule(walk):
    course = walk(4, "wave").problem
    moves = Schedule.of_course(course).moves
    assert len(moves) == 3
    for (before, after), lifted in zip(moves, course.lifts[1:], strict=True):
        assert course.footholds[before].limb == course.footholds[after].limb == lifted[0]
        assert course.footholds[after].frame > course.footholds[before].frame
