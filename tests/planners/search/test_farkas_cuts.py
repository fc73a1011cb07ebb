"""Farkas cuts: a table that refutes no more than the verifier does, and whose blame is its own
entries'.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.cuts import MARGIN, FarkasCuts, alone, of_stance, split
from stancekit.planners.verify import check_certificate

TORN = {"regions": 2, "ice": 0.5}
LEAF = [[0.0, 0.0, 0.0, 0.0, 0.0]]


def pulled(course: Problem, share: float) -> Problem:
    """The course with another force and moment on the body at every frame, of up to this share of
    the weight.
    """
    unit = course.weight_n * np.array([1.0, 1.0, 1.0, *(0.3 * course.length_scale_m,) * 3])
    wrench = np.random.default_rng(7).uniform(-share, share, (course.frames, 6)) * unit
    return replace(course, wrench=wrench) if share else course


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_cut_refutes_exactly_the_parts_for_which_the_verifier_accepts_it(climb, programs, share):
    agreed = {True: 0, False: 0}
    for seed in range(6):
        course = pulled(climb(seed, **TORN), share)
        scaled, rng = Scaled.of(course), np.random.default_rng(seed)
        for _ in range(4):
            choice = rng.integers(2, size=len(course.footholds))
            lifted = solve_lift(programs, scaled.chosen(choice), least_moment=False)
            if lifted.status is not ConicStatus.INFEASIBLE:
                continue
            row, cuts = lifted.multipliers, FarkasCuts(scaled)
            assert cuts.add(row) == 0
            for other in (choice, *rng.integers(2, size=(4, len(choice)))):
                proof = Certificate(tree=LEAF, multipliers=row[None])
                accepted = check_certificate(proof.of(course.with_choice(other))).accepted
                said = cuts.refuting(np.eye(2)[other]) is not None
                assert not said or accepted
                if said != accepted:  # only a bound between zero and the margin
                    assert cuts.refuting(np.eye(2)[other]) is None
                    tables = cuts.tables[0][np.arange(len(other)), other].sum() + cuts.constants[0]
                    assert -1e-4 < tables <= MARGIN
                agreed[said] += 1
    assert min(agreed.values()) > 5


def test_relief_is_the_share_that_the_kindest_candidates_take_from_every_cut_that_refutes_a_choice(
    climb, programs
):
    course = climb(5, **TORN)
    scaled = Scaled.of(course)
    lifted = solve_lift(programs, scaled, least_moment=False)
    assert lifted.status is ConicStatus.INFEASIBLE
    cuts = FarkasCuts(scaled)
    opened, choice = scaled.opened(), np.zeros(scaled.layout.footholds, dtype=int)
    np.testing.assert_array_equal(cuts.relief(choice, opened), 0.0)
    cuts.add(lifted.multipliers)
    cuts.add(1e-5 * lifted.multipliers)  # proves less than the margin, and counts for nothing
    table = cuts.tables[0]
    share = (table[:, 0] - table.min(axis=1)) / (table[:, 0].sum() + cuts.constants[0])
    assert share.max() > 1e-6
    np.testing.assert_allclose(cuts.relief(choice, opened), share)
    cuts.add(2.0 * lifted.multipliers)
    np.testing.assert_allclose(cuts.relief(choice, opened), 2.0 * share)
    closed = opened * [1.0, 0.0]
    np.testing.assert_array_equal(cuts.relief(choice, closed), 0.0)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_what_refutes_one_stance_alone_refutes_the_course(climb, programs, share):
    refuted = 0
    for seed in range(4):
        course = pulled(climb(seed, **TORN), share)
        scaled = Scaled.of(course)
        for choice in np.random.default_rng(seed).integers(2, size=(3, len(course.footholds))):
            cuts = FarkasCuts(scaled)
            for stance in range(len(course.stances)):
                lifted = solve_lift(
                    programs, alone(scaled.chosen(choice), stance)[0], least_moment=True
                )
                if lifted.bound > MARGIN:
                    row = of_stance(scaled, stance, lifted)
                    proof = Certificate(tree=LEAF, multipliers=row[None])
                    assert check_certificate(proof.of(course.with_choice(choice))).accepted
                    cuts.add(row)
                    refuted += 1
            only = np.eye(2)[choice]
            assert (cuts.refuting(only) is not None) == bool(cuts.rows)
    assert refuted > 5


def test_on_odd_polygons_with_toes_that_stand_and_several_candidates_it_is_never_bolder_than_the_verifier(
    programs, rough, climb
):
    said = {True: 0, False: 0}
    for seed in range(10):
        course = (
            rough(seed, regions=3, ice=0.5)
            if seed % 2
            else climb(seed, frames=3, regions=2, ice=0.6)
        )
        course = pulled(course, 0.2 * (seed % 3))
        scaled, rng = Scaled.of(course), np.random.default_rng(seed)
        lifted = solve_lift(programs, scaled, least_moment=False)
        if lifted.status is not ConicStatus.INFEASIBLE:
            continue
        cuts = FarkasCuts(scaled)
        for strength in (1.0, 0.1, 0.01):  # what a perturbed ray still refutes
            row = lifted.multipliers + (1.0 - strength) * 0.02 * rng.normal(
                size=lifted.multipliers.shape
            )
            progress = split(scaled, row)["progress"]
            np.maximum(
                progress, 0.0, out=progress
            )  # a view: multipliers of inequalities are not negative
            number = cuts.add(row)
            least = np.where(scaled.opened() > 0.0, cuts.tables[number], np.inf).min(axis=1).sum()
            refutes = bool(least + cuts.constants[number] > MARGIN)
            accepted = check_certificate(
                Certificate(tree=LEAF, multipliers=row[None]).of(course)
            ).accepted
            assert accepted or not refutes
            said[refutes] += 1
    assert said[True] >= 3


def test_the_groups_of_a_row_are_those_of_the_certificate(climb):
    course = climb(1, frames=3)
    scaled, layout = Scaled.of(course), Scaled.of(course).layout
    stances, frames, limbs, moves = len(layout.stances), 3, 4, len(layout.moves)
    count = 6 * stances + 3 * frames * limbs + 7 * (frames - 1) + 3 * moves
    parts = split(scaled, np.arange(float(count)))
    shapes = {name: part.shape for name, part in parts.items()}
    assert shapes == {
        "nu_F": (stances, 3),
        "nu_M": (stances, 3),
        "reach": (frames, limbs, 3),
        "com_step": (frames - 1, 3),
        "rotation_step": (frames - 1, 3),
        "progress": (frames - 1,),
        "toe_step": (moves, 3),
        "reach_rows": (frames, 0),
        "relative_reach": (0,),
        "linear_step": (frames - 1, 0),
    }
    np.testing.assert_array_equal(
        np.concatenate([part.ravel() for part in parts.values()]), np.arange(count)
    )
