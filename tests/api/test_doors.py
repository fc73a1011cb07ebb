"""One question, one answer: a few of ``tests/doors.py`` at every door; ``benchmarks/doors.py`` asks
all of them, also those that are left undecided, which take half a minute each.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.doors import DOORS, ask, differences, questions

pytest.importorskip("pinocchio")
FEW = (
    "flat-2-0.4",
    "gait-all",
    "slick-2-0.1",
    "dog-0.7",
    "wall-0",
    "ground-1",
    "step-big",
    "beam-big",
)
QUESTIONS = {question.name: question for question in questions()}


def test_there_are_forty_questions_of_every_kind() -> None:
    expected = Counter(question.expected for question in QUESTIONS.values())
    assert len(QUESTIONS) >= 40
    assert expected["feasible"] >= 8
    assert expected["infeasible"] >= 8
    assert expected["undecided"] >= 4
    assert sum("robot" in question.keys for question in QUESTIONS.values()) >= 6
    assert set(FEW) <= set(QUESTIONS)


@pytest.mark.parametrize("name", FEW)
def test_every_door_says_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    question = QUESTIONS[name]
    replies = ask(question, tmp_path)
    assert not differences(replies)
    answers = [reply for each in replies.values() for reply in each.values()]
    assert len(answers) >= len(DOORS["course"]) - 1
    if question.expected:
        assert {reply.status for reply in answers} == {question.expected}
    assert all(bool(reply.proved) == (reply.status == "infeasible") for reply in answers)
