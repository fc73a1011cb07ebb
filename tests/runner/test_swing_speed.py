"""Legs in the air are led no faster than their joints turn, and the motion waits for those that are
late.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.plan_motion import KNOTS, PlanMotion
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import Servo
from stancekit.runner.control.tracker import PAUSE_S, RAMP_S, SPEED_SHARE, SwingSpeed, Tracker
from stancekit.runner.motion.redundancy import resolved
from stancekit.runner.motion.time_parametrization import (
    BLIND,
    LIMIT_SHARE,
    RATE_HZ,
    STEADY,
    expected,
    joint_profile,
    undisturbed,
    unhurried,
)
from stancekit.runner.worlds.drives import Drives
from tests.runner.test_redundancy import plan, twisted

__all__ = ["plan"]
PERIOD_S, VELOCITY_RAD_S = 0.005, 4.0


def test_a_joint_that_comes_too_fast_to_brake_stops_at_its_limit() -> None:
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    lowest, air = kinematics.lowest_rad[5], np.arange(6) == 1
    before, rates = np.zeros(24), np.zeros(24)
    before[5], rates[5] = (
        lowest + 0.005,
        -0.9 * VELOCITY_RAD_S,
    )  # a hip, a few milliradians before its limit
    goal = np.zeros(24)
    goal[5] = lowest
    angles = swing.led(before, rates, goal, air)
    assert before[5] + PERIOD_S * rates[5] < lowest
    assert angles[5] == lowest


def test_a_joint_that_is_asked_to_jump_comes_to_its_speed_softly_and_the_motion_waits_for_it() -> (
    None
):
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    goal, air = np.zeros(24), np.arange(6) == 1
    goal[4:8], goal[0] = [1.0, 0.0, -0.5, 0.0], 1.0
    path, rates, paces = [np.zeros(24)], np.zeros(24), list[float]()
    for _ in range(200):
        path.append(swing.led(path[-1], rates, goal, air))
        rates = (path[-1] - path[-2]) / PERIOD_S
        paces.append(swing.pace)
    speed = np.diff(np.array(path), axis=0)[:, 4:8] / PERIOD_S
    top = SPEED_SHARE * VELOCITY_RAD_S
    assert np.abs(speed).max() == pytest.approx(top)
    assert np.abs(np.diff(speed[:, 0], prepend=0.0)).max() <= top * PERIOD_S / RAMP_S + 1e-9
    assert speed.min(axis=0)[0] >= 0.0, "it brakes in time, and does not come back"
    np.testing.assert_allclose(speed[:, 2], -0.5 * speed[:, 0], atol=1e-12)
    np.testing.assert_array_equal(path[-1][4:8], goal[4:8])
    assert path[1][0] == 1.0, "a leg that stands is not led"
    assert min(paces) == 0.0
    assert paces[-1] == 1.0
    assert np.abs(np.diff(paces)).max() == pytest.approx(PERIOD_S / PAUSE_S)


def test_a_leg_that_comes_from_elsewhere_goes_along_with_what_it_follows_and_then_the_motion_waits_no_more() -> (
    None
):
    kinematics = Kinematics(hexapod())
    swing = SwingSpeed(kinematics, np.full(24, VELOCITY_RAD_S), PERIOD_S)
    times = PERIOD_S * np.arange(300)
    wanted = np.zeros((300, 24))
    wanted[:, 4] = 0.4 * np.sin(3.0 * times) + 0.8 * (times > 0.5)
    path, rates, paces = [wanted[0]], np.zeros(24), list[float]()
    for goal in wanted:
        path.append(swing.led(path[-1], rates, goal, np.ones(6, dtype=bool)))
        rates = (path[-1] - path[-2]) / PERIOD_S
        paces.append(swing.pace)
    sent = np.array(path[1:])[:, 4]
    speed = np.diff(sent) / PERIOD_S
    top = SPEED_SHARE * VELOCITY_RAD_S
    assert np.abs(np.diff(speed)).max() <= top * PERIOD_S / RAMP_S + 1e-9
    assert np.abs(speed).max() <= top + 1e-9
    away = np.abs(sent - wanted[:, 4])
    assert away[20:99].max() == 0.0
    assert away[101] > 0.7
    assert away[-1] == 0.0
    assert min(paces) < 0.1
    assert paces[99] == paces[-1] == 1.0


def test_no_joint_in_the_air_is_sent_faster_than_it_turns_where_a_plans_postures_are_far_apart(
    plan: Plan,
) -> None:
    kinematics, motion = Kinematics(plan.problem.robot), PlanMotion(twisted(plan))
    profile = joint_profile(motion, kinematics)
    air = np.array([target.sample.foothold for target in profile.targets]) < 0
    flies = np.repeat(air[1:] & air[:-1], 4, axis=1)
    sent = np.abs(np.diff(profile.angles_rad, axis=0))[flies] * 100.0
    assert 0.5 * SPEED_SHARE * VELOCITY_RAD_S < sent.max() <= SPEED_SHARE * VELOCITY_RAD_S + 1e-9
    change = np.abs(np.diff(profile.angles_rad, n=2, axis=0))[flies[1:] & flies[:-1]] * 100.0**2
    assert change.max() <= SPEED_SHARE * VELOCITY_RAD_S / RAMP_S + 1e-6
    assert profile.time_s[-1] >= motion.duration_s - 0.02


def test_a_gait_waits_for_no_leg(plan: Plan) -> None:
    kinematics, motion = (
        Kinematics(plan.problem.robot, Servo(velocity_rad_s=1.0)),
        PlanMotion(twisted(plan)),
    )
    waits, steady = (len(undisturbed(motion, kinematics, feedback=how)) for how in (BLIND, STEADY))
    assert 0.0 <= steady - 1 - motion.duration_s * RATE_HZ <= 1.0 + 1e-6
    assert waits > steady + 2


def test_every_phase_alone_is_as_long_as_its_joints_need(plan: Plan) -> None:
    kinematics, motion = Kinematics(plan.problem.robot), PlanMotion(twisted(plan))
    wished = resolved(motion, kinematics)
    slow = np.full(24, 0.4)
    longer = unhurried(motion, wished, slow, np.inf)
    assert longer.min() == 1.0 < longer.max()
    other = PlanMotion(motion.plan, longer=longer)
    times = other.knots_s
    rates = np.abs(np.diff(wished.path_rad, axis=0)) / np.diff(times)[:, None]
    used = (rates / (LIMIT_SHARE * slow)).max(axis=1).reshape(-1, KNOTS).max(axis=1)
    np.testing.assert_allclose(used[longer > 1.0], 1.0)
    assert used.max() <= 1.0 + 1e-9
    for share in np.linspace(0.0, 1.0, 7):
        here, there = (
            share * motion.knots_s[-1],
            np.interp(share * motion.knots_s[-1], motion.knots_s, times),
        )
        np.testing.assert_allclose(other.at(there).feet_m, motion.at(here).feet_m, atol=1e-12)
    np.testing.assert_allclose(
        wished.retimed(times).at(float(times[7])), wished.path_rad[7], atol=1e-12
    )


def test_what_is_expected_is_of_the_moment_that_comes(step: Callable[[str], Plan]) -> None:
    """A motion that waits has another time than the clock has."""
    kinematics, motion = Kinematics(step("walls").problem.robot), PlanMotion(step("walls"))
    tracker = Tracker(
        motion,
        kinematics,
        100.0,
        drives=Drives.of(kinematics.robot, kinematics.servo, kinematics.model),
    )
    tracker.start()
    coming = tracker.coming
    target = tracker.next(expected(coming))
    assert target is not None
    np.testing.assert_array_equal(target.sample.feet_m, coming.feet_m)
