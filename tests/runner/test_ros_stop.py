"""A stop of a robot behind a rosbridge: asked by the thread that writes, and at every step of an
arming.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Literal

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.runner.safety.latch import Stopped
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import same_names
from tests.emulators.fast_time import PACE
from tests.emulators.ros_robots import (
    JOINTS,
    QUICK,
    ROBOT,
    START,
    armed,
    commands,
    emulated,
    reset,
)
from tests.refusals import refuses

MANAGED = QUICK | {"controller_manager": "/controller_manager"}


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
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, ros=ros, **MANAGED)) as world:
            reset(world)
            bridge.robot.on = False
            stop_after(world, after)
            with refuses("button", kind=Stopped):
                world.torque(True)
            assert not world.armed
            world.hold()
        time.sleep(0.05)
        assert commands(bridge) == sent
        assert not bridge.state()["on"]


def test_a_controller_that_was_not_switched_by_us_is_left_alone() -> None:
    with emulated() as bridge:
        with RosWorld(ROBOT, same_names(JOINTS, port=bridge.port, **QUICK)) as world:
            reset(world)
            stop_after(world, "stream")
            with pytest.raises(Stopped):
                world.torque(True)
            time.sleep(0.05)
        assert commands(bridge) == ["stream"]
        assert bridge.state()["on"]


@pytest.mark.parametrize("ros", [1, 2])
def test_after_a_stop_no_target_and_no_goal_is_sent(ros: Literal[1, 2]) -> None:
    with armed(ros) as (bridge, world):
        world.step(START)
        world.latch.trip("button")
        before = commands(bridge)
        with refuses("button", kind=Stopped):
            world.step(START + 0.01)
        with refuses("button", kind=Stopped):
            world.run_trajectory(np.array([0.5]), START[None, :] + 0.1)
        time.sleep(0.05)
        assert commands(bridge) == before == ["stream", "stream"]


def test_a_trajectory_on_its_way_is_cancelled_by_a_stop() -> None:
    with armed() as (bridge, world):
        timer = threading.Timer(0.5 / PACE, world.latch.trip, ("button",))
        timer.start()
        with refuses("button", kind=HardwareFault):
            world.run_trajectory(np.array([3.0]), START[None, :] + 0.5)
        assert bridge.state()["goals"] == 0


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
