"""What went wrong behind a real ROS, on an emulator that is as unkind: each case with what is
right.
"""

from __future__ import annotations

import time
from typing import Any, Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import same_names
from tests.emulators import rosbridge
from tests.emulators.ros_robots import JOINTS, QUICK, ROBOT, START, armed, commands, emulated, reset
from tests.emulators.rosbridge import RosBridge
from tests.refusals import refuses

Ros = Literal[1, 2]
MANAGED: dict[str, Any] = {"controller_manager": "/controller_manager"}


def world_of(bridge: RosBridge, **settings: Any) -> RosWorld:
    return RosWorld(
        ROBOT, same_names(JOINTS, port=bridge.port, **(QUICK | {"ros": bridge.ros} | settings))
    )


def stream(world: RosWorld, steps: int = 400, speed_rad_s: float = 0.5) -> None:
    for k in range(steps):
        world.step(START + 0.4 * np.sin(speed_rad_s / 0.4 * k / world.rate_hz))


def moved_rad(bridge: RosBridge, since: list[float]) -> float:
    return float(np.abs(np.array(bridge.state()["position_rad"]) - since).max())


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("kind", ["zeros", "one jump"])
def test_zeros_of_a_second_publisher_arm_nothing_and_stop_what_moves(ros: Ros, kind: str) -> None:
    with emulated(ros=ros) as bridge, world_of(bridge) as world:
        bridge.inject("zeros")
        with refuses("/joint_states"):
            reset(world)
        assert commands(bridge) == []
    with armed(ros) as (bridge, world):
        bridge.inject(kind, 0.3)
        with refuses("/joint_states", kind=HardwareFault):
            stream(world)
        assert not world.armed


def test_a_second_publisher_that_is_a_little_off_is_found_by_what_the_controller_measures() -> None:
    with armed(1) as (bridge, world):
        bridge.inject("shifted", 0.2)
        with refuses("/joint_states", kind=HardwareFault):
            stream(world)


@pytest.mark.parametrize("ros", [1, 2])
def test_a_rosbridge_that_freezes_delivers_nothing_late_that_moves_the_robot(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rosbridge, "FROZEN_S", 2.5)
    with armed(ros) as (bridge, world):
        bridge.inject("frozen", 0.5)
        with refuses(kind=HardwareFault):
            stream(world)
        world.hold()
        held, void = bridge.state()["position_rad"], "out of date by its stamps" in world.pending
        assert void or "may still move it" in world.pending
        rosbridge.time.sleep(max(bridge._thaw_s - rosbridge.time.monotonic(), 0.0) + 1.0)
        since = [what for what, at_s in bridge.log if at_s > bridge._thaw_s]
        assert ("halt" in since) == (ros == 1)
        if void:
            assert moved_rad(bridge, held) < 2e-3
            assert "stream" not in since


def test_without_stamps_the_report_says_that_commands_may_still_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rosbridge, "FROZEN_S", 2.5)
    with (
        emulated(ros=2, stamps=False) as bridge,
        RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world,
    ):
        reset(world)
        world.torque(True)
        bridge.inject("frozen", 0.5)
        with refuses(kind=HardwareFault):
            stream(world)
        world.hold()
        assert "have no stamps, and may still move it" in world.pending


def test_after_a_stop_of_a_robot_that_is_heard_nothing_is_pending() -> None:
    with armed(1) as (bridge, world):
        stream(world, 20)
        world.hold()
        assert world.pending == ""
        held = bridge.state()["position_rad"]
        time.sleep(0.3)
        assert moved_rad(bridge, held) < 2e-3


@pytest.mark.parametrize(
    ("estop", "rosapi", "how", "why"),
    [
        ("regular", False, "heard", "e-stop /e_stop: heard"),
        ("latched", False, "heard", "e-stop /e_stop: heard"),
        ("quiet", True, "heard", "e-stop /e_stop: published by /estop_node"),
        ("none", True, "without", "e-stop /e_stop: not asked for"),
    ],
)
def test_an_e_stop_that_is_heard_or_published_lets_a_robot_be_armed(
    estop: Any, rosapi: bool, how: Any, why: str
) -> None:
    with emulated(ros=1, estop=estop, rosapi=rosapi) as bridge, world_of(bridge) as world:
        world.estop = how
        reset(world)
        world.torque(True)
        assert world.evidence == why


@pytest.mark.parametrize(
    ("estop", "rosapi", "name"),
    [
        ("none", True, "--try-estop"),
        ("none", False, "rosapi"),
        ("quiet", False, "rosapi"),
        ("other type", True, "std_msgs/Int8"),
    ],
)
def test_an_e_stop_that_nobody_hears_arms_nothing(estop: Any, rosapi: bool, name: str) -> None:
    with emulated(ros=1, estop=estop, rosapi=rosapi) as bridge, world_of(bridge) as world:
        reset(world)
        with refuses("/e_stop", name):
            world.torque(True)
        assert not world.armed
        assert commands(bridge) == []


def test_an_e_stop_that_loses_its_publisher_stops_the_robot() -> None:
    with armed(1) as (bridge, world):
        bridge.inject("e-stop gone", 0.1)
        with refuses("/e_stop", kind=HardwareFault):
            stream(world, 800)


def test_an_e_stop_is_tried_by_pressing_and_releasing_it() -> None:
    with emulated(ros=1, estop="regular", rosapi=False) as bridge, world_of(bridge) as world:
        world.estop = "try"
        reset(world)
        bridge.inject("e-stop", 0.2)
        bridge.inject("e-stop released", 1.2)
        world.torque(True)
        assert world.evidence == "e-stop /e_stop: pressed and released"
        stream(world, 3)


@pytest.mark.parametrize("wait_s", [0.0, 0.3])
def test_a_goal_right_after_arming_is_taken_and_its_cancel_waits_until_it_is(wait_s: float) -> None:
    for _ in range(2):
        with armed(1) as (bridge, world):
            time.sleep(wait_s)
            world.run_trajectory(np.array([0.3]), START[None, :] + 0.1)
            assert commands(bridge)[:3] == ["stream", "goal", "cancel"]


def test_wheels_without_positions_are_left_alone() -> None:
    with armed(1) as (bridge, world):
        bridge.inject("wheels")
        stream(world, 40)
        assert world.armed


@pytest.mark.parametrize("ros", [1, 2])
def test_after_torque_off_a_run_starts_again(ros: Ros) -> None:
    with armed(ros, **MANAGED) as (bridge, world):
        world.relax()
        assert not bridge.robot.on
        with world_of(bridge, **MANAGED) as again:
            reset(again)
            again.torque(True)
            again.step(START)
            assert bridge.robot.on
        with world_of(bridge) as other:
            world.relax()
            with refuses():
                reset(other)


@pytest.mark.parametrize(
    ("there", "said", "name"),
    [
        (1, 2, "ros: 1"),
        (2, 1, "ros: 2"),
    ],
)
def test_ros_1_where_2_is_set_up_and_the_reverse_are_one_line(
    there: Ros, said: Ros, name: str
) -> None:
    with emulated(ros=there) as bridge, world_of(bridge, ros=said) as world:
        with refuses(name):
            reset(world)
        assert commands(bridge) == []


def test_another_client_is_named_before_and_after_arming() -> None:
    with armed(1) as (bridge, world):
        bridge.inject("other client", 0.3)
        with refuses(kind=HardwareFault):
            stream(world)


@pytest.mark.parametrize(
    "settings",
    [
        {"rate_hz": 10.0},
        {"stamps": False},
        {"clock_s": -2.0},
        {"rosapi": False},
        {"other": ("wheel",)},
    ],
)
def test_odd_robots_are_armed_and_move(settings: dict[str, Any]) -> None:
    with emulated(ros=1, **settings) as bridge, world_of(bridge) as world:
        reset(world)
        world.torque(True)
        stream(world, 25)
        assert world.armed
