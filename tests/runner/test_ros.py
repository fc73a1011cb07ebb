"""A robot behind an emulated rosbridge as a world: streaming, and every way that it can go
wrong.
"""

from __future__ import annotations

import time
from typing import Any, Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import Servo
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import stamp_of
from stancekit.runner.worlds.ros.setup import RosJoint, RosSetup, same_names
from tests.emulators.ros_robots import JOINTS, QUICK, ROBOT, START, armed, commands, emulated, reset
from tests.emulators.rosbridge import EPOCH_S, RosBridge
from tests.refusals import refuses


def test_reset_measures_and_sends_nothing_that_could_move_the_robot() -> None:
    with emulated(other=["gripper"]) as bridge:
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
            state = reset(world)
            np.testing.assert_allclose(state.angles_rad, START, atol=1e-9)
            feet = Kinematics(ROBOT).feet(START) + np.array([0.0, 0.0, 0.2])
            np.testing.assert_allclose(state.feet_m, feet, atol=1e-9)
            assert not state.forces_n.any()
            assert not world.capabilities.has_body_pose
            with refuses("torque(True)"):
                world.step(START)
        assert commands(bridge) == []
        assert {message["op"] for message in bridge.received} == {"subscribe", "advertise"}


@pytest.mark.parametrize("ros", [1, 2])
def test_streamed_targets_are_followed_with_a_lag_of_the_lead_and_no_more(
    ros: Literal[1, 2],
) -> None:
    with armed(ros, pace=1.0) as (bridge, world):  # a busy machine lags behind a faster one
        speed, begin_s = 0.5, bridge.robot.now_s
        for k in range(40):
            state = world.step(START + speed * (k + 1) / world.rate_hz)
        assert bridge.robot.now_s - begin_s > 39 / world.rate_hz  # and more, where states came late
        lag_s = (state.sent_rad - state.angles_rad) / speed
        assert np.all(lag_s > 0.03)
        assert np.all(
            lag_s < world.setup.lead_s + 3.0 / world.rate_hz + 0.04
        )  # the lead, the joints, and old news
        np.testing.assert_allclose(state.rates_rad_s, speed, atol=0.1)
        rested(bridge, world.setup.lead_s)
        assert commands(bridge) == ["stream"] * 41
        sent = [message["msg"] for message in bridge.received if message["op"] == "publish"]
        assert len(sent) == 41
        for message, (_, came_s) in zip(sent, bridge.log, strict=True):
            stamp_s = stamp_of(
                message
            )  # the robot's clock, not this machine's, and no later than it came
            assert stamp_s is None or stamp_s < came_s + EPOCH_S + 0.01
        assert sum(stamp_of(message) is not None for message in sent) > 20


def test_directions_and_offsets_are_applied_to_what_is_sent_and_what_is_measured() -> None:
    joints = {
        name: RosJoint(name=f"joint_{i}", direction=-1 if i % 2 else 1, offset_rad=0.01 * i)
        for i, name in enumerate(JOINTS)
    }
    message = np.array(
        [
            each.direction * a + each.offset_rad
            for each, a in zip(joints.values(), START, strict=True)
        ]
    )
    names = [each.name for each in joints.values()]
    with emulated(names[::-1], message[::-1].tolist()) as bridge:
        with RosWorld(ROBOT, RosSetup(port=bridge.port, joints=joints)) as world:
            np.testing.assert_allclose(reset(world).angles_rad, START, atol=1e-9)
            world.torque(True)
            for _ in range(20):
                world.step(START + 0.1)
            turned = np.array(bridge.state()["position_rad"])[::-1] - message
        np.testing.assert_allclose(
            turned, [0.1 * each.direction for each in joints.values()], atol=5e-3
        )


def test_targets_are_clipped_to_limits_and_speed_and_what_was_sent_comes_back() -> None:
    with armed() as (_, world):
        state = world.step(START + 1.0)
        np.testing.assert_allclose(state.sent_rad, START + Servo().velocity_rad_s / world.rate_hz)
        for _ in range(60):
            state = world.step(np.full(len(JOINTS), 9.0))
        np.testing.assert_allclose(state.sent_rad, world.capabilities.upper_rad)
        with refuses("24"):
            world.step(np.full(len(JOINTS), np.nan))


def wave(world: RosWorld) -> None:
    for k in range(100):
        world.step(START + 0.3 * np.sin(0.1 * k))


def handed_over(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every message that worlds hand over to their connections from now on: none is on its way
    unseen.
    """
    import roslibpy

    messages, send = list[Any](), roslibpy.Ros.send_on_ready
    monkeypatch.setattr(
        roslibpy.Ros,
        "send_on_ready",
        lambda ros, message: (messages.append(message), send(ros, message)),
    )
    return messages


def rested(bridge: RosBridge, for_s: float) -> None:
    """Wait until the robot has lived so long after the last command that came, however slow the
    machine is.
    """
    while bridge.robot.now_s < bridge.log[-1][1] + for_s:
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("connection lost", "connection"),
        ("rosbridge gone", "connection"),
        ("silent", "/joint_states"),
        ("not json", "rosbridge"),
        ("no operation", "rosbridge"),
        ("status error", "error"),
        ("null angle", "LF_yaw"),
        ("half a message", "/joint_states"),
        ("delay", "200 ms"),
        ("e-stop", "/e_stop"),
    ],
)
def test_a_fault_while_streaming_stops_the_robot_and_nothing_is_sent_afterwards(
    monkeypatch: pytest.MonkeyPatch, kind: str, name: str
) -> None:
    handed = handed_over(monkeypatch)
    with armed() as (bridge, world):
        bridge.inject(kind, 0.2)
        with refuses(name, kind=HardwareFault) as fault:
            wave(world)
        sent = len(handed)  # the last of them may still be on its way
        assert not world.armed
        with refuses("torque(True)"):
            world.step(START)
        rested(bridge, world.setup.lead_s + 0.25)
        stopped = bridge.state()
        time.sleep(0.1)
        assert len(handed) == sent
        assert len(commands(bridge)) <= sum(message["op"] == "publish" for message in handed)
        np.testing.assert_allclose(
            bridge.state()["position_rad"], stopped["position_rad"], atol=1e-4
        )
        assert ("e-stop pressed" in str(fault.value)) == (kind == "e-stop")


def test_a_host_that_falls_silent_leaves_the_robot_at_rest_after_the_lead() -> None:
    with armed(pace=1.0) as (bridge, world):
        for k in range(20):
            world.step(START + 0.5 * (k + 1) / world.rate_hz)
        time.sleep(0.3)
        assert commands(bridge) == ["stream"] * 21
        last = bridge.log[-1][1]
        np.testing.assert_allclose(
            bridge.state()["desired_rad"], START + 0.5 * 20 / world.rate_hz, atol=1e-9
        )
        assert (
            bridge.robot.path.begun_s + bridge.robot.path.times[-1]
            <= last + world.setup.lead_s + 0.02
        )


@pytest.mark.parametrize("ros", [1, 2])
def test_relax_switches_the_controller_off_and_torque_on_again(ros: Literal[1, 2]) -> None:
    with armed(ros, controller_manager="/controller_manager") as (bridge, world):
        assert bridge.state()["on"]
        world.relax()
        assert not bridge.state()["on"]
        world.torque(True)
        assert bridge.state()["on"]
    with (
        armed(ros) as (_, world),
        refuses("controller_manager", kind=HardwareFault),
    ):
        world.relax()
