"""A stop at the worst moments: between asking and sending, at every packet of an arming, in the
ending itself.
"""

from __future__ import annotations

import errno
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dynamixel_sdk import PortHandler

from stancekit import Motion
from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.robot import hexapod
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.tracker import Tracker
from stancekit.runner.motion.time_parametrization import BLIND
from stancekit.runner.prepared import Prepared
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.safety.estop import SIGNALS, Stopped
from stancekit.runner.safety.guard import SafeWorld, end
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators.memory_world import PATIENT, MemoryWorld
from tests.emulators.servo_bus import EmulatedBus
from tests.refusals import assert_names, refuses

ROBOT = hexapod()
START = np.tile([0.2, 0.5, -0.3, 1.0], 6)
FAST = RunSettings(timing=Timing().at_pace(2.0), limits=PATIENT)
ENDINGS = [("hold", "held", True), ("torque-off", "torque off", False)]


def calibrated(bus: EmulatedBus) -> Calibration:
    return replace(nominal(ROBOT, port=bus.path, watchdog_s=1.0), latency_ms=40.0)


@pytest.fixture(scope="module")
def bus() -> Iterator[EmulatedBus]:
    with EmulatedBus(range(1, 25), START.tolist(), wire=False) as made:
        yield made


def measured(bus: EmulatedBus) -> DynamixelWorld:
    """A world of its own on the bus, its torque off."""
    world = DynamixelWorld(ROBOT, calibrated(bus))
    world.connect((), START, np.zeros(3), np.eye(3))
    world.stop(torque_off=True)
    return world


class Writes:
    """Acts at the k-th write to the port: before the latch is asked, or after that and before the
    write.
    """

    def __init__(
        self, patch: pytest.MonkeyPatch, act: Callable[[], None] = lambda: None, at: int = -1
    ) -> None:
        self.count = 0
        before = PortHandler.writePort

        def write(port: Any, packet: list[int]) -> int:
            if self.count == at:
                act()
            self.count += 1
            return int(before(port, packet))

        patch.setattr(
            PortHandler, "writePort", write
        )  # below ServoPort's: what it lets through comes here


def test_a_stop_at_any_packet_of_an_arming_leaves_every_torque_off_and_nothing_follows(
    bus: EmulatedBus,
) -> None:
    for at in range(200):
        with pytest.MonkeyPatch.context() as patch, measured(bus) as world:
            writes = Writes(patch, lambda world=world: world.latch.trip("button"), at)  # type: ignore[misc]
            try:
                world.arm()
            except Stopped:
                assert "button" in world.latch.reason
            else:  # over before its stop: a late answer is read twice, so that arming's packets vary
                assert writes.count <= at
                assert at >= 10
                world.stop(torque_off=True)
                return
            assert not world.armed
            assert world.latch.after <= 1
            assert not any(bus.state()["torque"]), f"packet {at}"
            seen = (
                len(bus.goal_packets_s),
                len(bus.torque_packets_s),
            )  # all: the answer to a reading came after them
            with pytest.raises(Stopped):
                world.arm()
            world.stop(torque_off=True)
            assert seen == (len(bus.goal_packets_s), len(bus.torque_packets_s))
    pytest.fail("an arming of 200 packets")


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, HardwareFault])
def test_whatever_interrupts_an_arming_leaves_every_torque_off(
    bus: EmulatedBus, error: type[BaseException]
) -> None:
    def burst() -> None:
        raise error("a bug")

    # a fault before the first torque is bad input: nothing has moved
    told = (InvalidInput, HardwareFault) if error is HardwareFault else error
    for at in (2, 6, 8):
        with pytest.MonkeyPatch.context() as patch, measured(bus) as world:
            Writes(patch, burst, at)
            with pytest.raises(told, match="a bug"):
                world.arm()
            assert not any(bus.state()["torque"])
            assert not world.armed


def test_a_robot_that_was_held_is_held_on_where_its_arming_is_interrupted(bus: EmulatedBus) -> None:
    with measured(bus) as world:
        world.arm()
        world.stop()
    with pytest.MonkeyPatch.context() as patch, DynamixelWorld(ROBOT, calibrated(bus)) as world:
        world.connect((), START, np.zeros(3), np.eye(3))
        Writes(patch, lambda: world.latch.trip("button"), 5)
        with pytest.raises(Stopped):
            world.arm()
        seen = bus.state()
        assert all(seen["torque"])
        assert set(seen["watchdog"]) == {50}
        world.stop(torque_off=True)


def test_a_stop_between_asking_and_sending_lets_one_command_out_and_counts_it(
    bus: EmulatedBus,
) -> None:
    with pytest.MonkeyPatch.context() as patch, measured(bus) as world:
        world.arm()
        world.step(START)
        before = len(bus.goal_packets_s)
        Writes(patch, lambda: world.latch.trip("button"), 0)
        world.step(START)
        for _ in range(5):
            with refuses("button", kind=Stopped):
                world.step(START)
        assert len(bus.goal_packets_s) == before + 1
        assert world.latch.after == 1
        assert bus.goal_packets_s[-1] - world.latch.time_s < 1.0 / world.rate_hz
        world.stop(torque_off=True)  # what stops the robot is sent, stop or no stop
        assert not any(bus.state()["torque"])


@pytest.fixture(scope="module")
def prepared(step: Callable[[str], Motion]) -> Prepared:
    return Runner(MemoryWorld(), settings=FAST).prepare(Accepted.verified(step("walls"), "walls"))


@pytest.fixture(autouse=True)
def timed_once(prepared: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans are timed once for all worlds in memory, which takes longest."""

    def again(runner: Runner, accepted: Accepted) -> Prepared:
        tracker = Tracker(prepared.motion, prepared.kinematics, runner.world.rate_hz, BLIND)
        return replace(prepared, tracker=tracker, first=tracker.start())

    monkeypatch.setattr(Runner, "prepare", again)


@pytest.mark.parametrize("ending", ["hold", "home", "torque-off"])
def test_the_ending_of_an_arming_that_was_interrupted_is_no_torque_whatever_was_asked_for(
    accepted: Accepted, ending: Any, world: MemoryWorld
) -> None:
    pressed = [False]
    world.latch.listen(
        lambda: "button" if pressed[0] or world.torque_on else None
    )  # as soon as the torque is on
    report = Runner(world, settings=replace(FAST, ending=ending), dry=False).run(accepted)
    assert not world.torque_on
    assert (report.message, report.sent, world.commands) == ("button", 0, [])
    assert report.ended.left == ("torque off" if ending == "torque-off" else "as it was")


def ran(world: MemoryWorld, accepted: Accepted, ending: Any, **options: Any) -> RunReport:
    return Runner(world, settings=replace(FAST, ending=ending), dry=False, **options).run(accepted)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(("ending", "left", "torque"), ENDINGS)
def test_a_signal_in_the_middle_of_a_run_carries_out_the_ending(
    accepted: Accepted,
    number: signal.Signals,
    ending: str,
    left: str,
    torque: bool,
    world: MemoryWorld,
) -> None:
    world.fault = lambda world: os.kill(os.getpid(), number) if len(world.commands) == 30 else None
    report = ran(world, accepted, ending)
    assert (report.ended.left, world.torque_on) == (left, torque)
    assert_names(report.message, number.name)
    assert len(world.commands) <= 31  # what the signal found on its way
    assert report.stopped_s is not None
    assert max(when for when, _ in world.commands) <= report.stopped_s + report.after_s


class FullDisk:
    """A log with room for so many messages."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, topic: str, content: Any) -> None:
        self.room -= 1
        if self.room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(("ending", "left", "torque"), ENDINGS)
def test_a_log_that_is_full_at_any_message_carries_out_the_ending(
    accepted: Accepted, ending: str, left: str, torque: bool
) -> None:
    for room in (0, 1, 2, 4, 5, 20):
        world = MemoryWorld()
        with refuses("No space left", kind=OSError):
            ran(world, accepted, ending, log=FullDisk(room))
        assert (world.armed, world.closed) == (False, 1)
        # a measurement, the decision to arm; then the torque is on; the decisions to go, then
        # commands, each with its target and its measurement
        assert world.torque_on == (torque and room > 1)
        assert len(world.commands) == max(0, (room - 4) // 3 + 1)


def test_an_output_that_is_gone_carries_out_the_ending(
    accepted: Accepted, world: MemoryWorld
) -> None:
    def shown(done: int, total: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with refuses("Input/output", kind=OSError):
        ran(world, accepted, "torque-off", progress=shown)
    assert (len(world.commands), world.torque_on) == (1, False)


def test_a_stop_on_the_way_home_ends_in_hold(accepted: Accepted, world: MemoryWorld) -> None:
    with SafeWorld(world, dry=False) as safe:
        safe.connect((), START, np.zeros(3), np.eye(3))
        world.arm()
        world.fault = lambda world: safe.latch.trip("button") if len(world.commands) == 3 else None
        ended = end(safe, "home", [START + 0.3], 0.5)
    assert ended.left == "held"
    assert_names(ended.message, "home", "button")
    assert len(world.commands) == 3
    assert world.torque_on


def test_a_bug_on_the_way_home_ends_in_hold(accepted: Accepted, world: MemoryWorld) -> None:
    def bug(world: MemoryWorld) -> None:
        raise ZeroDivisionError("a bug")

    with SafeWorld(world, dry=False) as safe:
        safe.connect((), START, np.zeros(3), np.eye(3))
        world.arm()
        safe.step(START)
        world.fault = bug
        ended = end(safe, "home", [START + 0.3], 0.5)
    assert ended.left == "held"
    assert_names(ended.message, "home", "ZeroDivisionError", "a bug")


@pytest.mark.parametrize("cut", [KeyboardInterrupt, SystemExit, OSError])
def test_an_ending_that_is_cut_off_is_done_once_more(cut: type[BaseException]) -> None:
    world, tries = MemoryWorld(), list[int]()
    relax = world.relax

    def twice() -> None:
        tries.append(1)
        if len(tries) == 1:
            raise cut("again")
        relax()

    world.relax = twice  # type: ignore[method-assign]
    with SafeWorld(world, dry=False) as safe:
        safe.connect((), START, np.zeros(3), np.eye(3))
        world.arm()
        safe.latch.trip("button")
        ended = end(safe, "torque-off", None, 1.0)
    assert (ended.left, ended.message, len(tries), world.torque_on) == ("torque off", "", 2, False)


def test_signals_that_come_in_the_ending_and_while_the_world_closes_change_nothing(
    accepted: Accepted, world: MemoryWorld
) -> None:
    relax, close = world.relax, world.close

    def stormy(verb: Callable[[], None]) -> Callable[[], None]:
        def done() -> None:
            for number in SIGNALS:
                os.kill(os.getpid(), number)
            time.sleep(0.01)
            verb()

        return done

    world.relax, world.close = stormy(relax), stormy(close)  # type: ignore[method-assign]
    world.fault = lambda world: world.latch.trip("button") if len(world.commands) == 10 else None
    report = ran(world, accepted, "torque-off")
    assert (report.message, report.ended.left, world.torque_on, world.closed) == (
        "button",
        "torque off",
        False,
        1,
    )
    assert len(world.commands) == 10


def test_a_world_that_was_stopped_is_not_armed_again(
    accepted: Accepted, tmp_path: Path, world: MemoryWorld
) -> None:
    world.latch.trip("button")
    report = ran(world, accepted, "hold")
    assert (report.message, world.commands, world.torque_on) == ("button", [], False)
