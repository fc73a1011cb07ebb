"""What a crossing is refused for: parts of other robots, over other ground, or that do not meet."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Motion, Way
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.motion.gait_motion import BLEND_S, crossing_motion
from stancekit.planners.motion.leap_motion import LeapBody
from stancekit.planners.motion.plan_motion import plan_motion
from stancekit.planners.verify.crossings import check_crossing
from tests.refusals import assert_names, refuses

LEAP = Path("tests/data/leap-hop-anymal.json")


def crossing(name: str, *parts: Motion, refusal: str = "") -> Motion:
    goes = {"course": parts[0].problem, "goal_m": parts[-1].com_m[-1, :2]}
    return Motion(problem=Way(name=name, refusal=refusal, **goes), parts=parts)


@pytest.fixture(scope="module")
def climb() -> Motion:
    return stancekit.plan("stairs", frames=2).solution


def test_a_part_of_another_robot_is_refused(climb: Motion) -> None:
    report = check_crossing(crossing("forged", climb, stancekit.load(LEAP, Motion)))
    assert not report.accepted
    assert_names(report.message, "part 2", "robot", "part 1")


def test_a_part_over_other_ground_is_refused(climb: Motion) -> None:
    other = stancekit.plan("walls", frames=2).solution
    report = check_crossing(crossing("forged", climb, other))
    assert not report.accepted
    assert_names(report.message, "part 2", "terrain", "part 1")


def test_a_course_that_its_first_part_does_not_answer_is_refused(climb: Motion) -> None:
    """Else its goal would be judged by whoever wrote the course down."""
    way = crossing("forged", climb).problem
    wide = replace(way.course, com_radius_m=100.0 * way.course.com_radius_m)
    report = check_crossing(Motion(problem=replace(way, course=wide), parts=(climb,)))
    assert not report.accepted
    assert_names(report.message, "part 1", "course")


def test_parts_that_do_not_meet_are_refused(climb: Motion) -> None:
    aside = replace(climb, toes_m=climb.toes_m + np.array([0.0, 1e-3, 0.0]))
    report = check_crossing(crossing("forged", climb, aside))
    assert report.group("1: climb").verdict == "holds"
    assert report.group("1 to 2: toes").value == pytest.approx(1e-3)
    assert report.group("1 to 2: toes").verdict == "violated"
    assert report.group("1 to 2: body").verdict == "violated"  # the climb goes on meanwhile
    assert not report.accepted


def test_a_file_reads_back_and_shows_where_it_was_changed(climb: Motion, tmp_path: Path) -> None:
    path = tmp_path / "crossing.json"
    stancekit.save(crossing("stairs", climb, refusal="no way"), path)
    back = stancekit.load(path, Motion)
    assert (back.name, back.problem.refusal, len(back.parts)) == ("stairs", "no way", 1)
    np.testing.assert_array_equal(back.parts[0].com_m, climb.com_m)
    assert stancekit.verify(path).accepted
    data = json.loads(path.read_text())
    data["question"]["refusal"] = "none"
    path.write_text(json.dumps(data))
    with refuses("digest"):
        read_motion(path)


def test_a_crossing_has_a_name_that_ends_in_json(climb: Motion, tmp_path: Path) -> None:
    with refuses(".json"):
        stancekit.save(crossing("stairs", climb), tmp_path / "crossing.txt")


def test_body_and_feet_go_on_without_a_jump_from_part_to_part(climb: Motion) -> None:
    motion, alone = (
        crossing_motion(crossing("twice", climb, climb)),
        plan_motion(climb),
    )
    last = alone.duration_s
    assert motion.duration_s == pytest.approx(2.0 * last + BLEND_S)
    for time_s in (last, last + BLEND_S):
        before, after = motion.at(time_s - 1e-6), motion.at(time_s + 1e-6)
        for name in ("com_m", "feet_m", "rotation_rad", "velocity_m_s", "forces_n"):
            np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-4)
    np.testing.assert_allclose(motion.at(0.3).com_m, alone.at(0.3).com_m)


WHOLE = Path("tests/data/crossing-anymal.json")
"""A climb, a leap of 0.48 m onto a stance above a gap, and a climb, by the box ANYmal's URDF."""
FORGED = {
    "pushes harder": "2: leap",
    "flies for longer": "2: leap",
    "begins 2 mm aside": "1 to 2: toes",
    "a toe in the gap, on a patch of its own": "2: ground",
    "rougher ground": "2: ground",
    "body turned after landing": "2 to 3: turn",
    "no leap": "1 to 2: toes",
    "no last climb": "goal",
}


def test_a_forged_crossing_is_refused_by_the_group_that_it_concerns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend("benchmarks")
    from benchmarks.forged_crossings import forgeries

    honest = read_motion(WHOLE)[0]
    report = check_crossing(honest)
    assert report.accepted
    landed, after = LeapBody(honest.parts[1]).rotation_rad[-1], honest.parts[2].rotation_rad[0]
    turn = float(np.abs(landed - after).max())
    assert turn > 0.05
    assert report.group("2 to 3: turn").value == pytest.approx(turn)
    fakes = {name: fake for name, fake in forgeries(honest, None) if name in FORGED}
    assert fakes.keys() == FORGED.keys()
    for name, fake in fakes.items():
        assert isinstance(fake, Motion)
        report = check_crossing(fake)
        assert not report.accepted, name
        assert report.group(FORGED[name]).verdict == "violated", name


def test_a_leap_that_draws_its_legs_up_at_its_middle_alone_is_refused_in_words() -> None:
    honest = read_motion(WHOLE)[0]
    leap = honest.parts[1]
    assert leap.has("timing")
    parts = (honest.parts[0], replace(leap, gather=np.array([0.5, 0.8])), honest.parts[2])
    report = check_crossing(replace(honest, parts=parts))
    assert not report.accepted
    assert_names(report.group("2: leap").message, "gather")
