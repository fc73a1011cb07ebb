"""Long courses in pieces: one plan that the verifier accepts, shared frames, and what goes on after
a stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Motion, Status
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.formats.motion_file import PartialPlan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search import pieces
from stancekit.planners.search.pieces import Standing, course_window, in_pieces, plan_pieces
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan


@dataclass
class Kept:
    """What is kept, in memory."""

    first: Motion | None = None
    plans: list[Motion] = field(default_factory=list)

    def begun(self, course):
        """As it was given."""
        return self.first

    def keep(self, plan):
        """Another one."""
        self.plans.append(plan)

    def remove(self):
        """None of them."""
        self.plans.clear()


@pytest.fixture
def short(monkeypatch):
    """Pieces of a few frames, each of which is kept."""
    sizes = ("PIECE", 6), ("SHARED", 2), ("LEAST", 2), ("LONG", 8), ("EVERY_S", -1.0)
    for name, value in sizes:
        monkeypatch.setattr(pieces, name, value)


@pytest.fixture(scope="module")
def course():
    return read_course("walls", frames=13)


@pytest.fixture(scope="module")
def planner():
    return TwoStage()


def piece_of(planner, fails=()):
    """What plans a piece, and of which calls fail; and how often it was called."""
    calls = list[int]()

    def piece(window, angles, end):
        calls.append(window.frames)
        if len(calls) in fails:
            return Answer(
                status=Status.UNDECIDED, method="none", problem=window, message="made to fail"
            )
        return planner.solve(window)

    return piece, calls


def begins(plan, beginning):
    """Assert that a plan begins with another one, bit for bit."""
    frames = beginning.problem.frames
    np.testing.assert_array_equal(plan.com_m[:frames], beginning.com_m)
    np.testing.assert_array_equal(plan.rotation_rad[:frames], beginning.rotation_rad)
    for frame in range(frames):
        np.testing.assert_array_equal(plan.toes_at(frame), beginning.toes_at(frame))
    if beginning.joints_rad is not None:
        np.testing.assert_array_equal(plan.joints_rad[:frames], beginning.joints_rad)


def same(one, other):
    """Assert that two plans are equal, bit for bit."""
    begins(one, other)
    assert one.problem.frames == other.problem.frames
    np.testing.assert_array_equal(one.forces_n, other.forces_n)
    np.testing.assert_array_equal(one.choice, other.choice)


def test_short_courses_are_not_planned_in_pieces():
    assert not in_pieces(read_course("walls", frames=5))
    assert in_pieces(read_course("walls", frames=pieces.LONG + 1))


def test_pieces_share_frames_and_make_one_plan(short, course, planner):
    piece, calls = piece_of(planner)
    kept, told = Kept(), list[tuple[int, int]]()
    found = plan_pieces(course, piece, kept=kept, progress=lambda *at: told.append(at))
    assert found.failed is None
    assert found.pieces == len(calls) >= 3
    assert all(frames <= pieces.PIECE + 2 for frames in calls)
    report = check_plan(found.plan)
    assert report.accepted, report.message
    assert found.plan.problem.frames == 13
    assert [done for done, _ in told] == [plan.problem.frames - 1 for plan in kept.plans]
    assert told[-1] == (12, 12)
    for beginning in kept.plans:
        begins(found.plan, beginning)
    assert found.plan.provenance["pieces"] == len(kept.plans)


def test_what_follows_soon_after_what_was_kept_is_not_written_again(
    short, course, planner, monkeypatch
):
    monkeypatch.setattr(pieces, "EVERY_S", 1e3)
    kept = Kept()
    found = plan_pieces(course, piece_of(planner)[0], kept=kept)
    assert found.pieces >= 3
    assert [plan.problem.frames for plan in kept.plans] == [5]
    begins(found.plan, kept.plans[0])


@pytest.mark.parametrize("frames", range(8, 14))
def test_a_shorter_piece_ends_with_its_course(short, planner, frames):
    course = read_course("walls", frames=frames)
    last = course.com_nominal_m[-1, 0]
    ends = list[float]()

    def piece(window, angles, end):
        ends.append(window.com_nominal_m[-1, 0])
        answer = planner.solve(window)
        if window.frames > 3 and len(ends) > 1:
            return replace(answer, status=Status.UNDECIDED, message="made to fail")
        return answer

    found = plan_pieces(course, piece)
    assert found.failed is not None
    assert 2 <= found.plan.problem.frames < frames
    assert max(ends) <= last + 1e-12


@pytest.mark.parametrize("stop", [1, 2])
def test_what_was_stopped_goes_on_to_the_same_plan(short, course, planner, stop):
    whole = plan_pieces(course, piece_of(planner)[0]).plan
    kept = Kept()

    def interrupted(done, frames):
        if len(kept.plans) == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_pieces(course, piece_of(planner)[0], kept=kept, progress=interrupted)
    piece, calls = piece_of(planner)
    again = plan_pieces(course, piece, kept=Kept(first=kept.plans[-1]))
    same(again.plan, whole)
    assert again.plan.provenance == whole.provenance
    assert len(calls) == whole.provenance["pieces"] - stop


def test_a_piece_that_fails_goes_another_way_before_the_whole_fails(short, course, planner):
    asked = list[int]()

    def detour(standing: Standing, avoid_m):
        asked.append(len(avoid_m))
        at = round(
            12
            * float((standing.com_m - course.com_nominal_m[0]) @ course.direction(1))
            / float(np.linalg.norm(course.com_nominal_m[-1] - course.com_nominal_m[0]))
        )
        return course_window(course, at, 12, standing)

    found = plan_pieces(course, piece_of(planner, fails=(2,))[0], detour=detour)
    assert asked == [1]
    assert len(found.tried_m) == 1
    assert found.failed is None
    assert check_plan(found.plan).accepted


def test_where_no_piece_has_a_plan_the_answer_says_how_far_it_came(short, course, planner):
    def none(standing, avoid_m):
        raise PlanningFailed("no way at all")

    found = plan_pieces(course, piece_of(planner, fails=range(2, 99))[0], detour=none)
    assert found.failed is not None
    assert "no way at all" in found.failed.message
    assert 0 < found.plan.problem.frames < 13
    assert check_plan(found.plan).accepted


def test_a_kept_beginning_counts_for_its_own_course_alone(tmp_path):
    pytest.importorskip("pinocchio")
    path = tmp_path / "way.partial.json"
    course = read_course("stairs", frames=5)
    answer = stancekit.plan(course)
    assert answer.solution is not None
    kept = PartialPlan(path)
    assert kept.begun(course) is None
    kept.keep(answer.solution)
    same(kept.begun(course), answer.solution)
    assert kept.begun(replace(course, push_n=5.0)) is None
    path.write_text(path.read_text()[:-200])
    assert kept.begun(course) is None
    kept.remove()
    assert not path.exists()
    assert PartialPlan(None).begun(course) is None


def test_a_kept_beginning_whose_joints_do_not_stand_on_its_toes_counts_for_nothing(tmp_path):
    pytest.importorskip("pinocchio")
    course = read_course("stairs", frames=5)
    plan = stancekit.plan(course).solution
    kept = PartialPlan(tmp_path / "way.partial.json")
    for joints in (
        plan.joints_rad + 0.2,
        plan.joints_rad[::-1],
        np.full_like(plan.joints_rad, 100.0),
    ):
        forged = replace(plan, joints_rad=joints)
        assert check_plan(forged).accepted  # contacts alone know nothing of it
        kept.keep(forged)
        assert kept.begun(course) is None
    kept.keep(replace(plan, joints_rad=None))
    assert kept.begun(course) is None


def test_a_beginning_that_took_another_way_is_gone_on_from_where_the_ways_part(tmp_path):
    pytest.importorskip("pinocchio")
    course = read_course("stairs", frames=7)
    com = np.array(course.com_nominal_m)
    com[5:, 1] += 0.01
    plan = stancekit.plan(replace(course, com_nominal_m=com)).solution
    kept = PartialPlan(tmp_path / "way.partial.json")
    kept.keep(plan)
    begun = kept.begun(course)
    assert begun.problem.frames == 5
    begins(plan, begun)


def test_a_long_course_of_the_library_is_planned_in_pieces_and_leaves_nothing_behind(tmp_path):
    pytest.importorskip("pinocchio")
    kept, told = tmp_path / "long.partial.json", list[tuple[int, int]]()
    course = read_course("stairs", frames=pieces.LONG + 2)
    answer = stancekit.plan(
        course,
        settings=stancekit.PlanSettings(checkpoint=kept),
        progress=lambda *at: told.append(at),
        time_limit_s=600.0,
    )
    assert answer.status is Status.FEASIBLE, answer.message
    assert answer.report.accepted
    assert answer.solution.provenance["pieces"] == len(told) >= 2
    assert told[-1] == (pieces.LONG + 1, pieces.LONG + 1)
    assert not kept.exists()
    assert math.isfinite(answer.solution.provenance["friction_share"])


def test_what_no_plan_can_carry_at_a_late_frame_is_still_proved():
    course = read_course("stairs", frames=60)
    wrench = np.zeros((course.frames, 6))
    wrench[45:, 0] = 90.0  # N, more than any stance holds
    answer = stancekit.plan(replace(course, wrench=wrench))
    assert answer.status is Status.INFEASIBLE
    assert stancekit.verify(answer.certificate).accepted
