"""Whole trajectories as goals of an emulated robot: followed, refused, cancelled whatever
happens.
"""

from __future__ import annotations

import threading
import time
from typing import Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import same_names
from stancekit.runner.worlds.world import State
from tests.emulators.fast_time import PACE
from tests.emulators.ros_robots import (
    JOINTS,
    QUICK,
    ROBOT,
    START,
    armed,
    commands,
    emulated,
    reset,
)
from tests.refusals import refuses


@pytest.mark.parametrize("ros", [1, 2])
def test_a_whole_trajectory_is_followed_with_feedback_and_ends_where_it_should(
    ros: Literal[1, 2],
) -> None:
    with armed(ros) as (bridge, world):
        states = list[State]()
        end = world.run_trajectory(
            np.array([0.3, 0.6]), np.array([START + 0.1, START - 0.05]), states.append
        )
        np.testing.assert_allclose(end.angles_rad, START - 0.05, atol=world.setup.goal_rad)
        assert max(state.angles_rad[0] for state in states) > 0.08
        assert commands(bridge)[:3] == [
            "stream",
            "goal",
            "cancel",
        ]  # the one that is cancelled to see that it can be
        assert commands(bridge)[-1] == "goal"
        world.run_trajectory(np.array([0.2]), START[None, :])
        assert commands(bridge).count("goal") == 3


def test_trajectories_that_are_too_long_too_fast_or_beyond_limits_are_refused_before_they_are_sent() -> (
    None
):
    with armed() as (bridge, world):
        for times, angles, name in (
            ([6.0], START + 0.1, "alone_s"),
            ([0.1], START + 0.5, "LF_yaw"),
            ([2.0], START + 2.0, "LF_yaw"),
            ([0.0], START, "times"),
        ):
            with refuses(name):
                world.run_trajectory(np.array(times), angles[None, :])
        time.sleep(0.1)
        assert commands(bridge) == ["stream"]


def test_a_rosbridge_that_reads_no_cancel_while_a_goal_is_on_its_way_is_refused() -> None:
    with emulated(one_thread=True) as bridge:
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
            reset(world)
            world.torque(True)
            with refuses("send_action_goals_in_new_thread:=true"):
                world.run_trajectory(np.array([1.0]), START[None, :] + 0.1)
        np.testing.assert_allclose(bridge.state()["position_rad"], START, atol=1e-6)


def test_hold_from_another_thread_cancels_the_trajectory() -> None:
    with armed() as (bridge, world):
        threading.Timer(1.0 / PACE, world.hold).start()
        with refuses(kind=HardwareFault):
            world.run_trajectory(np.array([4.0]), START[None, :] + 1.0)
        assert not world.armed
        stopped = bridge.state()["desired_rad"]
        time.sleep(0.2)
        assert bridge.state()["desired_rad"] == stopped
        assert stopped[0] < 0.6


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("stuck joint", "aborted"),
        ("rejects goals", "rejected"),
        ("connection lost", "connection"),
        ("rosbridge gone", "connection"),
        ("e-stop", "/e_stop"),
    ],
)
def test_a_trajectory_that_goes_wrong_is_a_fault_and_cancelled(
    ros: Literal[1, 2], kind: str, name: str
) -> None:
    with armed(ros) as (bridge, world):
        world.run_trajectory(np.array([0.1]), START[None, :])
        bridge.inject(kind, 0.0 if kind == "rejects goals" else 0.3)
        time.sleep(0.05)
        with refuses(name, kind=HardwareFault):
            world.run_trajectory(np.array([3.0]), START[None, :] + 1.2)
        assert not world.armed
        if kind != "rosbridge gone":
            time.sleep(0.2)
            assert bridge.state()["goals"] == 0
            assert bridge.state()["desired_rad"][0] < 0.6
