"""The emulated rosbridge by the public rosbridge v2 protocol, over a plain websocket, without the
client under test.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from tests.emulators.rosbridge import RosBridge
from tests.emulators.rosbridge_protocol import operation_wrong
from tests.emulators.trajectory_controller import Controller

NAMES = ["a", "b"]


@pytest.fixture
def bridge() -> Iterator[RosBridge]:
    with RosBridge(NAMES) as made:
        yield made


def heard(
    socket: ClientConnection, wanted: Callable[[dict[str, Any]], bool], within_s: float = 60.0
) -> dict[str, Any]:
    end = time.monotonic() + within_s
    while True:
        message = json.loads(socket.recv(timeout=max(end - time.monotonic(), 0.0)))
        if wanted(message):
            return dict(message)


def test_a_subscriber_gets_publish_operations_with_topic_and_msg(bridge: RosBridge) -> None:
    with connect(f"ws://127.0.0.1:{bridge.port}") as socket:
        socket.send(
            json.dumps(
                {"op": "subscribe", "topic": "/joint_states", "type": "sensor_msgs/msg/JointState"}
            )
        )
        message = heard(socket, lambda said: True)
        assert set(message) == {"op", "topic", "msg"}
        assert (message["op"], message["topic"]) == ("publish", "/joint_states")
        assert message["msg"]["name"] == NAMES
        assert len(message["msg"]["position"]) == 2
        socket.send(json.dumps({"op": "unsubscribe", "topic": "/joint_states"}))
        socket.send("{")  # answered after all that was on its way
        heard(socket, lambda said: said["op"] == "status")
        with pytest.raises(TimeoutError):
            socket.recv(timeout=0.1)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "not JSON"),
        ("[]", "no op"),
        ('{"id": "x"}', "no op"),
        ('{"op": "dance"}', "unknown op dance"),
        ('{"op": "subscribe"}', "subscribe: topic is missing"),
        ('{"op": "publish", "topic": 3, "msg": {}}', "publish: topic is int"),
        (
            '{"op": "publish", "topic": "/joint_trajectory_controller/joint_trajectory", "msg": {"joints": []}}',
            "JointTrajectory: no field joints",
        ),
    ],
)
def test_what_is_against_the_protocol_is_answered_with_a_status_message(
    bridge: RosBridge, text: str, why: str
) -> None:
    with connect(f"ws://127.0.0.1:{bridge.port}") as socket:
        socket.send(text)
        status = heard(socket, lambda said: said["op"] == "status")
    assert (status["level"], status["msg"]) == ("error", why)
    assert bridge.errors == [why]


def test_the_examples_of_the_protocol_are_accepted() -> None:
    for example in (
        {
            "op": "subscribe",
            "topic": "/cmd_vel",
            "type": "geometry_msgs/msg/Twist",
            "throttle_rate": 0,
            "queue_length": 0,
        },
        {"op": "publish", "id": "fred", "topic": "/cmd_vel", "msg": {"linear": {"x": 0.0}}},
        {"op": "advertise", "id": 3, "topic": "/cmd_vel", "type": "geometry_msgs/msg/Twist"},
        {"op": "call_service", "service": "/add_two_ints", "args": [{"a": 1}], "timeout": 2.5},
    ):
        assert operation_wrong(example) is None


def test_a_trajectory_with_velocities_is_the_cubic_through_its_points_and_one_without_is_straight() -> (
    None
):
    robot = Controller(["a"], np.zeros(1))
    point = {"positions": [1.0], "velocities": [0.0], "time_from_start": {"sec": 1, "nanosec": 0}}
    robot.load({"joint_names": ["a"], "points": [point]}, "nanosec")
    times = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(
        [robot.path.at(t)[0][0] for t in times], 3 * times**2 - 2 * times**3, atol=1e-12
    )
    h = 1e-6
    for t in (0.2, 0.7):
        slope = (robot.path.at(t + h)[0] - robot.path.at(t - h)[0]) / (2 * h)
        np.testing.assert_allclose(robot.path.at(t)[1], slope, atol=1e-6)
    del point["velocities"]
    robot.load({"joint_names": ["a"], "points": [point]}, "nanosec")
    np.testing.assert_allclose([robot.path.at(t)[0][0] for t in times], times, atol=1e-12)


def test_what_is_due_happens_in_the_order_of_its_times_and_a_failure_of_it_is_kept() -> None:
    happened = list[str]()

    def failing() -> None:
        happened.append("fails")
        raise KeyError("g1")

    with RosBridge(["a"]) as bridge:
        with bridge._lock:
            bridge._later(0.02, happened.append, "last")
            bridge._later(0.01, failing)
            bridge._later(0.0, happened.append, "first")
            time.sleep(0.05)
        begin_s = bridge.robot.now_s
        end = time.monotonic() + 60.0
        while bridge.robot.now_s < begin_s + 0.02 and time.monotonic() < end:
            time.sleep(0.01)
        assert happened == ["first", "fails", "last"]
        assert bridge.errors == ["KeyError: 'g1'"]
        assert bridge.robot.now_s >= begin_s + 0.02
