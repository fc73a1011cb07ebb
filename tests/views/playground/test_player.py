"""The player: a slider and a button of a page that is not there."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.problem.course_file import builtin_courses, course_difference, read_course
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.explanation import Relaxation, _change
from stancekit.views.playground.answers import explained, quick_answer
from stancekit.views.playground.playground import Player, from_behind
from stancekit.views.playground.scenario import Scenario
from tests.emulators.chromium import PATIENCE_S
from tests.refusals import assert_names, refuses


class Handle(SimpleNamespace):
    """A button, or a slider."""

    def on_click(self, call):
        self.call = call

    on_update = on_click


class Gui:
    """Makes them."""

    def add_button(self, label):
        self.button = Handle(label=label)
        return self.button

    def add_slider(self, _name, *, max, initial_value, **_more):
        self.slider = Handle(max=max, value=initial_value)
        return self.slider

    def slide(self, value, client=1):
        self.slider.call(SimpleNamespace(client=client, target=SimpleNamespace(value=value)))


@pytest.fixture
def played():
    gui, seen, due, moved = Gui(), [], threading.Semaphore(0), threading.Semaphore(0)

    def pause(stop):  # a clock that goes when the test lets it
        due.acquire()
        return stop.is_set()

    def on_time():
        seen.append(player.at)
        moved.release()
        return player.at != 3.0  # as if nothing were to be seen then

    def tick():
        due.release()
        return moved.acquire(timeout=PATIENCE_S)

    player = Player(gui, on_time, threading.RLock(), pause)
    yield gui, player, seen, tick
    due.release()  # its thread ends


def test_a_slider_shows_another_time_when_a_person_slides_it(played):
    gui, player, seen, _ = played
    player.show(5.0, 4.0)
    assert (player.at, gui.slider.max, gui.slider.value, seen) == (4.0, 4.0, 4.0, [])
    gui.slide(2.5, client=None)  # the page itself
    assert player.at == 4.0
    gui.slide(2.5)
    gui.slide(9.0)
    assert seen == [2.5, 4.0]
    gui.slide(3.0)
    assert player.at == 4.0


def test_it_plays_from_the_beginning_to_the_end_and_again_until_it_is_stopped(played):
    gui, player, seen, tick = played
    player.show(0.5, 0.5)
    gui.button.call(None)
    assert gui.button.label == "stop"
    for _ in range(11):
        assert tick()
    gui.button.call(None)
    assert gui.button.label == "play"
    assert seen[:3] == pytest.approx([0.0, 1 / 15, 2 / 15])
    assert seen[8:10] == pytest.approx([0.5, 0.0])
    assert len(seen) == 11


def test_limbs_are_explained_by_their_letters_and_other_names_are_not_guessed():
    assert explained(["LF", "RM", "LH", "FL_foot"]).startswith(
        "LF left front, RM right middle, LH left hind, as the robot looks. "
    )
    assert explained(["arm"]).startswith("Cone: ")


@pytest.mark.parametrize("goal", [(1.0, 0.0), (-1.0, 0.0), (0.3, -2.0), (0.0, 0.0)])
@pytest.mark.parametrize("towards", [(-0.75, -0.45, 0.35), (0.75, 0.45, 0.35), (0.0, 1.0, 0.2)])
def test_what_is_left_of_the_robot_is_left_on_the_page(goal, towards):
    ahead = np.array([*goal, 0.0]) if any(goal) else np.array([1.0, 0.0, 0.0])
    eye = from_behind(np.array(towards), np.zeros(3), np.array([*goal, 0.2]))
    assert np.linalg.norm(eye) == pytest.approx(np.linalg.norm(towards))
    left_of_robot, right_of_page = np.cross([0.0, 0.0, 1.0], ahead), np.cross([0.0, 0.0, 1.0], eye)
    assert left_of_robot @ right_of_page <= 1e-12


@pytest.mark.parametrize(
    ("now", "needed", "words"),
    [
        (0.05, 0.30405, "rise from 0.05 to at least 0.304"),
        (0.05, 0.30399, "rise from 0.05 to at least 0.303"),
        (0.9, 0.4111, "fall from 0.9 to at most 0.412"),
        (0.3, 0.3004, "rise from 0.3 by at least 0.0004"),
        (0.0, 12.345, "rise from 0 to at least 12.3"),
    ],
)
def test_a_change_is_said_with_its_way_and_its_bound(now, needed, words):
    assert (
        _change(Relaxation(parameter="friction", leg="", now=now, needed=needed, unit="")) == words
    )


def read_again(scenario, folder):
    """The course of the file that a scene is saved as."""
    suffix, text = scenario.text()
    (folder / f"again{suffix}").write_text(text, encoding="utf-8")
    return read_course(folder / f"again{suffix}")


@pytest.mark.parametrize("name", [*builtin_courses(), "stones:0.3:1"])
def test_a_scene_that_nobody_changed_is_the_course_and_so_is_its_file(name, tmp_path):
    scenario = Scenario.of(name)
    assert course_difference(scenario.course(), read_course(name)) == ""
    assert course_difference(read_again(scenario, tmp_path), read_course(name)) == ""


@pytest.mark.parametrize("name", ["walls", "stairs", "ground-to-wall"])
def test_a_goal_that_is_dragged_is_where_the_way_ends_and_frames_follow(name, tmp_path):
    scenario = Scenario.of(name)
    before = scenario.course()
    goal = before.goal_m + np.array([0.02, 0.01, 0.03])
    after = scenario.dragged("goal", goal)
    course = after.course()
    assert course.goal_m == pytest.approx(goal, abs=1e-4)
    way = np.linalg.norm(np.diff(course.com_nominal_m, axis=0), axis=1)
    assert way.max() <= scenario.stride_m + 1e-9
    assert course.frames > before.frames
    assert after.slid("frames", 5).dragged("goal", before.goal_m).course().frames == 5
    assert course_difference(read_again(after, tmp_path), course) == ""


def test_walls_move_by_their_grips_and_sliders():
    scenario = Scenario.of("walls")
    left = next(grip for grip in scenario.grips(scenario.course()) if grip.key == "left wall")
    assert left.position_m[1] == pytest.approx(0.38)
    assert left.axes == (False, True, False)
    moved = scenario.dragged("left wall", left.position_m + np.array([0.0, 0.03, 0.0]))
    assert [p.centre_m[1] for p in moved.course().terrain] == pytest.approx([0.41, -0.38])
    assert [p.centre_m[1] for p in moved.slid("apart_m", 0.35).course().terrain] == pytest.approx(
        [0.38, -0.35]
    )
    leant = scenario.slid("lean_rad.1", 10.0).course().terrain
    assert leant[1].normal[2] == pytest.approx(-np.sin(np.deg2rad(10.0)))


def test_mass_and_friction_are_those_of_the_plan_and_weight_scales_forces():
    scenario = Scenario.of("walls").slid("mass_kg", 20.0)
    light, heavy = quick_answer(Scenario.of("walls")), quick_answer(scenario)
    assert heavy.plan.problem.weight_n == pytest.approx(2.0 * light.plan.problem.weight_n)
    assert check_plan(heavy.plan).accepted
    np.testing.assert_allclose(
        heavy.plan.forces_n.sum(axis=1) - [0.0, 0.0, 20.0 * 9.81], 0.0, atol=1e-3
    )


def test_without_friction_there_is_no_plan_and_the_sentence_names_it():
    answer = quick_answer(Scenario.of("walls").slid("friction", 0.0))
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
    answer = quick_answer(change(Scenario.of("walls")))
    assert answer.course is None
    assert answer.plan is None
    assert_names(answer.message, name)


def test_another_robot_stands_as_it_does(tmp_path):
    scenario = Scenario.of("stairs", frames=3)
    with refuses("robot"):
        scenario.with_robot(str(tmp_path / "robot.yaml"))
    again = replace(scenario, keys={**scenario.keys, "robot": "hexapod"}).with_robot("hexapod")
    assert course_difference(again.course(), scenario.course()) == ""
