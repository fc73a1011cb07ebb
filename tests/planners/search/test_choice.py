"""The search over patches: against every choice tried one by one, and at its limits."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.choice import ChoiceSearch, _preference, nearest
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate
from tests.planners.oracle import with_choice
from tests.refusals import assert_names

TORN = {"regions": 2, "ice": 0.5}


@pytest.fixture(scope="module")
def planner(programs):
    return TwoStage(programs=programs)


def test_the_search_says_what_trying_every_choice_says(climb, planner):
    best = TwoStage(programs=planner.programs, gap=1e-4)
    seen = set()
    for seed in (5, 8):
        course = climb(seed, **TORN)
        singly = [
            best.solve(with_choice(course, choice))
            for choice in itertools.product(range(2), repeat=len(course.footholds))
        ]
        objectives = [outcome.objective for outcome in singly if outcome.status is Status.FEASIBLE]
        first, whole = planner.solve(course), best.solve(course)
        seen.add(first.status)
        if objectives:
            assert first.status is whole.status is Status.FEASIBLE
            assert first.objective >= min(objectives) * (1.0 - 1e-4)
            assert whole.objective <= min(objectives) * 1.001
            assert whole.bound <= min(objectives) * (1.0 + 1e-6)
        else:
            assert first.status is Status.INFEASIBLE
            assert all(outcome.status is Status.INFEASIBLE for outcome in singly)
            assert check_certificate(first.certificate.of(course)).accepted
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}


def test_with_other_polygons_and_not_equally_many_candidates_it_says_so_too(rough, planner):
    seen = set()
    for seed in (0, 1, 5, 6):
        course = rough(seed, regions=2, ice=0.3)
        counts = [len(put.candidates) for put in course.footholds]
        assert min(counts) < max(counts)
        singly = [
            planner.solve(with_choice(course, choice))
            for choice in itertools.product(*map(range, counts))
        ]
        outcome = planner.solve(course)
        seen.add(outcome.status)
        assert (outcome.status is Status.FEASIBLE) == any(
            one.status is Status.FEASIBLE for one in singly
        )
        if outcome.status is Status.INFEASIBLE:
            assert check_certificate(outcome.certificate.of(course)).accepted
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}


def test_nearest_is_the_first_candidate_with_friction(climb):
    scaled = Scaled.of(climb(3, regions=3, ice=0.6))
    friction = scaled.friction.reshape(-1, 3)
    choice = nearest(scaled)
    for row, r in zip(friction, choice, strict=True):
        assert row[r] > 0.0 or not row.any()
        assert not row[:r].any()
    assert choice.max() > 0


def test_a_dive_never_takes_a_candidate_that_there_is_not_however_many_cuts_speak_for_it(
    programs, rough
):
    """A foothold with one candidate has nothing to weigh; what is missing has no entry in any
    cut.
    """
    course = rough(0, regions=3)
    scaled = Scaled.of(course)
    counts = np.array([len(put.candidates) for put in course.footholds])
    assert counts.min() == 1
    assert counts.max() == 3
    search = ChoiceSearch(programs, scaled, lambda *_: None, Clock.start(1.0), max_nodes=1)
    cuts = search._cuts
    cuts.tables = np.tile(
        np.where(scaled.opened() > 0.0, 1.0, np.inf), (20, 1, 1)
    )  # violated by every choice
    cuts.constants = np.zeros(20)
    for start in range(5):
        choice = search._dive(_preference(scaled), nearest(scaled), np.random.default_rng(start))
        assert (choice < counts).all()


def test_a_rounding_that_a_cut_refutes_is_mended_to_the_nearest_that_it_admits(
    programs, climb, monkeypatch
):
    scaled, tried = Scaled.of(climb(5, **TORN)), []
    refuted = nearest(scaled)
    search = ChoiceSearch(programs, scaled, lambda *_: None, Clock.start(60.0), max_nodes=1)
    monkeypatch.setattr(search, "_try", lambda choice, **_: tried.append(choice))
    shares = np.eye(scaled.options)[refuted]
    search._cuts.rows, search._cuts.tables = [np.zeros(1)], shares[None]
    search._cuts.constants = np.array([0.5 - len(refuted)])  # of all of it, and of nothing less
    search._mend(refuted, np.log(shares + 0.02))
    assert [int((choice != refuted).sum()) for choice in tried] == [1]


def test_at_its_limit_it_says_which_and_keeps_the_plan_that_it_has(climb, programs):
    course = climb(8, **TORN)
    assert not TwoStage(programs=programs).solve(course).details["guessed"]
    outcome = TwoStage(programs=programs, time_limit_s=0.0).solve(course)
    assert outcome.status is Status.UNDECIDED
    assert outcome.certificate is None
    assert_names(outcome.message, "time limit")
    outcome = TwoStage(programs=programs, gap=1e-4, max_nodes=2).solve(course)
    assert outcome.status is Status.FEASIBLE
    assert_names(outcome.message, "2 nodes")
    assert outcome.bound <= TwoStage(programs=programs, gap=1e-4).solve(course).objective


def test_without_nodes_the_first_guess_of_patches_is_all_that_is_tried(climb, programs):
    hasty = TwoStage(programs=programs, max_nodes=0, cuts=False)
    assert hasty.solve(climb(7, **TORN)).details["guessed"]
    outcome = hasty.solve(climb(8, **TORN))
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "0 nodes")
    assert outcome.effort.solves <= 8
    assert outcome.details["dived"] == 0


@pytest.mark.parametrize("most", [1, 4, 9])
def test_a_limit_of_solves_gives_the_same_answer_on_a_busy_computer(
    climb, programs, monkeypatch, most
):
    """A busy one is a clock by which every look at it takes a second."""
    course = climb(8, **TORN)
    planner = TwoStage(programs=programs, gap=1e-4, max_solves=most, time_limit_s=1e6)
    calm = planner.solve(course)
    assert_names(calm.message, f"{most} solves")
    assert (
        most <= calm.effort.solves <= most + 12
    )  # it is looked at between projections, which take some
    late = itertools.count()
    monkeypatch.setattr(
        "stancekit.planners.search.answer.time.perf_counter", lambda: float(next(late))
    )
    busy = planner.solve(course)
    assert (busy.status, busy.effort.solves, busy.message) == (
        calm.status,
        calm.effort.solves,
        calm.message,
    )
    np.testing.assert_array_equal((busy.objective, busy.bound), (calm.objective, calm.bound))
    assert busy.effort.seconds > 5.0 * max(calm.effort.seconds, 0.1)
