"""Walks in the playground: planned beside the page, dropped when something else is asked for, saved
as the verifier accepts them.
"""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from stancekit.planners.formats.trajectory_file import read_trajectory
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.views.playground.scenario import WalkScenario
from stancekit.views.playground.serving import served_walk
from stancekit.views.playground.walk_page import WalkPlanning
from tests.emulators.chromium import CHROMIUM, opened
from tests.emulators.playground import middle_of, pixel_of
from tests.refusals import assert_names, refuses

PATIENCE_S = 120.0
VERDICT = "document.querySelector('#verdict')"


@pytest.fixture(scope="module")
def scenario() -> WalkScenario:
    """A short walk over a swell."""
    field = HeightField.from_function(lambda x, y: 0.03 * np.sin(2.0 * x), 2.0, 0.1, name="swell")
    return WalkScenario.of(field, "anymal", goal_m=(0.5, 0.1))


def test_a_walk_takes_its_time_until_that_is_slid(scenario):
    assert scenario.takes_s == 2.0
    far = scenario.dragged("goal", np.array([1.5, 0.0, 9.0]))
    assert far.takes_s == 6.0
    assert far.slid("duration_s", 8.0).takes_s == 8.0
    assert far.slid("friction", 0.3).task().friction == 0.3
    start, goal = far.grips()
    assert goal.position_m == pytest.approx(
        [1.5, 0.0, 0.03 * np.sin(3.0) + far.walker.stand_height_m], abs=1e-3
    )
    assert start.axes == (True, True, False)
    with refuses("goal_xy_m"):
        scenario.dragged("goal", np.array([30.0, 0.0, 0.0])).task()


def test_only_the_last_walk_that_is_asked_for_is_answered(scenario):
    answers, done = [], threading.Event()

    def on_answer(number, answer):
        answers.append((number, answer))
        if answer.done:
            done.set()

    planning = WalkPlanning(on_answer)
    planning.begin(1, scenario.dragged("goal", np.array([1.2, 0.4, 0.0])).task())
    planning.begin(2, scenario.task())
    assert done.wait(PATIENCE_S)
    planning.end()
    assert {number for number, answer in answers if answer.done} == {2}
    found = answers[-1][1]
    assert found.accepted
    assert found.trajectory is not None
    assert check_trajectory(found.trajectory).accepted
    assert found.trajectory.torso_m[-1, :2] == pytest.approx([0.5, 0.1], abs=1e-3)


def test_a_planning_that_is_killed_is_told_and_one_that_is_ended_is_not(scenario):
    answers, told = [], threading.Event()

    def on_answer(number, answer):
        answers.append((number, answer))
        if answer.done:
            told.set()

    planning = WalkPlanning(on_answer)
    planning.begin(1, scenario.task())
    planning.end()
    planning.begin(2, scenario.task())
    assert planning._process is not None
    planning._process.kill()  # not all that there are: another test's workers may live in this process, too
    assert told.wait(PATIENCE_S)
    planning.end()
    assert {number for number, _ in answers} == {2}
    assert not answers[-1][1].accepted
    assert_names(answers[-1][1].message, "process")


@pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium is installed (Debian: apt-get install chromium)"
)
def test_a_walk_is_dragged_planned_and_saved_in_a_browser(scenario, tmp_path):
    with (
        served_walk(scenario, folder=tmp_path) as page,
        opened(page.address, tmp_path / "profile", (1000, 640), draws=False) as tab,
    ):
        tab.wait_for(f"{VERDICT}?.dataset.patient === '1'")
        tab.wait_for("document.querySelector('#limbs') !== null")
        assert "Accepted" in tab.text()
        goal = page.playground.scenario.torso_m(page.playground.scenario.goal_m)
        east = np.array([1.0, 0.0, 0.0])
        tab.drag(*(pixel_of(page, tab, goal + along * east) for along in (0.10, 0.16)))
        tab.wait_for(f"{VERDICT}.dataset.change > 0")
        until = time.monotonic() + PATIENCE_S
        while (
            answer := page.playground.answer
        ) is None or not answer.done:  # the last of the drag's changes
            assert time.monotonic() < until, page.playground.answer
            time.sleep(0.05)
        tab.wait_for(
            f"{VERDICT}.dataset.change === '{page.playground.number}' && {VERDICT}.dataset.patient === '1'"
        )
        assert page.playground.scenario.goal_m == pytest.approx((0.56, 0.1), abs=0.02)
        tab.click(
            *middle_of(
                tab,
                "[...document.querySelectorAll('button')].find(b => b.innerText === 'save walk')",
            )
        )
        tab.wait_for("document.querySelector('#saved') !== null")
    trajectory = read_trajectory(tmp_path / "played-walk.json").trajectory
    assert check_trajectory(trajectory).accepted
    assert trajectory.goal_xy_m == pytest.approx(page.playground.scenario.goal_m)
