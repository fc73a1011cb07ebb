"""Nogoods: what one stance refutes is refuted in the course, on every part of the candidates that a
nogood covers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.choice import nearest
from stancekit.planners.search.cuts import Nogoods
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from tests.planners.oracle import with_choice

SEEDS = st.integers(0, 2**32 - 1)
SCENES = ((("wall-3", 234), 3, 2e-2), (("wall-3", 225), 2, 2e-3), (("ground-3", 86), 3, 2e-3))


def learned(programs, course, *choices):
    nogoods = Nogoods(programs, Scaled.of(course), Clock.start())
    for choice in choices or (np.zeros(len(course.footholds), dtype=int),):
        nogoods.learn(np.asarray(choice), float("inf"))
    return nogoods


@pytest.fixture(scope="module")
def hard(programs, drawn, as_course, rough):
    """(course, its nogoods) of courses that have some: of one frame with candidates to choose from,
    and of two; the last with patches cut, too.
    """
    made = [as_course(drawn(*scene), count, 0, spread) for scene, count, spread in SCENES]
    made.append(rough(2))
    found = [(course, learned(programs, course)) for course in made]
    with pytest.MonkeyPatch.context() as patch:  # patches are cut sooner than they would be
        patch.setattr("stancekit.planners.search.cuts.PATCH_UNIT_M", 0.05)
        found.append((made[0], learned(programs, made[0])))
    assert all(nogoods.entries for _, nogoods in found)
    return found


def restricted(course, opened):
    """The course with these candidates alone, and their new numbers."""
    number = np.cumsum(opened > 0.0, axis=1) - 1
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                patch for patch, is_open in zip(put.candidates, row, strict=False) if is_open
            ),
        )
        for put, row in zip(course.footholds, opened > 0.0, strict=True)
    )
    return replace(course, footholds=footholds), number


def proof(nogoods, number, opened, new):
    """The subtree of a nogood as a certificate of the restricted course."""
    tree, rows = nogoods.rows(number, opened)
    tree = np.array(tree)
    of_candidate = np.isin(tree[:, 0], (1.0, 2.0))
    p, r = tree[of_candidate, 1].astype(int), tree[of_candidate, 2].astype(int)
    tree[of_candidate, 2] = new[p, r]
    return Certificate(tree=tree, multipliers=np.array(rows))


@given(SEEDS)
@settings(max_examples=60)
def test_on_any_part_of_what_it_covers_its_subtree_is_a_proof(hard, seed):
    rng = np.random.default_rng(seed)
    course, nogoods = hard[int(rng.integers(len(hard)))]
    number = int(rng.integers(len(nogoods.entries)))
    there = Scaled.of(course).opened() * nogoods.entries[number].refuted
    opened = there * (rng.random(there.shape) < 0.5)
    for p in np.flatnonzero(opened.sum(axis=1) == 0.0):
        opened[p, rng.choice(np.flatnonzero(there[p]))] = 1.0
    assert nogoods.refuting(opened) is not None
    part, new = restricted(course, opened)
    assert check_certificate(proof(nogoods, number, opened, new).of(part)).accepted


def test_on_one_choice_only_cuts_and_forces_are_left_of_its_subtree(hard):
    choices = 0
    for course, nogoods in hard:
        for number, entry in enumerate(nogoods.entries):
            there = Scaled.of(course).opened() * entry.refuted
            tree, rows = nogoods.rows(number, np.eye(there.shape[1])[there.argmax(axis=1)])
            assert {row[0] for row in tree} <= {0.0, 2.0, 3.0}
            assert len(tree) == 2 * len(rows) - 1
            whole, more = nogoods.rows(number, there)
            choices += sum(row[0] == 1.0 for row in whole)
            assert len(rows) <= len(more)
    assert choices > 5


def test_rows_of_all_kinds_come_up(hard):
    kinds = {
        row[0] for _, nogoods in hard for entry in nogoods.entries for row in entry.root.rows()[0]
    }
    assert kinds == {0.0, 1.0, 2.0, 3.0}


def test_no_choice_that_a_nogood_covers_has_a_plan_and_some_that_none_covers_has(programs, hard):
    planner, seen = TwoStage(programs=programs), set()
    course, nogoods = hard[0]
    rng = np.random.default_rng(1)
    for choice in rng.integers(3, size=(8, 3)):
        covered = nogoods.refuting(np.eye(3)[choice]) is not None
        outcome = planner.solve(with_choice(course, choice))
        assert outcome.status is not Status.UNDECIDED
        assert not covered or outcome.status is Status.INFEASIBLE
        seen.add((covered, outcome.status))
    assert (True, Status.INFEASIBLE) in seen
    assert (False, Status.FEASIBLE) in seen


def test_what_a_nogood_covers_is_what_its_mask_says(hard):
    for course, nogoods in hard:
        everything = Scaled.of(course).opened()
        options, rng = everything.shape[1], np.random.default_rng(0)
        for _ in range(10):
            choice = np.array([rng.choice(np.flatnonzero(row)) for row in everything])
            only = np.eye(options)[choice]
            met = [bool((entry.refuted >= only).all()) for entry in nogoods.entries]
            assert (nogoods.refuting(only) is not None) == any(met)
            for p in range(len(choice)):
                count = nogoods.covering(choice, p)
                for r in range(options):
                    other = only.copy()
                    other[p] = np.eye(options)[r]
                    assert count[r] == sum(
                        (entry.refuted >= other).all() for entry in nogoods.entries
                    )


def test_blame_is_a_foothold_with_candidates_that_the_nogood_does_not_cover(hard):
    course, nogoods = hard[0]
    everything = Scaled.of(course).opened()
    for number, entry in enumerate(nogoods.entries):
        loose = nogoods.blame(number, everything)
        assert loose is not None
        assert (entry.refuted[loose] < everything[loose]).any()
        assert nogoods.blame(number, entry.refuted * everything) is None


def test_a_course_whose_stances_hold_teaches_nothing_and_nothing_is_looked_at_twice(climb):
    course = climb(1)
    programs, choice = Programs(), np.zeros(len(course.footholds), dtype=int)
    clock = Clock.start()
    nogoods = Nogoods(programs, Scaled.of(course), clock)
    assert not nogoods.learn(choice, float("inf"))
    solves = clock.solves
    assert solves >= len(course.stances)
    assert not nogoods.learn(choice, float("inf"))
    assert clock.solves == solves
    assert nogoods.refuting(Scaled.of(course).opened()) is None


def test_a_whole_search_that_ends_in_nogoods_has_a_certificate_of_all_of_them(
    programs, drawn, as_course
):
    course = as_course(drawn("wall-3", 225), 2)
    planner = TwoStage(programs=programs, time_limit_s=300.0)
    search = planner.search(Scaled.of(course), Clock.start())
    assert search.found is None
    assert search.certificate() is not None
    assert check_certificate(search.certificate().of(course)).accepted
    outcome = planner.solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert outcome.details["cuts"] == 0.0


def test_among_patches_of_which_most_cannot_be_held_the_search_finds_one_that_can(
    programs, drawn, as_course
):
    course = as_course(drawn("wall-3", 234), 3, 0, 2e-2)
    scaled, nogoods = Scaled.of(course), Nogoods(programs, Scaled.of(course), Clock.start())
    assert nogoods.learn(nearest(scaled), float("inf"))
    outcome = TwoStage(programs=programs).solve(course)
    assert outcome.status is Status.FEASIBLE
    assert check_plan(outcome.solution).accepted
    assert nogoods.refuting(np.eye(scaled.options)[outcome.solution.choice]) is None
