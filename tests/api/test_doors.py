"""One question, one answer: a few of ``tests/doors.py`` at every door; ``benchmarks/doors.py`` asks
all of them, also those that are left undecided, which take half a minute each.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from tests.doors import DOORS, PLACES, WALKS, ask, differences, questions
from tests.planners.robot.small_urdfs import quadruped

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


POWERS = {"xyz": 1.0, "radius": 1.0, "size": 1.0, "value": 3.0, "effort": 4.0, "velocity": -0.5}
"""Powers of its size by which the numbers of a URDF rise; those of inertias by the fifth."""


def of_size(size: float) -> str:
    """The quadruped, this many times as large: one robot, by similarity."""

    def larger(found: re.Match[str]) -> str:
        power, numbers = POWERS.get(found[1], 5.0), found[2].split()
        return f'{found[1]}="{" ".join(repr(float(each) * size**power) for each in numbers)}"'

    return re.sub(
        r'(?<!axis )(\bxyz|radius|size|value|effort|velocity|i[xyz]{2})="(.*?)"',
        larger,
        quadruped(),
    )


def test_a_plan_far_from_the_origin_is_the_plan_at_it_moved(tmp_path: Path) -> None:
    step, plans = QUESTIONS["step-hexapod"], list[stancekit.Answer[stancekit.Plan]]()
    for x, y in ((0.0, 0.0), (400_000.0, 90_000.0)):
        shift = np.array([x, x, y, y, 0.0])
        path = replace(step, boxes=(np.array(step.boxes) + shift).tolist()).file(tmp_path)
        start, goal = (np.array([x, y]) + place for place in PLACES.values())
        plans.append(stancekit.plan(path, start_xy_m=start, goal_xy_m=goal, settings=WALKS))
    one, other = plans
    assert one.solution is not None
    assert other.solution is not None
    assert other.objective == pytest.approx(one.objective, rel=1e-6)
    assert other.solution.com_m - one.solution.com_m == pytest.approx(
        np.tile([x, y, 0.0], (len(one.solution.com_m), 1)), abs=1e-6
    )
    stancekit.save(other, tmp_path / "far.json")
    assert stancekit.verify(tmp_path / "far.json").accepted


@pytest.mark.parametrize("size", [0.25, 4.0])
@pytest.mark.parametrize("legs", [False, True])
def test_a_plan_of_a_robot_of_any_size_is_one_plan_scaled(
    size: float, legs: bool, tmp_path: Path
) -> None:
    plans = list[stancekit.Plan]()
    for each in (1.0, size):
        robot: stancekit.Robot = stancekit.hexapod()
        limbs = [
            replace(one, shoulder_m=each * one.shoulder_m, reach_m=each * one.reach_m)
            for one in robot.limbs
        ]
        robot = stancekit.Robot(name="six", mass_kg=each**3, limbs=tuple(limbs))
        if legs:
            (tmp_path / "dog.urdf").write_text(of_size(each))
            robot = stancekit.robot(tmp_path / "dog.urdf")
        step = QUESTIONS["step-small"]
        boxes = (each * np.array(step.boxes)).tolist()
        ground = stancekit.terrain(replace(step, boxes=boxes).file(tmp_path), robot=robot)
        start, goal = (each * np.array(place) for place in PLACES.values())
        found = stancekit.plan(
            ground, start_xy_m=start, goal_xy_m=goal, robot=robot, settings=WALKS
        )
        assert found.status.value == "feasible", found.message
        assert found.solution is not None
        plans.append(found.solution)
    one, other = (plan.com_m for plan in plans)
    np.testing.assert_allclose(other / size, one, atol=0.05 if legs else 1e-5)
