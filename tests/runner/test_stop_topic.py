"""The e-stop on a ROS topic: pressed, lost, nonsense, and in the way of a run on another world."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from stancekit.runner.safety.estop import watched
from stancekit.runner.safety.latch import StopLatch
from stancekit.runner.safety.stop_topic import StopTopic
from tests.emulators.rosbridge import RosBridge
from tests.refusals import refuses


@pytest.fixture
def bridge() -> Iterator[RosBridge]:
    with RosBridge(["a"]) as made:
        yield made


def reason(topic: StopTopic, within_s: float = 3.0) -> str:
    """Why the topic stops, as a latch that polls it has it."""
    latch, end = StopLatch(), time.monotonic() + within_s
    latch.listen(topic)
    with watched(latch):
        while not latch.tripped and time.monotonic() < end:
            time.sleep(0.005)
    return latch.reason


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("e-stop", "e-stop pressed on /e_stop"),
        ("connection lost", "the connection is lost"),
        ("rosbridge gone", "the connection is lost"),
        ("not json", "expected a rosbridge message, got one that cannot be read"),
    ],
)
def test_a_button_that_is_pressed_or_cannot_be_read_stops(
    bridge: RosBridge, kind: str, why: str
) -> None:
    with StopTopic(f"127.0.0.1:{bridge.port}/e_stop") as topic:
        time.sleep(0.1)
        assert topic() is None
        bridge.inject(kind)
        assert why in reason(topic)


def test_a_message_that_is_no_truth_value_stops(bridge: RosBridge) -> None:
    with StopTopic(f"127.0.0.1:{bridge.port}/joint_states") as topic:
        assert "/joint_states: expected data to be true or false, got None" in reason(topic)


@pytest.mark.parametrize(
    "address", ["e_stop", "localhost/e_stop", "localhost:99999/e_stop", "localhost:9090"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with refuses("stop_topic"):
        StopTopic(address)


def test_where_no_rosbridge_is_nothing_begins(bridge: RosBridge) -> None:
    port = bridge.port
    bridge.close()
    with (
        refuses(),
        StopTopic(f"127.0.0.1:{port}/x"),
    ):
        pass
