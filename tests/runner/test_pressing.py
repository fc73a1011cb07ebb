"""Feet press against each other where a plan hangs between them, and only there."""

from __future__ import annotations

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.control.foot_placement import ContactFeedback
from stancekit.runner.control.tracker import Tracker


def added(course: str, deaf: int | None = None, **settings: float) -> tuple[Array, Array]:
    """Joint targets with pressing less those without, after forces were missing: of those that are
    asked for a half.

    deaf: the foot that feels nothing. settings: of the pressing.
    """
    plan = TwoStagePlanner().solve(read_course(course, frames=2)).solution
    assert plan is not None
    motion, kinematics = PlanMotion(plan), Kinematics(plan.problem.robot)
    felt = 0.5 * motion.at(0.0).forces_n
    if deaf is not None:
        felt[deaf] = 0.0
    targets = []
    for press_hz in (4.0, 0.0):
        tracker = Tracker(motion, kinematics, 100.0, ContactFeedback(press_hz=press_hz, **settings))
        tracker.start()
        for _ in range(20):
            target = tracker.next(felt)
            assert target is not None
        targets.append(target.targets_rad)
    return targets[0] - targets[1], np.array(motion.at(0.0).normals)


def test_feet_between_walls_press_harder_where_they_feel_too_little() -> None:
    more, normals = added("walls")
    assert np.abs(normals[:, 2]).max() < 1e-9
    assert np.abs(more).max() > 1e-3


def test_feet_on_level_ground_do_not() -> None:
    more, normals = added("stairs")
    np.testing.assert_allclose(normals[:, 2], 1.0)
    np.testing.assert_array_equal(more, 0.0)


def test_a_foot_that_feels_nothing_is_pressed_no_harder() -> None:
    heard, _ = added("walls")
    more, _ = added("walls", deaf=0)
    assert np.abs(heard[:4]).max() > 1e-3
    np.testing.assert_allclose(more[:4], 0.0, atol=1e-12)
    assert np.abs(more[4:]).max() > 1e-3


def test_no_more_is_added_than_the_settings_say() -> None:
    usual, _ = added("walls")
    some, _ = added("walls", press_n=1.0, press_share=0.0)
    none, _ = added("walls", press_n=0.0, press_share=0.0)
    assert 0.0 < np.abs(some).max() < 0.5 * np.abs(usual).max()
    np.testing.assert_allclose(none, 0.0, atol=1e-9)
