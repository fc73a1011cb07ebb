"""What notebooks show of answers, reports, plans and walks: one line in text, a picture and a table
in HTML.
"""

from xml.etree import ElementTree

import numpy as np
import pytest

import stancekit


def whole(html: str) -> ElementTree.Element:
    """The elements of a piece of HTML that is XML, too."""
    return ElementTree.fromstring(f"<div>{html}</div>")


def test_a_plan_is_a_line_a_picture_and_a_table() -> None:
    answer = stancekit.plan("walls", frames=2)
    assert (
        repr(answer)
        == f"Answer(feasible by {answer.method}: {answer.message or answer.report.message})"
    )
    assert repr(answer.solution) == "Plan(walls: 2 key frames of LF, LM, LR, RF, RM, RR)"
    assert repr(answer.report) == f"Report({answer.report.message})"
    tree = whole(answer._repr_html_())
    assert len(tree.findall("table/tr")) == len(answer.report.groups)
    picture = next(each for each in tree if each.tag.endswith("svg"))
    assert sum(each.tag.endswith("polygon") for each in picture) == len(
        answer.solution.problem.footholds
    )
    points = [each.get("points", "") for each in picture if each.get("points")]
    numbers = np.array(
        [float(x) for text in points for pair in text.split() for x in pair.split(",")]
    )
    assert np.isfinite(numbers).all()


def test_a_posture_a_proof_a_walk_and_a_leap_are_shown() -> None:
    posture = stancekit.solve(stancekit.sample("ground-3", rng=3)[0])
    assert "<svg" in posture._repr_html_()
    proof = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
    assert "<b>infeasible</b>" in proof._repr_html_()
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    assert repr(walk.solution).startswith("Trajectory(anymal")
    whole(walk._repr_html_())
    leap = stancekit.plan("leap-given:0")
    assert repr(leap.solution).startswith("LeapPlan(")
    whole(leap._repr_html_())


def test_names_are_no_markup() -> None:
    from dataclasses import replace

    plan = stancekit.plan("walls", frames=2).solution
    odd = replace(plan, problem=replace(plan.problem, name="<b>&x"))
    assert "<b>&x" not in odd._repr_html_()
    whole(odd._repr_html_())


def test_an_answer_without_a_solution_has_a_line() -> None:
    answer = stancekit.Answer(status=stancekit.Status.UNDECIDED, method="nobody", message="a < b")
    assert repr(answer) == "Answer(undecided by nobody: a < b)"
    with pytest.raises(AttributeError):
        _ = answer.solution.com_m  # type: ignore[union-attr]
    assert (
        whole(answer._repr_html_()).findtext("p") == ": a < b" or "a &lt; b" in answer._repr_html_()
    )
