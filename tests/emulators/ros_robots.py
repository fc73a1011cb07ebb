"""An emulated robot behind a rosbridge, and the world that drives it, for the tests of both."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
import pytest
from roslibpy.comm import comm_asyncio

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import hexapod
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import same_names
from stancekit.runner.worlds.world import State
from tests.emulators import rosbridge, rosbridge_protocol
from tests.emulators.rosbridge import RosBridge

from .fast_time import PACE, FastTime, on_robot_time

ROBOT = hexapod()
JOINTS = ROBOT.joint_names
START = np.tile([0.0, 0.3, 0.0, 1.2], len(ROBOT.limbs))
QUICK: dict[str, Any] = {"timeout_s": 1.5, "estop": "/e_stop"}


def reset(world: RosWorld) -> State:
    return world.connect((), START, np.array([0.0, 0.0, 0.2]), np.eye(3))


def commands(bridge: RosBridge) -> list[str]:
    """What came, in time or, from a busy machine, late."""
    return [what.removeprefix("late ") for what, _ in bridge.log if not what.startswith("fault")]


@contextlib.contextmanager
def heard() -> Iterator[None]:
    """Let the connections of this process count what they hear meanwhile."""
    protocol = comm_asyncio.AsyncioRosBridgeProtocol

    class Counting(protocol):  # type: ignore[misc, valid-type]  # roslibpy has no types
        """Counts, then hears."""

        def onMessage(self, payload: bytes, isBinary: bool) -> None:
            port = self.transport.get_extra_info("sockname")[1]
            rosbridge_protocol.HEARD[port] = rosbridge_protocol.HEARD.get(port, 0) + 1
            super().onMessage(payload, isBinary)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(comm_asyncio.AsyncioRosBridgeClientFactory, "protocol", Counting)
        yield


@contextlib.contextmanager
def emulated(
    names: Sequence[str] = JOINTS,
    position_rad: Array = START,
    *,
    pace: float = PACE,
    **settings: Any,
) -> Iterator[RosBridge]:
    """An emulated robot on a fast clock, by whose own clock the host lives."""
    clock = FastTime(pace)
    with pytest.MonkeyPatch.context() as patched:
        for module in (rosbridge, rosbridge_protocol):
            patched.setattr(module, "time", clock)
        with (
            heard(),
            RosBridge(names, position_rad, **settings) as bridge,
            on_robot_time("ros", lambda: bridge.robot.now_s),
        ):
            yield bridge


@contextlib.contextmanager
def armed(
    ros: Literal[1, 2] = 2, *, pace: float = PACE, **settings: Any
) -> Iterator[tuple[RosBridge, RosWorld]]:
    """An emulated robot, and the world that drives it, armed; at the end no message was against the
    protocol.
    """
    with emulated(ros=ros, pace=pace) as bridge:
        with RosWorld(
            ROBOT, same_names(JOINTS, port=bridge.port, ros=ros, **(QUICK | settings))
        ) as world:
            reset(world)
            world.arm()
            yield bridge, world
        assert bridge.errors == []
