"""Plans that keep a reserve of friction are plans of the course itself, made as slippery as it may
be and no more.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from stancekit import Answer, Effort, Motion, Status
from stancekit.planners.problem import Problem
from stancekit.planners.search.answer import Method
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.friction_margin import plan_with_reserve, slippery
from tests.refusals import assert_names


class Picky:
    """A planner that has a plan only for courses whose friction is at least this."""

    name = "picky"

    def __init__(self, plan: Motion, friction: float) -> None:
        self.plan, self.friction, self.asked = plan, friction, list[float]()

    def solve(self, course: Problem) -> Answer[Motion]:
        friction = course.footholds[0].candidates[0].friction
        self.asked.append(friction)
        if friction < self.friction:
            return Answer(status=Status.INFEASIBLE, method=self.name, message="too slippery")
        return Answer(
            status=Status.FEASIBLE, method=self.name, solution=replace(self.plan, problem=course)
        )


def test_the_most_cautious_plan_is_taken_and_is_one_of_the_course_itself(
    walk: Callable[..., Motion],
) -> None:
    plan = walk()
    planner = Picky(plan, 0.85 * plan.problem.footholds[0].candidates[0].friction)
    outcome = plan_with_reserve(planner, plan.problem)
    assert outcome.solution is not None
    assert outcome.solution.problem is plan.problem
    assert outcome.solution.provenance["friction_share"] == 0.9
    assert len(planner.asked) == 2


def test_a_course_without_a_plan_gets_the_answer_for_all_of_its_friction(
    walk: Callable[..., Motion],
) -> None:
    plan = walk()
    planner = Picky(plan, 1e6)
    assert plan_with_reserve(planner, plan.problem).status is Status.INFEASIBLE
    assert planner.asked[-1] == plan.problem.footholds[0].candidates[0].friction


def test_slippery_courses_differ_in_friction_alone(walk: Callable[..., Motion]) -> None:
    course = walk().problem
    dulled = slippery(course, 0.5)
    for before, after in zip(course.footholds, dulled.footholds, strict=True):
        assert after.candidates[0].friction == 0.5 * before.candidates[0].friction
        np.testing.assert_array_equal(
            after.candidates[0].vertices_m, before.candidates[0].vertices_m
        )
    assert [patch.friction for patch in dulled.terrain] == [
        0.5 * patch.friction for patch in course.terrain
    ]


def test_one_time_limit_is_for_all_shares_together(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    now, given = [0.0], []

    @dataclass(frozen=True, kw_only=True)
    class Slow(Method):
        name = "slow"
        time_limit_s: float | None = 10.0

        def solve(self, course: Problem) -> Answer[Motion]:
            given.append((float(course.terrain[0].friction), self.time_limit_s))
            now[0] += self.time_limit_s
            return Answer(status=Status.UNDECIDED, method=self.name)

    monkeypatch.setattr(
        "stancekit.planners.search.friction_margin.time.perf_counter", lambda: now[0]
    )
    course, planner = walk().problem, Slow()
    friction = float(course.terrain[0].friction)
    assert plan_with_reserve(planner, course).status is Status.UNDECIDED
    assert given == [(pytest.approx(0.8 * friction), 5.0), (friction, 5.0)]
    assert planner.time_limit_s == 10.0


def test_a_limited_planner_keeps_the_usual_limit_of_postures() -> None:
    planner = Exact()
    assert (planner.limit_s("postures"), planner.limit_s("courses")) == (30.0, 60.0)
    limited = planner.with_limit(45.0)
    assert (limited.limit_s("postures"), limited.limit_s("courses")) == (30.0, 45.0)
    assert limited.with_limit(100.0).limit_s("courses") == 45.0
    assert Exact(time_limit_s=5.0).with_limit(45.0).limit_s("postures") == 5.0


def test_a_deadline_is_for_all_shares_too_and_nothing_is_set_on_planners_that_cannot_be_limited(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]

    class Foreign:
        name = "foreign"
        __slots__ = ("asked",)

        def __init__(self) -> None:
            self.asked = list[float]()

        def solve(self, course: Problem) -> Answer[Motion]:
            self.asked.append(float(course.terrain[0].friction))
            now[0] += 4.0
            return Answer(status=Status.INFEASIBLE, method=self.name)

    monkeypatch.setattr(
        "stancekit.planners.search.friction_margin.time.perf_counter", lambda: now[0]
    )
    course, planner = walk().problem, Foreign()
    friction = float(course.terrain[0].friction)
    assert plan_with_reserve(planner, course, deadline=107.0).status is Status.INFEASIBLE
    assert planner.asked == [
        pytest.approx(0.8 * friction),
        friction,
    ]  # 0.9 would begin in the last share's time
    late = plan_with_reserve(planner, course, deadline=107.0)
    assert (late.status, len(planner.asked)) == (Status.UNDECIDED, 2)
    assert_names(late.message, "time limit")
    less = plan_with_reserve(planner, course, deadline=now[0] + 3.0)  # of less friction alone
    assert (less.status, len(planner.asked)) == (Status.UNDECIDED, 3)


def test_a_push_that_nothing_depends_on_is_looked_for_no_longer_than_the_plan_took(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    now, given = [0.0], list[float]()
    plan = walk()
    assert not plan.problem.robot.own

    @dataclass(frozen=True, kw_only=True)
    class Slow(Method):
        name = "slow"
        time_limit_s: float | None = 600.0

        def solve(self, course: Problem) -> Answer[Motion]:
            given.append(self.time_limit_s)
            began, found = now[0], course.push_n == 0.0
            now[0] += 7.0 if found else self.time_limit_s
            return Answer(
                status=Status.FEASIBLE if found else Status.UNDECIDED,
                method=self.name,
                solution=replace(plan, problem=course) if found else None,
                effort=Effort(seconds=now[0] - began),
            )

    monkeypatch.setattr(
        "stancekit.planners.search.friction_margin.time.perf_counter", lambda: now[0]
    )
    monkeypatch.setattr("stancekit.planners.search.friction_margin.push_share", lambda plan: 0.0)
    assert plan_with_reserve(Slow(), plan.problem, (1.0,), (0.2,)).status is Status.FEASIBLE
    assert 0.0 < sum(given[1:3]) <= 7.0
