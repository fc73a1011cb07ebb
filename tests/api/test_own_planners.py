"""A planner that is handed over as an object is believed as far as the verifier accepts what it
has.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import stancekit
from stancekit import Answer, Plan, Status
from stancekit.planners.search.exact import ExactPlanner
from tests.refusals import assert_names, refuses


class Says:
    """Answers every question so."""

    name = "mine"

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def solve(self, _: Any) -> Any:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.fixture(scope="module")
def held() -> Answer[Plan]:
    return stancekit.solve(stancekit.sample("ground-3", rng=3)[0])


@pytest.fixture(scope="module")
def refuted() -> Answer[Plan]:
    return stancekit.solve(stancekit.sample("wall-3", rng=8)[0])


def test_a_posture_that_does_not_hold_is_refused(held):
    floating = replace(held.solution, forces_n=0.0 * held.solution.forces_n)
    outcome = stancekit.solve(held.problem, Says(replace(held, solution=floating, method="mine")))
    assert (outcome.status, outcome.solution) == (Status.UNDECIDED, None)
    assert "force_balance" in [group.name for group in outcome.report.refused]
    assert_names(outcome.message, "force_balance")


def test_a_proof_of_another_problem_is_refused(held, refuted):
    outcome = stancekit.solve(held.problem, Says(replace(refuted, problem=held.problem)))
    assert (outcome.status, outcome.certificate) == (Status.UNDECIDED, None)


@pytest.mark.parametrize("status", [Status.FEASIBLE, Status.INFEASIBLE])
def test_a_claim_without_evidence_is_undecided(status, held):
    outcome = stancekit.solve(held.problem, Says(Answer(status=status, method="mine")))
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, status.value)
    course = stancekit.load("stairs")
    planned = stancekit.plan(course, Says(Answer(status=status, method="mine")))
    assert (planned.status, planned.solution, planned.certificate) == (Status.UNDECIDED, None, None)


def test_evidence_that_is_accepted_counts(held, refuted):
    for whole, evidence in ((held, held.solution), (refuted, refuted.certificate)):
        for answer in (whole, evidence):
            outcome = stancekit.solve(whole.problem, Says(answer))
            assert outcome.status is whole.status
            assert outcome.method == "mine"


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (
            "feasible",
            "method mine: expected an Answer, a Plan, a Certificate or None, got a str, 'feasible'",
        ),
        (KeyError("two\nlines"), r"method mine: KeyError: 'two\nlines'"),
    ],
)
def test_what_is_no_answer_is_one_line(answer, said, held):
    with pytest.raises(stancekit.InvalidInput) as caught:
        stancekit.solve(held.problem, Says(answer))
    assert str(caught.value) == said


def test_a_planner_of_the_package_is_asked_itself(held):
    planner = ExactPlanner()
    assert stancekit.solve(held.problem, planner).bound == held.bound
    assert stancekit.solve(held.problem, planner).method == held.method


def test_an_answer_is_verified_by_what_it_rests_on(held, refuted):
    for answer in (held, refuted):
        report = stancekit.verify(answer)
        assert report.accepted
        assert report.answer is (answer.solution or answer.certificate)
    forged = replace(held, solution=replace(held.solution, forces_n=0.0 * held.solution.forces_n))
    assert not stancekit.verify(forged).accepted
    with refuses("verify"):
        stancekit.verify(Answer(status=Status.UNDECIDED, method="mine"))


ONE_KIND = """
class Postures:
    answers = "postures"

    def __init__(self, options):
        pass

    def solve(self, problem):
        return None

class Courses:
    answers = "courses"

    def __init__(self, options):
        pass

    def solve(self, course):
        return None

class Both:
    def __init__(self, options):
        pass

    def solve(self, problem):
        return None
"""


def test_a_planner_of_one_kind_of_question_says_so_where_it_is_asked_another(tmp_path, held):
    path = tmp_path / "kinds.py"
    path.write_text(ONE_KIND, encoding="utf-8")
    course = stancekit.load("stairs")
    for name, kinds in (
        ("Postures", "postures"),
        ("Courses", "courses"),
        ("Both", "postures courses"),
    ):
        asked = f"{path}:{name}"
        for kind, ask in (
            ("postures", lambda asked=asked: stancekit.solve(held.problem, asked)),
            ("courses", lambda asked=asked: stancekit.plan(course, asked)),
        ):
            if kind in kinds:
                assert ask().status is Status.UNDECIDED
                continue
            with refuses(asked, kind):
                ask()
