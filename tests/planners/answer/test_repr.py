"""Answers, reports, plans, walks and leaps are one line of text each."""

import numpy as np
import pytest

import stancekit


def test_a_plan_is_a_line_and_so_is_its_report() -> None:
    answer = stancekit.plan("walls", frames=2)
    assert (
        repr(answer)
        == f"Answer(feasible by {answer.method}: {answer.message or answer.report.message})"
    )
    assert repr(answer.solution) == "Plan(walls: 2 key frames of LF, LM, LR, RF, RM, RR)"
    assert repr(answer.report) == f"Report({answer.report.message})"


def test_a_walk_and_a_leap_are_lines() -> None:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    assert repr(walk.solution).startswith("Trajectory(anymal")
    leap = stancekit.plan("leap-given:0")
    assert repr(leap.solution).startswith("LeapPlan(")


def test_an_answer_without_a_solution_has_a_line() -> None:
    answer = stancekit.Answer(status=stancekit.Status.UNDECIDED, method="nobody", message="a < b")
    assert repr(answer) == "Answer(undecided by nobody: a < b)"
    with pytest.raises(AttributeError):
        _ = answer.solution.com_m  # type: ignore[union-attr]
