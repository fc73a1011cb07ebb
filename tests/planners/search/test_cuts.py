"""Cuts in space: postures as courses of one frame, courses of several, and every proof through the
verifier.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.cuts import (
    MARGIN,
    CutSearch,
    FarkasCuts,
    alone,
    cut,
    halving_chord,
    of_stance,
    split,
    spreads,
)
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from stancekit.planners.verify.geometry import cut as cut_again, sag
from tests.planners.oracle import with_choice

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
                accepted = check_certificate(proof.of(with_choice(course, other))).accepted
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
                    assert check_certificate(proof.of(with_choice(course, choice))).accepted
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


SEEDS = st.integers(0, 2**32 - 1)
CUT = [("wall-3", seed) for seed in (225, 234, 250, 275, 384)] + [
    ("ground-3", 86),
    ("ground-3", 215),
]
"""Postures that the lift admits and cuts refute."""
EASY = [("wall-3", seed) for seed in range(12)] + [("ground-3", seed) for seed in range(6)]


def searched(programs, scaled, *, gap=1e-5, max_nodes=500):
    search = CutSearch(
        programs,
        scaled,
        gap=gap,
        tolerance=1e-6,
        max_nodes=max_nodes,
        deadline=time.perf_counter() + 60.0,
    )
    search.run()
    return search


# ----------------------------------------------------------------------------------------- a
# posture is a plan of one


@pytest.mark.parametrize("scene", [*CUT, *EASY], ids=str)
def test_a_posture_gets_the_same_verdict_as_a_course_of_one_frame(
    programs, drawn, as_course, scene
):
    problem = drawn(*scene)
    course = as_course(problem)
    posture, plan = (
        Exact(programs=programs).solve(problem),
        TwoStage(programs=programs).solve(course),
    )
    assert posture.status is plan.status is not Status.UNDECIDED
    if plan.status is Status.FEASIBLE:
        assert check_plan(plan.solution).accepted
        return
    assert check_certificate(plan.certificate.of(course)).accepted
    assert check_certificate(
        posture.certificate.of(course)
    ).accepted  # either proof is one of the other
    if scene in CUT:
        assert len(plan.certificate.multipliers) > 1


def test_their_lifts_are_the_same_number_for_number(programs, drawn, as_course):
    for scene in [*CUT, *EASY]:
        ours, theirs = (Scaled.of(subject) for subject in (drawn(*scene), as_course(drawn(*scene))))
        assert ours.layout == theirs.layout
        ours, theirs = (
            solve_lift(programs, scaled, least_moment=True) for scaled in (ours, theirs)
        )
        assert ours.bound == pytest.approx(theirs.bound, abs=1e-12)


# ------------------------------------------------------------------------------------------------------
# of all sorts


def test_what_cuts_find_or_refute_the_verifier_accepts_whatever_polygons_ice_and_toes_there_are(
    programs, rough, climb
):
    kinds, found = set(), 0
    courses = [rough(seed) for seed in range(6)] + [
        rough(seed, frames=1, regions=2, ice=0.3) for seed in range(6)
    ]
    for course in [*courses, climb(0), climb(2), climb(3, frames=1)]:
        scaled = Scaled.of(course)
        search = searched(programs, scaled)
        assert (search.found is None) != (search.certificate() is None)
        if search.found is None:
            kinds |= set(search.certificate().tree[:, 0])
            assert check_certificate(search.certificate().of(course)).accepted
        else:
            found += 1
            plan = plan_of(course, scaled, *search.found, provenance={})
            assert check_plan(plan).accepted
    assert kinds >= {0.0, 3.0}
    assert found >= 3


def test_what_pieces_of_a_bent_patch_leave_out_costs_no_proof(programs, rough):
    """The verifier takes it off every bound: where the least moment is as small, the patch is not
    to be cut.
    """
    course = rough(775284, regions=2)
    share = 0.85
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                patch.with_friction(share * patch.friction) for patch in put.candidates
            ),
        )
        for put in course.footholds
    )
    course = replace(course, footholds=footholds)
    outcome = TwoStage(programs=programs).solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert set(outcome.certificate.tree[:, 0]) == {0.0, 1.0, 3.0}
    assert check_certificate(outcome.certificate.of(course)).figures["lower_bound"] < 2e-5
    bent = [
        sag(patch.vertices_m / course.length_scale_m)
        for put in footholds
        for patch in put.candidates
    ]
    assert max(bent) > 5e-5


def test_a_certificate_has_choices_cuts_and_forces_where_patches_are_torn_and_large(
    programs, drawn, as_course
):
    kinds = set()
    for scene, candidates in ((("wall-3", 234), 2), (("ground-3", 86), 2)):
        problem = drawn(*scene)
        course = as_course(problem, candidates)
        search = searched(programs, Scaled.of(course))
        report = check_certificate(search.certificate().of(course))
        assert report.accepted
        assert report.figures["leaves"] == len(search.certificate().multipliers) > 5
        kinds |= set(search.certificate().tree[:, 0])
    course = as_course(drawn("wall-3", 234), 3, seed=0, spread_m=2e-2)
    whole = Scaled.of(course)
    for r in range(3):
        opened = whole.opened()
        opened[0] = np.eye(3)[r]
        search = searched(programs, whole.only(opened))
        if search.found is None:
            kinds |= {row[0] for row in search.root.rows()[0]}
    assert kinds >= {0.0, 1.0, 3.0}


def test_a_stance_that_cannot_be_held_alone_refutes_the_course_and_a_plan_holds_every_stance(
    programs, climb, rough
):
    refuted = held = 0
    for course in [
        climb(0),
        climb(2),
        climb(1),
        climb(3, frames=3),
        *(rough(seed) for seed in range(4)),
    ]:
        scaled = Scaled.of(course)
        stances = [
            searched(programs, alone(scaled, index)[0]).found is not None
            for index in range(len(course.stances))
        ]
        outcome = TwoStage(programs=programs).solve(course)
        if outcome.status is Status.FEASIBLE:
            assert all(stances)
            held += 1
        elif not all(stances):
            assert outcome.status is Status.INFEASIBLE
            refuted += 1
    assert held >= 2
    assert refuted >= 2


def test_at_its_limits_it_says_so_and_proves_nothing(programs, drawn):
    scaled = Scaled.of(drawn("wall-3", 225))
    for limits in ({"max_nodes": 1, "deadline": np.inf}, {"max_nodes": 100, "deadline": 0.0}):
        search = CutSearch(programs, scaled, gap=1e-4, tolerance=1e-6, **limits)
        search.run()
        assert search.found is search.certificate() is None
        assert search.stopped == "stopped at the time, node or solver limit"


def test_the_same_problem_gets_the_same_tree_whatever_was_searched_before(programs, drawn, rough):
    scaled = Scaled.of(drawn("wall-3", 384))
    first = searched(programs, scaled).certificate()
    searched(programs, Scaled.of(rough(2)))
    searched(programs, Scaled.of(drawn("ground-3", 215)))
    again = searched(programs, scaled).certificate()
    np.testing.assert_array_equal(first.tree, again.tree)
    np.testing.assert_array_equal(first.multipliers, again.multipliers)


def test_spreads_are_what_sums_over_vertices_say(programs, climb):
    lift = solve_lift(programs, Scaled.of(climb(4, regions=2)), least_moment=True)
    layout = lift.scaled.layout
    of_contact, vertex = layout.contact_vertices
    expected = np.zeros((len(layout.contacts[0]), 3))
    for b in range(len(layout.contacts[0])):
        rows = [row for row in range(len(of_contact)) if of_contact[row] == b]
        mean = sum(lift.by_vertex[row] for row in rows)
        for axis in range(3):
            total = 0.0
            for row in rows:
                share = lift.weights[vertex[row]]
                total += share * (lift.by_vertex[row, axis] / max(share, 1e-9) - mean[axis]) ** 2
            expected[b, axis] = np.sqrt(total)
    assert expected.max() > 0.01
    np.testing.assert_allclose(spreads(lift), expected, rtol=1e-9, atol=1e-12)


# -----------------------------------------------------------------------------------------------------------
# pieces


@given(SEEDS)
def test_planner_and_verifier_cut_patches_alike(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    piece = np.column_stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(angle)])
    for _ in range(4):
        chord = halving_chord(piece)
        for mine, theirs in zip(cut(piece, *chord), cut_again(piece, *chord), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        first, second = np.sort(rng.uniform(0.0, len(piece), 2))
        for mine, theirs in zip(
            cut(piece, first, second), cut_again(piece, first, second), strict=True
        ):
            np.testing.assert_allclose(mine, theirs, atol=1e-12)
        piece = cut(piece, *chord)[int(rng.integers(2))]


def test_a_triangle_is_halved_by_the_median_to_its_longest_edge():
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    assert halving_chord(triangle) == (0.0, 1.5)
    one, other = cut(triangle, 0.0, 1.5)
    np.testing.assert_allclose(one, [[0, 0, 0], [1, 0, 0], [0.5, 2, 0]])
    np.testing.assert_allclose(other, [[0.5, 2, 0], [0, 4, 0], [0, 0, 0]])
    assert halving_chord(np.vstack([triangle, [-1.0, 1.0, 0.0]])) == (0.0, 2.0)
