"""A controller that does not hear what is sent to it: late, never, or no more."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any, Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import same_names
from tests.emulators.ros_robots import JOINTS, QUICK, ROBOT, START, armed, commands, emulated, reset
from tests.emulators.rosbridge import RosBridge
from tests.refusals import refuses

Version = Literal[1, 2]


def measured(stack: ExitStack, bridge: RosBridge) -> RosWorld:
    """The world that has measured a robot."""
    setup = same_names(JOINTS, port=bridge.port, ros=bridge.ros, **QUICK)
    world = stack.enter_context(RosWorld(ROBOT, setup))
    reset(world)
    return world


def made(stack: ExitStack, ros: Version, **settings: Any) -> tuple[RosBridge, RosWorld]:
    """A robot, and the world that has measured it."""
    bridge = stack.enter_context(emulated(ros=ros, **settings))
    return bridge, measured(stack, bridge)


def slowly(world: RosWorld, first: int, last: int) -> None:
    """Move all joints by 0.2 rad/s."""
    for k in range(first, last):
        world.step(START + 0.2 * (k + 1) / world.rate_hz)


@pytest.mark.parametrize("ros", [1, 2])
def test_a_robot_that_hears_commands_seconds_late_is_armed_when_it_does_and_does_not_jump(
    ros: Version,
) -> None:
    with ExitStack() as stack:
        bridge = stack.enter_context(emulated(ros=ros, connect_s=2.5))
        begin_s = bridge.state()["now_s"]
        world = measured(stack, bridge)
        world.torque(True)
        assert bridge.state()["now_s"] - begin_s > 2.5
        np.testing.assert_allclose(bridge.state()["position_rad"], START, atol=2e-6)
        for k in range(40):
            state = world.step(START + 0.4 * (k + 1) / world.rate_hz)
            assert np.abs(bridge.robot.rate).max() < 0.6  # and it follows from the first of them on
        np.testing.assert_allclose(state.angles_rad, START + 0.32, atol=0.1)


def test_a_topic_that_a_robot_missed_is_advertised_anew() -> None:
    with ExitStack() as stack:
        bridge, world = made(stack, 1, misses=True)
        world.torque(True)
        slowly(world, 0, 20)
        ops = [
            message["op"]
            for message in bridge.received
            if message.get("topic", "").endswith("r/command")
        ]
        assert [op for op in ops if op != "publish"] == ["advertise", "unadvertise", "advertise"]
        assert set(commands(bridge)) == {"stream"}


@pytest.mark.parametrize("ros", [2])
def test_a_robot_that_hears_no_command_is_not_armed(ros: Version) -> None:
    with ExitStack() as stack:
        bridge, world = made(stack, ros, connect_s=60.0)
        topic = f"/joint_trajectory_controller/{'joint_trajectory' if ros == 2 else 'command'}"
        with refuses(topic):
            world.torque(True)
        assert not world.armed
        assert commands(bridge) == []
        np.testing.assert_allclose(bridge.state()["position_rad"], START, atol=1e-9)


@pytest.mark.parametrize("ros", [1, 2])
def test_a_robot_that_hears_no_command_any_more_stops_the_run(ros: Version) -> None:
    with armed(ros) as (bridge, world):
        slowly(world, 0, 20)
        bridge.inject("commands lost")
        with refuses("LF_yaw", kind=HardwareFault):
            slowly(world, 20, 200)
        assert not world.armed
        assert world._sent[0] < START[0] + 0.3  # after a second at most


def test_a_robot_at_rest_or_one_that_lags_is_not_taken_for_one_that_hears_nothing() -> None:
    with armed(1, lead_s=0.3) as (bridge, world):
        for _ in range(60):
            world.step(START)
        for k in range(60):
            world.step(START + 1.0 * (k + 1) / world.rate_hz)
        bridge.robot.stuck[:] = True  # joints that are stuck are no fault of the controller
        for _ in range(40):
            world.step(START + 1.2)
        assert world.armed


def test_goals_are_sent_again_to_an_action_server_that_connects_late() -> None:
    with ExitStack() as stack:
        bridge, world = made(stack, 1, connect_s=2.5)
        world.torque(True)
        state = world.run_trajectory(np.array([0.5]), START[None, :] + 0.1)
        np.testing.assert_allclose(state.angles_rad, START + 0.1, atol=0.03)
        assert commands(bridge).count("goal") == 2  # the one that is cancelled, and the trajectory
