"""What is tried where a course has no plan from where the robot stands, with planners that refuse
as they are told.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.pieces import Standing
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.control.envelope_choice import Replanner
from stancekit.runner.control.loop_settings import LoopSettings
from stancekit.runner.settings import RunSettings
from tests.refusals import refuses

PLANNER = TwoStagePlanner()
COURSE = read_course("walls", frames=3)


@pytest.fixture(scope="module")
def standing() -> Standing:
    plan = PLANNER.solve(COURSE).solution
    assert plan is not None
    patches = tuple(plan.problem.patch(int(index), plan.choice) for index in plan.problem.holds[0])
    return Standing(
        com_m=plan.com_m[0],
        rotation_rad=plan.rotation_rad[0],
        toes_m=plan.toes_at(0),
        patches=patches,
    )


class Unless:
    """Solves windows but those that a condition refuses; ``seen``: all lifts that it was asked
    for.
    """

    def __init__(self, refuses: Callable[[Problem], bool]) -> None:
        self.refuses, self.seen = refuses, list[tuple[tuple[str, ...], ...]]()

    def solve(self, course: Problem) -> Answer[Plan]:
        self.seen.append(course.lifts)
        if self.refuses(course):
            return Answer(status=Status.UNDECIDED, method="told to", message="too hard")
        return PLANNER.solve(course)


def replanner(planner: Unless) -> tuple[Replanner, list[str]]:
    decided = list[str]()
    runner: Any = SimpleNamespace(
        settings=RunSettings(),
        state=None,
        decide=lambda what, why: decided.append(f"{what}: {why}"),
    )
    friction: Any = SimpleNamespace(interval=SimpleNamespace(share=1.0, planned_on=1.0, slides=0))
    return Replanner(
        COURSE, lambda observation: planner, LoopSettings(shares=(1.0,)), runner, friction
    ), decided


def lifted(plan: Plan) -> list[int]:
    return [len(names) for names in plan.problem.lifts]


def test_where_three_feet_together_cannot_be_lifted_one_after_the_other_is(
    standing: Standing,
) -> None:
    planner = Unless(lambda course: len(course.lifts[1]) > 1)
    planning, decided = replanner(planner)
    plan = planning.plan(0, standing).plan
    assert lifted(plan) == [0, 1, 1, 1, 3]  # the next key frame's alone
    assert planning.course.frames == 5
    assert decided[0].startswith("one foot at a time: no plan otherwise, now counting on 1.00")


def test_and_all_that_come_where_that_is_not_enough(standing: Standing) -> None:
    planner = Unless(lambda course: max(map(len, course.lifts)) > 1)
    planning, _ = replanner(planner)
    plan = planning.plan(0, standing).plan
    assert lifted(plan) == [0, 1, 1, 1, 1, 1, 1]
    assert [max(map(len, lifts)) for lifts in planner.seen] == [3, 3, 1]


def test_what_comes_after_the_end_is_given_up_last(standing: Standing) -> None:
    planner = Unless(lambda course: bool(course.next_lift))
    planning, decided = replanner(planner)
    plan = planning.plan(0, standing).plan
    assert (lifted(plan), plan.problem.next_lift) == ([0, 3, 3], ())
    assert decided[0].startswith("no step after the last")


def test_a_course_that_has_a_plan_stays_as_it_is(standing: Standing) -> None:
    planning, decided = replanner(Unless(lambda course: False))
    assert planning.plan(0, standing).plan.problem.lifts == COURSE.lifts
    assert planning.course is COURSE
    assert decided == ["planned: counting on 1.00 of the course's friction"]


def test_before_anything_moves_the_course_is_not_made_easier() -> None:
    planner = Unless(lambda course: True)
    planning, decided = replanner(planner)
    with refuses("frame 0", kind=PlanningFailed):
        planning.plan(0, None)
    assert (len(planner.seen), decided, planning.course) == (1, [], COURSE)
