"""A robot behind an emulated rosbridge as a world: streaming, and every way that it can go
wrong.
"""

from __future__ import annotations

import logging
import socket
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import yaml

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.runner.worlds.ros.bridge import RosLink
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import (
    Mapping,
    RobotClock,
    RosJoint,
    RosSetup,
    same_names,
    stamp_of,
    version_of,
)
from tests.emulators.ros_robots import JOINTS, QUICK, ROBOT, START, armed, commands, emulated, reset
from tests.emulators.rosbridge import EPOCH_S, FAULTS, RosBridge
from tests.refusals import refuses


def test_reset_measures_and_sends_nothing_that_could_move_the_robot() -> None:
    with emulated(other=["gripper"]) as bridge:
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
            state = reset(world)
            np.testing.assert_allclose(state.angles_rad, START, atol=1e-9)
            feet = Kinematics(ROBOT).feet(START) + np.array([0.0, 0.0, 0.2])
            np.testing.assert_allclose(state.feet_m, feet, atol=1e-9)
            assert not state.forces_n.any()
            assert not world.senses
            with refuses("arm"):
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
            world.arm()
            for _ in range(20):
                world.step(START + 0.1)
            turned = np.array(bridge.state()["position_rad"])[::-1] - message
        np.testing.assert_allclose(
            turned, [0.1 * each.direction for each in joints.values()], atol=5e-3
        )


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
        with refuses("arm"):
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


def test_what_is_queued_while_a_rosbridge_is_away_does_not_go_out_on_its_return() -> None:
    with armed() as (bridge, world):
        bridge.inject("connection lost", 0.1)
        with refuses("connection", kind=HardwareFault):
            wave(world)
        link, heard = world._robot.link, len(bridge.log)
        goal = link._module.Message({"op": "publish", "topic": "/goal", "msg": {}})
        link.publish("/goal", "std_msgs/String", {"data": "late"})
        link.ros.send_on_ready(goal)  # what roslibpy keeps until it is connected again
        rested(bridge, 1.0)
        assert (len(bridge.log), bridge._clients) == (heard, [])


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
        world.stop(torque_off=True)
        assert not bridge.state()["on"]
        world.arm()
        assert bridge.state()["on"]
    with (
        armed(ros) as (_, world),
        refuses("controller_manager", kind=HardwareFault),
    ):
        world.stop(torque_off=True)


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("not json", "expected a rosbridge message, got one that cannot be read (JSONDecodeError"),
        (
            "no operation",
            "expected a rosbridge message, got one that cannot be read (KeyError: 'op')",
        ),
        ("status error", "it reported an error of its own: type of topic differs"),
        ("connection lost", "the connection is lost"),
    ],
)
def test_a_connection_is_not_blamed_for_another_one(kind: str, why: str) -> None:
    with RosBridge(["a"]) as wrong, RosBridge(["a"]) as sound, ExitStack() as stack:
        links = [RosLink("127.0.0.1", bridge.port, 3.0) for bridge in (sound, wrong, sound)]
        for link in links:
            link.open()
            stack.callback(link.close)
        wrong.inject(kind)
        end = time.monotonic() + 60.0
        while links[1].trouble() is None and time.monotonic() < end:
            time.sleep(0.01)
        assert f"{links[1].url}: {why}" in str(links[1].trouble())
        assert links[0].answers(60.0)  # what was sent to it before has been read, too
        assert [link.trouble() for link in links[::2]] == [None, None]


def test_what_others_log_is_nobodys_trouble() -> None:
    with RosBridge(["a"]) as bridge:
        link = RosLink("127.0.0.1", bridge.port, 3.0)
        link.open()
        try:
            logging.getLogger("roslibpy").error("Failed to send message, of another connection")
            assert link.trouble() is None
        finally:
            link.close()


def test_a_callback_that_fails_is_a_trouble_of_its_connection() -> None:
    with RosBridge(["a"]) as bridge:
        link = RosLink("127.0.0.1", bridge.port, 3.0)
        link.open()
        try:
            link.subscribe(
                "/joint_states", "sensor_msgs/msg/JointState", lambda message: message["nothing"]
            )
            end = time.monotonic() + 60.0
            while link.trouble() is None and time.monotonic() < end:
                time.sleep(0.01)
            assert "cannot be read (KeyError: 'nothing')" in str(link.trouble())
        finally:
            link.close()


@pytest.mark.parametrize(
    "kind", ["silent", "not json", "no operation", "null angle", "half a message", "e-stop"]
)
def test_nonsense_and_silence_are_refused_in_one_line_before_any_motion(kind: str) -> None:
    assert kind in FAULTS
    with emulated() as bridge:
        bridge.inject(kind)
        time.sleep(0.05)
        patience = {"timeout_s": 0.5} if kind == "silent" else {}
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK | patience)) as world:
            with pytest.raises(InvalidInput) as refused:
                reset(world)
            assert "\n" not in str(refused.value)
        assert commands(bridge) == []


def refused(setup: RosSetup) -> str:
    """What the world says of a robot that it cannot drive."""
    with RosWorld(ROBOT, setup) as world, pytest.raises(InvalidInput) as error:
        reset(world)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_joints_that_do_not_match_are_named() -> None:
    names = ["LF_jaw" if name == "LF_yaw" else name for name in JOINTS]
    with emulated(names, START) as bridge:
        said = refused(same_names(JOINTS, port=bridge.port, **QUICK))
        assert said.endswith(
            "/joint_states: expected all joints, nothing of LF_yaw; other names there: LF_jaw"
        )
    with emulated(JOINTS[:-1], START[:-1], other=JOINTS[-1:]) as bridge:
        said = refused(same_names(JOINTS, port=bridge.port, **QUICK))
        assert said.endswith(
            f"controller: expected the joints of the setup, they differ in {JOINTS[-1]}"
        )


def test_a_controller_that_is_not_there_and_angles_beyond_limits_are_refused() -> None:
    with emulated() as bridge:
        said = refused(same_names(JOINTS, port=bridge.port, controller="/other", **QUICK))
        assert said.endswith("expected the state of /other, heard nothing: is it running?")
    with emulated(JOINTS, START + 2.0) as bridge:
        said = refused(same_names(JOINTS, port=bridge.port, **QUICK))
        expected = "LF_yaw: expected an angle in [-1.90, 1.90] rad, measured 2.00: is its name or offset right?"
        assert said == expected


def test_a_rosbridge_that_is_absent_or_no_websocket_is_refused_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        said = refused(same_names(JOINTS, port=port, timeout_s=0.5))
        assert said.startswith(f"rosbridge ws://127.0.0.1:{port}: expected a rosbridge, ")
        assert said.endswith("what answers there does not speak WebSocket")
    assert "expected a rosbridge, got no answer: " in refused(
        same_names(JOINTS, port=port, **QUICK)
    )


NAMES = ("LF_yaw", "LF_hip")


def written(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "robot.yaml"
    same_names(NAMES, estop="/e_stop").write(path)
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | changes, sort_keys=False))
    return path


def test_angles_go_to_ros_by_direction_and_offset_and_come_back() -> None:
    joints = {
        "LF_hip": RosJoint(name="b"),
        "LF_yaw": RosJoint(name="a", direction=-1, offset_rad=0.5),
    }
    mapping = Mapping(RosSetup(joints=joints), NAMES)
    assert mapping.names == ("a", "b")
    angles = np.array([[0.2, 0.3], [-1.0, 0.0]])
    np.testing.assert_allclose(mapping.told(angles), [[0.3, 0.3], [1.5, 0.0]])
    np.testing.assert_allclose(mapping.angles(mapping.told(angles)), angles)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"format": "stancekit/servos/1"},
            "format: expected stancekit/ros/1, got 'stancekit/servos/1'",
        ),
        ({"rso": 2}, "rso: unknown key"),
        ({"ros": 3}, "ros: expected 1 or 2, got 3"),
        ({"controller": "no slash"}, "controller: String should match"),
        ({"joints": {"LF_yaw": {"name": "a"}}}, "joints: expected joint LF_hip, got nothing"),
        ({"joints": {j: {"name": j} for j in (*NAMES, "RF_yaw")}}, "joints: unknown joint RF_yaw"),
        (
            {"joints": {j: {"name": "a"} for j in NAMES}},
            "joints.LF_hip.name: expected a name of its own, got a, which LF_yaw has",
        ),
        (
            {"joints": {"LF_yaw": {"name": "a", "direction": 2}, "LF_hip": {"name": "b"}}},
            "joints.LF_yaw.direction: expected -1 or 1, got 2",
        ),
    ],
)
def test_a_file_that_says_something_wrong_is_refused_with_its_place(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(InvalidInput) as refused:
        RosSetup.from_yaml(path, NAMES)
    assert str(refused.value).startswith(f"{path}: {message}")
    assert "\n" not in str(refused.value)


def test_a_file_that_is_no_yaml_or_no_object_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    for text in ("a: [", "- 1"):
        path.write_text(text)
        with refuses(path):
            RosSetup.from_yaml(path)


PERIOD_S = 0.02
OFF_S = 1.7e9


def heard(
    delays_s: list[float], rate: float = 1.0, off_s: float = OFF_S
) -> tuple[RobotClock, list[float]]:
    """A clock, and when each of its messages was measured by ours; sent every period, and so long
    on the way.
    """
    clock = RobotClock()
    return clock, [
        clock.take(off_s + rate * k * PERIOD_S, k * PERIOD_S + delay_s)
        for k, delay_s in enumerate(delays_s)
    ]


def test_a_late_message_counts_as_measured_when_it_was() -> None:
    clock, measured = heard([0.004] * 20 + [0.5, 0.3])
    assert measured[-2:] == pytest.approx([20 * PERIOD_S + 0.004, 21 * PERIOD_S + 0.004])
    assert clock.at(1.0) == pytest.approx(OFF_S + 1.0 - 0.004)


@pytest.mark.parametrize("off_s", [OFF_S, OFF_S - 2.0, 12.5])
def test_a_clock_that_is_off_is_as_good_as_any(off_s: float) -> None:
    clock, measured = heard([0.003] * 30, off_s=off_s)
    assert clock.at(0.5) == pytest.approx(off_s + 0.497)
    assert measured == pytest.approx([k * PERIOD_S + 0.003 for k in range(30)])


@pytest.mark.parametrize("rate", [0.5, 0.9, 2.0])
def test_no_time_is_told_by_a_simulation_that_goes_at_another_speed(rate: float) -> None:
    clock, measured = heard([0.003] * 100, rate=rate)
    assert clock.at(2.0) is None
    assert measured[-1] == pytest.approx(99 * PERIOD_S + 0.003)


def test_nor_by_stamps_of_0_nor_by_few() -> None:
    clock = RobotClock()
    assert [clock.take(None, 0.1 * k) for k in range(9)] == pytest.approx(
        [0.1 * k for k in range(9)]
    )
    assert clock.at(1.0) is None
    assert heard([0.0] * 4)[0].at(1.0) is None


def test_the_period_is_the_median_of_what_came() -> None:
    clock, _ = heard([0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    assert clock.period_s() == pytest.approx(PERIOD_S)
    assert RobotClock().period_s() == 0.0


@pytest.mark.parametrize(
    ("message", "stamp", "version"),
    [
        ({"header": {"stamp": {"secs": 3, "nsecs": 500_000_000}}}, 3.5, 1),
        ({"header": {"stamp": {"sec": 3, "nanosec": 250_000_000}}}, 3.25, 2),
        ({"header": {"stamp": {"secs": 0, "nsecs": 0}}}, None, 1),
        ({"header": {"stamp": {"secs": "3", "nsecs": True}}}, None, 1),
        ({"header": 3}, None, None),
        ([], None, None),
    ],
)
def test_stamps_are_read_as_both_ros_write_them(
    message: object, stamp: float | None, version: int | None
) -> None:
    assert (stamp_of(message), version_of(message)) == (stamp, version)


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
        world.arm()
        assert bridge.state()["now_s"] - begin_s > 2.5
        np.testing.assert_allclose(bridge.state()["position_rad"], START, atol=2e-6)
        for k in range(40):
            state = world.step(START + 0.4 * (k + 1) / world.rate_hz)
            assert np.abs(bridge.robot.rate).max() < 0.6  # and it follows from the first of them on
        np.testing.assert_allclose(state.angles_rad, START + 0.32, atol=0.1)


def test_a_topic_that_a_robot_missed_is_advertised_anew() -> None:
    with ExitStack() as stack:
        bridge, world = made(stack, 1, misses=True, rate_hz=50.0)
        world.arm()
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
        bridge, world = made(stack, ros, connect_s=60.0, rate_hz=50.0)
        topic = f"/joint_trajectory_controller/{'joint_trajectory' if ros == 2 else 'command'}"
        with refuses(topic):
            world.arm()
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
