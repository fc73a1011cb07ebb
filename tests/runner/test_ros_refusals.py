"""What is refused of a robot behind an emulated rosbridge before any motion, in one line."""

from __future__ import annotations

import socket
import time

import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import RosSetup, same_names
from tests.emulators.ros_robots import JOINTS, QUICK, ROBOT, START, commands, emulated, reset
from tests.emulators.rosbridge import FAULTS


@pytest.mark.parametrize(
    "kind", ["silent", "not json", "no operation", "null angle", "half a message", "e-stop"]
)
def test_nonsense_and_silence_are_refused_in_one_line_before_any_motion(kind: str) -> None:
    assert kind in FAULTS
    with emulated() as bridge:
        bridge.inject(kind)
        time.sleep(0.05)
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
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
        said = refused(same_names(JOINTS, port=port, **QUICK))
        assert said.startswith(f"rosbridge ws://127.0.0.1:{port}: expected a rosbridge, ")
        assert said.endswith("what answers there does not speak WebSocket")
    assert "expected a rosbridge, got no answer: " in refused(
        same_names(JOINTS, port=port, **QUICK)
    )
