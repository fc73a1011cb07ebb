"""Connections to rosbridges, several of them in a process: each has its own troubles alone."""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack

import pytest

from stancekit.runner.worlds.ros.bridge import RosLink
from tests.emulators.rosbridge import RosBridge


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
        end = time.monotonic() + 3.0
        while links[1].trouble() is None and time.monotonic() < end:
            time.sleep(0.01)
        assert f"{links[1].url}: {why}" in str(links[1].trouble())
        assert links[0].answers(3.0)  # what was sent to it before has been read, too
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
            end = time.monotonic() + 3.0
            while link.trouble() is None and time.monotonic() < end:
                time.sleep(0.01)
            assert "cannot be read (KeyError: 'nothing')" in str(link.trouble())
        finally:
            link.close()
