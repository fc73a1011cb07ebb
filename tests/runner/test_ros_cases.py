"""What went wrong behind a real ROS, on an emulator that is as unkind: each case with what is
right.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.runner.safety.estop import Stopped
from stancekit.runner.worlds.ros import joint_states
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import (
    FOREIGN,
    ControllerState,
    JointStates,
    Mapping,
    same_names,
)
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
        pending = world.stop()
        held, void = bridge.state()["position_rad"], "out of date by its stamps" in pending
        assert void or "may still move it" in pending
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
        world.arm()
        bridge.inject("frozen", 0.5)
        with refuses(kind=HardwareFault):
            stream(world)
        assert "have no stamps, and may still move it" in world.stop()


def test_after_a_stop_of_a_robot_that_is_heard_nothing_is_pending() -> None:
    with armed(1) as (bridge, world):
        stream(world, 20)
        assert world.stop() == ""
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
        world.arm()
        assert world.report() == why


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
            world.arm()
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
        world.arm()
        assert world.report() == "e-stop /e_stop: pressed and released"
        stream(world, 3)


def test_wheels_without_positions_are_left_alone() -> None:
    with armed(1) as (bridge, world):
        bridge.inject("wheels")
        stream(world, 40)
        assert world.armed


@pytest.mark.parametrize("ros", [1, 2])
def test_after_torque_off_a_run_starts_again(ros: Ros) -> None:
    with armed(ros, **MANAGED) as (bridge, world):
        world.stop(torque_off=True)
        assert not bridge.robot.on
        with world_of(bridge, **MANAGED) as again:
            reset(again)
            again.arm()
            again.step(START)
            assert bridge.robot.on
        with world_of(bridge) as other:
            world.stop(torque_off=True)
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
        world.arm()
        stream(world, 25)
        assert world.armed


QUICK_MANAGED = QUICK | {"controller_manager": "/controller_manager"}


def stop_after(world: RosWorld, what: str) -> None:
    """Trip the latch as soon as this was sent."""
    if what == "nothing":
        world.latch.trip("button")
        return
    verb = getattr(world._robot, what)

    def done(*arguments: Any) -> None:
        verb(*arguments)
        world.latch.trip("button")

    setattr(world._robot, what, done)


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize(
    ("after", "sent"),
    [("nothing", []), ("switch", ["switch", "switch"]), ("stream", ["switch", "stream", "switch"])],
)
def test_a_stop_at_any_step_of_an_arming_leaves_the_controller_off(
    ros: Literal[1, 2], after: str, sent: list[str]
) -> None:
    with emulated(ros=ros) as bridge:
        with RosWorld(
            ROBOT, same_names(JOINTS, port=bridge.port, ros=ros, **QUICK_MANAGED)
        ) as world:
            reset(world)
            bridge.robot.on = False
            stop_after(world, after)
            with refuses("button", kind=Stopped):
                world.arm()
            assert not world.armed
            world.stop()
        time.sleep(0.05)
        assert commands(bridge) == sent
        assert not bridge.state()["on"]


def test_a_controller_that_was_not_switched_by_us_is_left_alone() -> None:
    with emulated() as bridge:
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
            reset(world)
            stop_after(world, "stream")
            with pytest.raises(Stopped):
                world.arm()
            time.sleep(0.05)
        assert commands(bridge) == ["stream"]
        assert bridge.state()["on"]


@pytest.mark.parametrize("ros", [1, 2])
def test_after_a_stop_no_target_is_sent(ros: Literal[1, 2]) -> None:
    with armed(ros) as (bridge, world):
        world.step(START)
        world.latch.trip("button")
        before = commands(bridge)
        with refuses("button", kind=Stopped):
            world.step(START + 0.01)
        time.sleep(0.05)
        assert commands(bridge) == before == ["stream", "stream"]


def standstill(world: RosWorld, monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Let the thread that writes stand still from the next hand-over on, until this is set."""
    link, goes_on = world._robot.link, threading.Event()
    through = link.through

    def busy(*arguments: Any) -> Any:
        link.ros.factory.manager.loop.call_soon_threadsafe(goes_on.wait)
        return through(*arguments)

    monkeypatch.setattr(link, "through", busy)
    return goes_on


def test_a_stop_that_comes_while_a_target_waits_for_the_writing_thread_keeps_it_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with armed() as (bridge, world):
        goes_on = standstill(world, monkeypatch)

        def stop() -> None:
            world.latch.trip("button")
            goes_on.set()

        threading.Timer(0.1, stop).start()
        with refuses("button", kind=Stopped):
            world.step(START + 0.01)
        assert world._robot.link.answers(10.0)  # whatever was written before has come
        assert commands(bridge) == ["stream"]


def test_a_target_that_cannot_be_written_in_time_is_never_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with armed() as (bridge, world):
        goes_on = standstill(world, monkeypatch)
        world._robot.link.timeout_s = 0.3
        with refuses("0.3 s", kind=HardwareFault):
            world.step(START + 0.01)
        goes_on.set()
        assert world._robot.link.answers(10.0)  # whatever was written before has come
        assert commands(bridge) == ["stream"]


LEG = ("hip", "knee")
FASTEST = np.array([4.0, 4.0])


class Clock:
    """In place of the module ``time``."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(joint_states, "time", made)
    return made


@pytest.fixture
def states(clock: Clock) -> JointStates:
    return JointStates(Mapping(same_names(LEG), LEG), LEG, FASTEST)


@pytest.fixture
def known(states: JointStates) -> ControllerState:
    return ControllerState(Mapping(same_names(LEG), LEG), LEG, states)


def message(hip: float, knee: float, at_s: float = 0.0) -> dict[str, Any]:
    stamp = {"sec": int(at_s), "nanosec": round(1e9 * (at_s - int(at_s)))}
    return {
        "header": {"stamp": stamp},
        "name": list(LEG),
        "position": [hip, knee],
        "velocity": [0.0, 0.0],
    }


def state(actual: list[float], desired: list[float], at_s: float) -> dict[str, Any]:
    points = {
        "actual": {"positions": actual, "velocities": [0.0, 0.0]},
        "desired": {"positions": desired},
    }
    return {"header": message(0.0, 0.0, at_s)["header"], "joint_names": list(LEG)} | points


@pytest.mark.parametrize("stamped", [True, False])
def test_a_joint_that_jumps_is_refused_by_name_and_what_was_measured_stays(
    states: JointStates, clock: Clock, stamped: bool
) -> None:
    for _ in range(10):
        clock.now += 0.02
        states.take(message(0.1, 1.6, clock.now if stamped else 0.0))
    clock.now += 0.01
    with refuses("knee"):
        states.take(message(0.0, 0.0, clock.now if stamped else 0.0))
    np.testing.assert_allclose(states.read()[0], [0.1, 1.6])


@pytest.mark.parametrize("stamped", [True, False])
def test_a_joint_at_its_greatest_speed_is_believed_also_when_messages_come_in_bursts(
    states: JointStates, clock: Clock, stamped: bool
) -> None:
    for k in range(100):
        sent_s = 100.0 + 0.01 * k
        clock.now = (
            100.0 + 0.05 * np.ceil(0.2 * k) + 1e-4 * (k % 5)
        )  # five at once, as a busy machine gives them
        states.take(message(4.0 * 0.01 * k, -4.0 * 0.01 * k, sent_s if stamped else 0.0))
    assert states.read()[0][0] == pytest.approx(3.96)


def test_joints_that_are_not_the_robots_may_have_no_positions_and_are_left_alone(
    states: JointStates,
) -> None:
    states.take({"name": ["left_wheel", "right_wheel"], "velocity": [1.0, 1.0]})
    states.take({"name": ["finger"], "position": [None]})
    assert states.others == {"left_wheel", "right_wheel", "finger"}
    with refuses():
        states.take({"name": ["hip", "wheel"], "velocity": [1.0, 1.0]})


def test_two_measurements_of_a_joint_that_differ_are_two_publishers_also_when_every_third_is_right(
    states: JointStates, clock: Clock, known: ControllerState
) -> None:
    for k in range(60):
        clock.now += 0.02
        states.take(message(0.1, 1.6 if k % 3 == 0 else 1.75, clock.now))
        known.take(state([0.1, 1.6], [0.1, 1.6], clock.now))
    assert known.trouble() == (
        "knee: joint states say 1.750 rad, while its controller measures 1.600: two publishers?"
    )


def test_measurements_of_moving_joints_may_differ_by_what_they_turn_in_between(
    states: JointStates, clock: Clock, known: ControllerState
) -> None:
    for k in range(100):
        clock.now += 0.02
        if k % 5 == 0:  # ten times a second
            said = message(0.02 * k, 0.0, clock.now) | {"velocity": [1.0, 0.0]}
            states.take(said)
        moving = state([0.02 * k, 0.0], [0.02 * k, 0.0], clock.now)
        moving["actual"]["velocities"] = [1.0, None]
        known.take(moving)
        assert known.trouble() is None


def test_a_controller_that_wants_what_nobody_sent_follows_somebody_else(
    states: JointStates, clock: Clock, known: ControllerState
) -> None:
    known.take(state([0.0, 0.0], [0.0, 0.0], clock.now))
    for k in range(100):
        clock.now += 0.02
        known.sent(np.array([0.01 * k, 0.0]))
        known.take(state([0.01 * k, 0.0], [0.01 * max(k - 4, 0), 0.0], clock.now))
        assert known.trouble() is None
    for _ in range(FOREIGN):
        clock.now += 0.02
        known.take(state([1.0, 0.0], [1.0, 0.2], clock.now))
    assert (
        known.trouble()
        == "knee: the controller wants 0.200 rad, which was not sent: another client?"
    )


def test_a_controller_that_moves_joints_is_busy(
    states: JointStates, known: ControllerState
) -> None:
    still = state([0.0, 0.0], [0.0, 0.0], 100.0)
    known.take(still)
    assert known.busy() is None
    still["desired"]["velocities"] = [0.0, 0.3]
    known.take(still)
    assert known.busy() == "knee: the controller turns it by 0.30 rad/s: another client?"


@pytest.mark.parametrize("names", [("reference", "feedback"), ("desired", "actual")])
def test_states_of_every_version_are_understood(
    states: JointStates, names: tuple[str, str], known: ControllerState
) -> None:
    points = {
        names[0]: {"positions": [0.0, 0.0], "velocities": [0.0, 1.0]},
        names[1]: {"positions": []},
    }
    known.take({"joint_names": list(LEG)} | points)
    assert known.names == LEG
    assert known.busy() is not None
