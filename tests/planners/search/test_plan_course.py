"""One function answers a course: within inner sets, proved over outer ones, bent, judged, and
within its time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Motion, Status
from stancekit.planners.errors import TimeEnded, until
from stancekit.planners.motion.path import PlanPath
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.course_keys import ALTERNATIVES, Alternative
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.robot.model import ReachRows, RelativeReach
from stancekit.planners.robot.walker import sets_of
from stancekit.planners.search.pieces import Standing
from stancekit.planners.search.plan_course import UNPROVED, LayOut, _moved_back, plan_course, replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.patch import Frame
from stancekit.planners.verify import Report, check_certificate, check_plan
from stancekit.planners.verify.margins import stance_margins
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names, refuses

pytest.importorskip("pinocchio")
HIGH = """
name: high
robot: dog.urdf
frames: {1}
gait: wave
start_m: [0.0, 0.0, {0}]
goal_m: [0.1, 0.0, {0}]
body: {{com_radius_m: 0.005, first_radius_m: 0.005, tilt_limit_rad: 0.01}}
terrain: {{kind: flat, friction: 0.7}}
"""


@pytest.fixture(scope="module")
def high(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The file of a course on which a quadruped stands so high [m]: 0.58 is out of its inner sets,
    0.69 of all.
    """
    folder = tmp_path_factory.mktemp("high")
    (folder / "dog.urdf").write_text(quadruped())

    def high(height_m: float, frames: int = 2) -> Path:
        path = folder / f"high-{height_m:g}-{frames}.yaml"
        path.write_text(HIGH.format(height_m, frames))
        return path

    return high


def test_a_robots_sets_are_told_from_its_numbers_and_survive_a_file(
    high: Callable[..., Path],
) -> None:
    course = read_course(high(0.5))
    assert sets_of(course.robot) == "inner"
    outer = replace(course, robot=course.robot.sets("outer", course.tilt_limit_rad))
    assert Problem.from_json(outer.to_json()).sets == "outer"
    assert read_course(high(0.5), sets="outer").sets == "outer"
    shifted = replace(course.robot.limbs[0], reach_m=course.robot.limbs[0].reach_m + 1e-6)
    assert sets_of(replace(course.robot, limbs=(shifted, *course.robot.limbs[1:]))) is None
    assert sets_of(read_course("walls").robot) is None


@pytest.mark.parametrize("laid_out", [True, False])
def test_inner_sets_prove_nothing_of_a_robot(high: Callable[..., Path], laid_out: bool) -> None:
    path = high(0.58)
    course = read_course(path)
    inner = TwoStage().solve(course)
    assert (inner.status, inner.sets) == (Status.INFEASIBLE, "inner")  # of these sets it is true
    outcome = plan_course(
        course if laid_out else lambda sets, _: read_course(path, sets=sets),
        TwoStage(),
    )
    assert (outcome.status, outcome.message) == (Status.UNDECIDED, UNPROVED)
    assert outcome.certificate is None
    assert math.isnan(outcome.bound)


@pytest.mark.parametrize("laid_out", [True, False])
def test_a_proof_is_over_outer_sets_and_its_answer_has_all_that_explains_it(
    high: Callable[..., Path], laid_out: bool
) -> None:
    path = high(0.69)
    question: Problem | LayOut = lambda sets, _: read_course(path, sets=sets)  # noqa: E731
    outcome = plan_course(read_course(path) if laid_out else question, TwoStage())
    assert (outcome.status, outcome.sets) == (Status.INFEASIBLE, "outer")
    assert outcome.certificate is not None
    assert outcome.certificate.sets == "outer"
    assert outcome.certificate.problem is outcome.problem
    assert check_certificate(outcome.certificate).accepted
    course = outcome.certificate.problem
    assert isinstance(course, Problem)
    limbs = tuple(
        replace(limb, reach_rows=replace(rows, bounds_m=rows.bounds_m - 0.05))
        for limb in course.robot.limbs
        if (rows := limb.reach_rows) is not None
    )
    smaller = outcome.certificate.of(replace(course, robot=replace(course.robot, limbs=limbs)))
    assert not check_certificate(smaller).accepted  # over sets that do not hold all that is reached
    assert stancekit.explain(outcome).relaxations
    assert stancekit.explain(outcome.certificate) == stancekit.explain(outcome)


def test_a_proof_that_asks_where_other_feet_are_is_not_of_all_that_legs_reach(
    high: Callable[..., Path],
) -> None:
    course = read_course(high(0.5, 3), sets="outer")
    names, walls = course.robot.limb_names, np.concatenate([np.eye(3), -np.eye(3)])
    foot = next(each.limb for each in course.footholds if each.frame)
    rows = ReachRows(normals=walls, bounds_m=np.full(6, 0.01))
    near = [RelativeReach(limb=foot, other=each, rows=rows) for each in names if each != foot]
    robot = replace(course.robot, relative_reach=tuple(near))
    certificate = TwoStage().solve(replace(course, robot=robot)).certificate
    assert certificate is not None
    assert (certificate.sets, check_certificate(certificate).accepted) == (None, False)


def test_a_course_and_its_file_are_proved_with_the_same_tilt_limit(
    high: Callable[..., Path],
) -> None:
    path = high(0.62).with_name("unsaid.yaml")
    path.write_text(HIGH.format(0.62, 2).replace(", tilt_limit_rad: 0.01", ""))

    def asked(question: Problem | LayOut) -> list[tuple[str | None, float]]:
        seen = list[tuple[str | None, float]]()

        class Listening(TwoStage):
            """One that proves nothing over outer sets, and takes no time to."""

            def solve(self, course: Problem) -> Answer[Motion]:
                seen.append((course.sets, course.tilt_limit_rad))
                if course.sets == "outer":
                    return Answer(status=Status.UNDECIDED, method=self.name)
                return super().solve(course)

        assert (
            plan_course(question, Listening(), shares=(1.0,), presses=()).status is Status.UNDECIDED
        )
        return seen

    of_file, of_course = (
        asked(lambda sets, _: read_course(path, sets=sets)),
        asked(read_course(path)),
    )
    assert of_file == of_course == [("inner", 0.1), ("outer", 0.2618)]


def test_replanning_a_window_proves_over_outer_sets_too(high: Callable[..., Path]) -> None:
    course = read_course(high(0.5, 3))
    course = replace(
        course, weights=replace(course.weights, stance=0.0)
    )  # which leaves no room for the next window
    state = Standing.at_end(replan(None, course, horizon=1).solution)
    raised = replace(
        course, com_nominal_m=course.com_nominal_m + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.06]])
    )
    lifted = replan(state, raised, frame=1)
    far = replan(
        state, replace(raised, com_nominal_m=raised.com_nominal_m + 0.4 * np.eye(3)[2]), frame=1
    )
    assert (lifted.status, lifted.certificate) == (Status.UNDECIDED, None)
    assert (far.status, far.sets) == (Status.INFEASIBLE, "outer")


def test_the_library_and_a_loaded_course_say_the_same_as_the_function(
    high: Callable[..., Path],
) -> None:
    for height_m, status in ((0.58, Status.UNDECIDED), (0.69, Status.INFEASIBLE)):
        path = high(height_m)
        assert (
            stancekit.plan(path).status
            is stancekit.plan(stancekit.load(path, Problem)).status
            is status
        )


def test_built_in_courses_are_loaded_by_name_and_explained() -> None:
    course = stancekit.load("walls", Problem)
    slick = replace(
        course,
        footholds=tuple(
            replace(put, candidates=tuple(patch.with_friction(0.05) for patch in put.candidates))
            for put in course.footholds
        ),
        terrain=tuple(patch.with_friction(0.05) for patch in course.terrain),
    )
    outcome = stancekit.plan(slick)
    assert (outcome.status, outcome.sets) == (Status.INFEASIBLE, None)
    assert (
        stancekit.explain(outcome.certificate.of(slick)).message
        == stancekit.explain(outcome).message
    )
    with refuses():
        stancekit.explain(stancekit.plan("walls", frames=2))


class Walked:
    """A planner that has one plan, and needs no time for it."""

    name = "walked"

    def __init__(self, plan: Motion) -> None:
        self.plan = plan

    def solve(self, course: Problem) -> Answer[Motion]:
        return Answer(
            status=Status.FEASIBLE, method=self.name, solution=replace(self.plan, problem=course)
        )


@pytest.fixture(scope="module")
def climb() -> Motion:
    plan = TwoStage().solve(read_course("walls", frames=3)).solution
    assert plan is not None
    return plan


def test_what_there_is_when_the_time_ends_is_kept_and_not_called_accepted(
    climb: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    none = plan_course(climb.problem, Walked(climb), deadline=100.0)
    assert (none.status, none.solution) == (Status.UNDECIDED, None)
    assert_names(none.message, "time limit", "contacts")

    class Slow(Walked):
        """One whose search takes all of the time."""

        def solve(self, course: Problem) -> Answer[Motion]:
            now[0] += 30.0
            return super().solve(course)

    late = plan_course(climb.problem, Slow(climb), deadline=110.0)
    assert late.status is Status.UNDECIDED
    assert_names(late.message, "time limit", "joints", "torque", "bodies", "motion")
    assert late.solution is not None
    assert late.report is not None
    assert late.report.contacts
    assert late.report.unchecked == ("joints", "torque", "bodies", "motion")
    assert check_plan(late.solution, joints=True).accepted  # with time there is nothing against it


def test_reading_and_laying_out_and_paths_of_feet_end_with_the_time_and_say_what_it_ended_in(
    climb: Motion,
) -> None:
    question = laid_between(stancekit.terrain("stairs:0.1:3"), (0.0, 0.0), (0.1, 0.0))
    for ends, said in (
        (lambda: stancekit.terrain("stairs:0.3:4"), "while footholds were looked for"),
        (lambda: question("inner"), "before the course was laid out"),
        (lambda: PlanPath(climb).steps, "while paths of feet were looked for"),
    ):
        with until(-math.inf), pytest.raises(TimeEnded, match=f"the time limit ended {said}"):
            ends()
        ends()  # with time nothing is missing of what was cut short


def test_a_layout_that_could_not_be_laid_out_in_time_is_not_begun(
    climb: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, laid = [100.0], list[str]()
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])

    def lay_out(_sets: str, alternative: Alternative) -> Problem:
        laid.append(alternative.message)
        now[0] += 4.0
        return climb.problem

    class Vain(Walked):
        """One that finds nothing, in a second."""

        def solve(self, course: Problem) -> Answer[Motion]:
            now[0] += 1.0
            return Answer(status=Status.UNDECIDED, method=self.name)

    outcome = plan_course(lay_out, Vain(climb), layouts=ALTERNATIVES, deadline=110.0)
    assert outcome.status is Status.UNDECIDED
    assert (len(laid), now[0]) == (2, 110.0)


def test_layouts_are_searched_briefly_and_those_without_contacts_once_more(
    high: Callable[..., Path],
) -> None:
    course, asked = read_course(high(0.5)), list[float | None]()

    class Vain(TwoStage):
        """One that finds nothing."""

        def solve(self, course: Problem) -> Answer[Motion]:
            asked.append(self.max_solves)
            return Answer(status=Status.UNDECIDED, method=self.name)

    settings = {"limits": None, "shares": (1.0,), "layouts": ALTERNATIVES[:2], "stated": False}
    outcome = plan_course(lambda *_: course, Vain(), **settings)
    tried = len(asked) // 2
    assert asked == [30] * tried + [None] * tried
    assert_names(outcome.message, f"{tried} layouts tried")


def test_a_look_that_is_cut_short_ends_in_a_plan_with_joints_and_no_verdict_on_bodies(
    climb: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    from stancekit.planners.projection import whole_body

    def ended(plan: Motion, **_: object) -> Report:
        raise TimeEnded("the time limit ended")

    monkeypatch.setattr(whole_body, "check_plan", ended)
    outcome = plan_course(climb.problem, Walked(climb), limits=WholeBodyLimits())
    assert outcome.solution is not None
    assert outcome.solution.joints_rad is not None
    assert math.isnan(outcome.details["depth_m"])
    assert outcome.status is Status.FEASIBLE  # the verifier had the time


def test_a_claim_of_a_planner_from_elsewhere_is_not_believed(climb: Motion) -> None:
    class Liar(Walked):
        """One whose robot floats."""

        def solve(self, course: Problem) -> Answer[Motion]:
            plan = replace(self.plan, problem=course, forces_n=0.0 * self.plan.forces_n)
            return Answer(status=Status.FEASIBLE, method=self.name, solution=plan)

    outcome = stancekit.plan(climb.problem, Liar(climb))
    assert (outcome.status, outcome.solution) == (Status.UNDECIDED, None)
    assert_names(outcome.message, "force_balance")


def test_a_plan_with_more_margin_is_preferred_where_it_is_asked_for() -> None:
    """Of the same course, which asks for no push, every stance bears a larger one."""
    prefer = stancekit.PlanSettings(prefer_margin=True)
    plain, firm = (
        stancekit.plan("stairs", frames=6, settings=settings).solution
        for settings in (stancekit.PlanSettings(), prefer)
    )
    assert plain is not None and firm is not None  # noqa: PT018
    assert (firm.problem.push_n, firm.provenance["push_share"]) == (0.0, 0.4)
    pushes = [stance_margins(plan, ("push_n",))["push_n"].min() for plan in (plain, firm)]
    assert pushes[1] > max(0.4 * firm.problem.weight_n, 1.5 * pushes[0])
    with refuses("prefer_margin", "exact"):
        stancekit.plan("stairs", "exact", settings=prefer)


def test_a_plan_that_is_refused_in_a_frame_of_its_own_is_written_with_its_report(tmp_path):
    answer = stancekit.plan("walls", frames=2)
    defect = replace(answer.report, defect="no time was left for it")
    refused = replace(answer, status=Status.UNDECIDED, report=defect)
    question = SimpleNamespace(robot=None, frame=Frame(origin_m=np.ones(3), heading_rad=0.3))
    moved = _moved_back(refused, question)
    assert not moved.report.accepted
    assert moved.report.answer is moved.solution
    stancekit.save(moved, tmp_path / "plan.json")
