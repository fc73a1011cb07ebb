"""External wrenches in problems: what they are made of, what is refused, and files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import stancekit
from stancekit import Motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import at_point, wrench_of
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.search.pieces import course_window, one_at_a_time, with_pause
from tests.refusals import refuses

ROPE = np.array([3.0, -2.0, 1.0, 0.1, 0.2, -0.3])
COURSE: dict[str, object] = {
    "name": "level",
    "frames": 4,
    "start_m": [0.0, 0.0, 0.2],
    "goal_m": [0.3, 0.0, 0.2],
    "terrain": {"kind": "flat"},
}


@pytest.fixture
def course(walk: Callable[..., Motion]) -> Problem:
    """Five frames on level ground."""
    return walk().problem


def with_wrench(tmp_path: Path, *entries: dict[str, object]) -> Problem:
    """The level course with these entries under ``wrench``."""
    path = tmp_path / "course.yaml"
    path.write_text(yaml.safe_dump({**COURSE, "wrench": list(entries)}))
    return read_course(path)


def test_a_force_at_a_point_turns_about_the_centre_of_mass() -> None:
    np.testing.assert_allclose(
        at_point((0, 0, -10.0), (0, 0, 0), (0.2, 0.1, 0.5)), [0, 0, -10, -1, 2, 0]
    )
    np.testing.assert_allclose(
        at_point((5.0, 0, 0), (0, 1.0, 0), (0, 0, 0.3)), [5, 0, 0, 0, 2.5, 0]
    )


def test_entries_of_a_file_add_up_on_their_frames(tmp_path: Path) -> None:
    payload = {"force_n": [0, 0, -10], "at_m": [0.2, 0.1, 0.0]}
    gust = {"force_n": [0, 4, 0], "moment_nm": [0, 0, 1], "frames": [1, 3, 3]}
    found = with_wrench(tmp_path, payload, gust).wrench
    assert found is not None
    always = [0, 0, -10, -1, 2, 0]
    np.testing.assert_allclose(found, [always, np.add(always, [0, 4, 0, 0, 0, 1])] * 2)
    assert with_wrench(tmp_path, {"force_n": [0, 0, 0]}).wrench is None
    assert with_wrench(tmp_path).wrench is None


@pytest.mark.parametrize(
    ("entry", "name"),
    [
        ({"force_n": [0, 0, -1], "frames": [4]}, "wrench[0].frames"),
        ({"force_n": [0, 0, -1], "frames": []}, "wrench[0].frames"),
        ({"force_n": [0, -1]}, "wrench[0].force_n[2]"),
        ({"force_n": [0, ".nan", 1]}, "wrench[0].force_n[1]"),
        ({"weight_n": 3}, "weight_n"),
        ({"force_n": [0, 0, -1e5]}, "wrench"),
    ],
)
def test_entries_that_make_no_sense_are_one_line(
    tmp_path: Path, entry: dict[str, object], name: str
) -> None:
    with refuses(name):
        with_wrench(tmp_path, entry)


@pytest.mark.parametrize(
    "wrench",
    [
        np.zeros((5, 3)),
        np.full((5, 6), np.nan),
        [["a"] * 6] * 5,
        np.full((5, 6), [0, 0, -9811.0, 0, 0, 0]),
        np.full((5, 6), [0, 0, 0, 5887.0, 0, 0]),
    ],
)
def test_a_course_refuses_what_is_no_wrench(course: Problem, wrench: object) -> None:
    with refuses("wrench"):
        replace(course, wrench=wrench)


def test_a_posture_problem_refuses_what_is_no_wrench(drawn: Callable[[str, int], Problem]) -> None:
    problem = drawn("wall-3", 0)
    with refuses("wrench"):
        problem.posture_with(wrench=[1.0, 2.0, 3.0])
    with refuses("wrench"):
        problem.posture_with(wrench=[np.inf] + [0.0] * 5)
    with refuses("wrench"):
        problem.posture_with(wrench=[0, 0, -1e5, 0, 0, 0])


@pytest.mark.parametrize(
    "wrench", [3.0, (1.0, 2.0), (1.0,) * 7, "123", ("a", "b", "c"), (np.nan, 0.0, 0.0), None]
)
def test_a_wrench_is_three_or_six_numbers(wrench: object) -> None:
    with refuses("wrench"):
        wrench_of(wrench)  # type: ignore[arg-type]


def test_three_numbers_are_a_force() -> None:
    np.testing.assert_array_equal(wrench_of((1.0, 2, 3)), [1, 2, 3, 0, 0, 0])
    np.testing.assert_array_equal(wrench_of(np.arange(6.0)), np.arange(6.0))


def test_files_have_a_wrench_where_there_is_one(
    course: Problem, drawn: Callable[[str, int], Problem]
) -> None:
    rope = np.outer([0.0, 1.0, 2.0, 0.5, -1.0], ROPE)
    for plain, pulled in (
        (course, replace(course, wrench=rope)),
        (drawn("wall-3", 0), drawn("wall-3", 0).posture_with(wrench=ROPE)),
    ):
        assert "wrench" not in plain.to_json()
        data = json.loads(json.dumps(pulled.to_json()))
        read = Problem.from_json(data)
        assert read.wrench is not None
        assert pulled.wrench is not None
        np.testing.assert_array_equal(read.wrench, pulled.wrench)
        assert read.to_json() == data
        assert {**data, "wrench": None} == {**plain.to_json(), "wrench": None}


@pytest.mark.parametrize(
    "wrench", [[[0.0] * 6], [[0.0] * 5] * 5, [["x"] * 6] * 5, 3, [[1e7] * 6] * 5]
)
def test_a_broken_wrench_in_a_file_is_refused(course: Problem, wrench: object) -> None:
    with refuses("wrench"):
        Problem.from_json({**course.to_json(), "wrench": wrench})


def test_a_wrench_is_added_to_what_a_course_has(course: Problem) -> None:
    assert course.loaded(None) is course
    assert course.loaded(np.zeros(6)) is course
    once = course.loaded(ROPE)
    twice = once.loaded(ROPE)
    assert once.wrench is not None
    assert twice.wrench is not None
    np.testing.assert_array_equal(twice.wrench, np.tile(2.0 * ROPE, (5, 1)))


def test_parts_of_a_course_keep_their_wrench(course: Problem) -> None:
    pulled = replace(course, wrench=np.outer(np.arange(5.0), ROPE))
    assert pulled.wrench is not None
    window, paused, apart = (
        course_window(pulled, 0, 2),
        with_pause(pulled, 1),
        one_at_a_time(pulled, 2, 2),
    )
    assert window.wrench is not None
    assert paused.wrench is not None
    assert apart.wrench is not None
    np.testing.assert_array_equal(window.wrench, pulled.wrench[:3])
    np.testing.assert_array_equal(paused.wrench, pulled.wrench[[0, 1, 1, 2, 3, 4]])
    np.testing.assert_array_equal(apart.wrench, pulled.wrench[[0, 1, 2, 2, 2, 3, 4]])
    of_stance = pulled.posture_problem(
        pulled.stances[2], np.zeros(len(pulled.footholds), dtype=int)
    )
    assert of_stance.wrench is not None
    np.testing.assert_array_equal(of_stance.wrench[0], pulled.wrench[pulled.stances[2].frame])
    np.testing.assert_array_equal(of_stance.posture_with(mass_kg=11.0).wrench, of_stance.wrench)
    np.testing.assert_array_equal(of_stance.course().wrench, of_stance.wrench)


def test_between_frames_a_wrench_goes_over(course: Problem) -> None:
    assert course.wrench_at(1.5) is None
    pulled = replace(course, wrench=np.outer(np.arange(5.0), ROPE))
    for frame in (0.0, 1.25, 3.5, 4.0):
        np.testing.assert_allclose(pulled.wrench_at(frame), frame * ROPE)


def test_a_leap_and_what_is_no_wrench_are_refused_before_anything_is_planned() -> None:
    with refuses("wrench"):
        stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=(1.0, 2.0)))
    with refuses("wrench"):
        stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=(0.0, 0.0, -1e5)))
    with refuses("wrench"):
        stancekit.plan(
            leap_class("leap-hard").draw(np.random.default_rng(0)),
            settings=stancekit.PlanSettings(wrench=(1.0, 0.0, 0.0)),
        )
