"""Scenes that are changed: what is asked for is what was dragged and slid, and files give the same
course again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.problem.course_file import builtin_courses, course_difference, read_course
from stancekit.planners.verify import check_plan
from stancekit.views.playground.keys_scenario import KeysScenario
from stancekit.views.playground.page_parts import quick_answer
from stancekit.views.playground.scenario import FixedScenario
from tests.refusals import assert_names, refuses


def read_again(scenario, folder):
    """The course of the file that a scene is saved as."""
    suffix, text = scenario.text()
    (folder / f"again{suffix}").write_text(text, encoding="utf-8")
    return read_course(folder / f"again{suffix}")


def slider(scenario, key):
    return next(each for each in scenario.sliders() if each.key == key)


@pytest.mark.parametrize("name", [*builtin_courses(), "stones:0.3:1"])
def test_a_scene_that_nobody_changed_is_the_course_and_so_is_its_file(name, tmp_path):
    scenario = KeysScenario.of(name)
    assert course_difference(scenario.course(), read_course(name)) == ""
    assert course_difference(read_again(scenario, tmp_path), read_course(name)) == ""


@pytest.mark.parametrize("name", ["walls", "stairs", "ground-to-wall"])
def test_a_goal_that_is_dragged_is_where_the_way_ends_and_frames_follow(name, tmp_path):
    scenario = KeysScenario.of(name)
    before = scenario.course()
    goal = before.goal_m + np.array([0.02, 0.01, 0.03])
    after = scenario.dragged("goal", goal)
    course = after.course()
    assert course.goal_m == pytest.approx(goal, abs=1e-4)
    way = np.linalg.norm(np.diff(course.com_nominal_m, axis=0), axis=1)
    assert way.max() <= scenario.stride_m + 1e-9
    assert course.frames > before.frames
    slid = after.slid("frames", 5).dragged("goal", before.goal_m)
    assert slid.course().frames == 5
    assert course_difference(read_again(after, tmp_path), course) == ""


def test_walls_move_by_their_grips_and_sliders():
    scenario = KeysScenario.of("walls")
    left = next(grip for grip in scenario.grips(scenario.course()) if grip.key == "left wall")
    assert left.position_m[1] == pytest.approx(0.38)
    assert left.axes == (False, True, False)
    moved = scenario.dragged("left wall", left.position_m + np.array([0.0, 0.03, 0.0]))
    planes = [patch.centre_m[1] for patch in moved.course().terrain]
    assert planes == pytest.approx([0.41, -0.38])
    assert [p.centre_m[1] for p in moved.slid("apart_m", 0.35).course().terrain] == pytest.approx(
        [0.38, -0.35]
    )
    leant = scenario.slid("lean_rad.1", 10.0).course().terrain
    assert leant[1].normal[2] == pytest.approx(-np.sin(np.deg2rad(10.0)))


def test_a_picked_surface_becomes_a_polygon_with_its_own_place_and_friction(tmp_path):
    scenario = KeysScenario.of("icy-walls")
    course = scenario.course()
    picked = scenario.picked(course, 7)
    assert course_difference(picked.course(), course) == ""
    place = course.terrain[7].centre_m + np.array([0.0, 0.02, 0.01])
    moved = picked.dragged("surface", place).slid("surface", 0.25)
    assert moved.course().terrain[7].centre_m == pytest.approx(place, abs=1e-3)
    assert [patch.friction for patch in moved.course().terrain].count(0.25) == 1
    assert moved.course().terrain[7].friction == 0.25
    assert course_difference(read_again(moved, tmp_path), moved.course()) == ""


def test_mass_and_friction_are_those_of_the_plan_and_weight_scales_forces():
    scenario = KeysScenario.of("walls").slid("mass_kg", 20.0)
    light, heavy = quick_answer(KeysScenario.of("walls")), quick_answer(scenario)
    assert heavy.plan is not None
    assert light.plan is not None
    assert heavy.plan.problem.weight_n == pytest.approx(2.0 * light.plan.problem.weight_n)
    assert check_plan(heavy.plan).accepted
    carried = heavy.plan.forces_n.sum(axis=1)
    assert carried == pytest.approx(np.tile([0.0, 0.0, 20.0 * 9.81], (len(carried), 1)), abs=1e-3)


def test_without_friction_there_is_no_plan_and_the_sentence_names_it():
    answer = quick_answer(KeysScenario.of("walls").slid("friction", 0.0))
    assert answer.status is Status.INFEASIBLE
    assert answer.plan is None
    assert_names(answer.message, "friction", "0", "0.303")


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda s: s.slid("mass_kg", 0.0), "mass_kg"),
        (
            lambda s: s.dragged("goal", np.array([500.0, 0.0, 0.2])),
            "goal_m",
        ),
        (
            lambda s: s.dragged("left wall", np.array([0.0, 9.0, 0.2])),
            "limb",
        ),
        (
            lambda s: s.slid("lean_rad.0", 80.0),
            "terrain.lean_rad[0]",
        ),
    ],
)
def test_what_makes_no_sense_is_one_sentence(change, name):
    answer = quick_answer(change(KeysScenario.of("walls")))
    assert answer.course is None
    assert answer.plan is None
    assert_names(answer.message, name)


def test_another_robot_stands_as_it_does(tmp_path):
    scenario = KeysScenario.of("stairs", frames=3)
    model = tmp_path / "robot.yaml"
    with refuses("robot"):
        scenario.with_robot(str(model))
    again = replace(scenario, keys={**scenario.keys, "robot": "hexapod"}).with_robot("hexapod")
    assert course_difference(again.course(), scenario.course()) == ""


def test_fixed_scenes_move_their_surfaces_with_what_was_offered_of_them(tmp_path):
    course = read_course("stairs")
    scenario = FixedScenario(laid=course).picked(course, 3)
    by = np.array([0.01, 0.02, 0.005])
    moved = scenario.dragged("surface", course.terrain[3].centre_m + by).slid("surface", 0.5)
    found = moved.course()
    for old, new in zip(course.footholds, found.footholds, strict=True):
        for before, after in zip(old.candidates, new.candidates, strict=True):
            third = before is course.terrain[3]
            assert after.centre_m - before.centre_m == pytest.approx(
                by if third else np.zeros(3), abs=1e-12
            )
            assert after.friction == (0.5 if third else before.friction)
    assert moved.slid("friction", 0.5).course().terrain[3].friction == 0.25
    assert course_difference(read_again(moved, tmp_path), found) == ""
    with refuses("robot", "hexapod"):
        moved.with_robot("hexapod")
