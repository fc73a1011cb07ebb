"""Runs with one fault each, of ``faults``: on an emulated bus, behind an emulated rosbridge, in
simulation, by file.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import numpy as np
from _bench import resting, servos

from stancekit.planners.errors import StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.safety.estop import StopLatch, Stopped
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import same_names
from stancekit.runner.worlds.world import State
from tests.emulators import rosbridge
from tests.emulators.devices import DeviceProcess, bus_process
from tests.emulators.memory_world import MemoryWorld
from tests.emulators.slipping import SlippingWorld
from tests.emulators.wrong_calibration import spoiled

OF_BUS = (
    "silent servo",
    "corrupted packets",
    "delay",
    "overload",
    "power loss",
    "cable pulled",
)
WRONG_CALIBRATION = "wrong calibration"
OF_HOST = ("nan command", "limit exceeded", "slow host", "clock jump")
OF_BRIDGE = tuple(f"rosbridge: {kind}" for kind in rosbridge.FAULTS)
FAULTS = (*OF_BUS, WRONG_CALIBRATION, *OF_HOST, "plan edited", "friction lost", *OF_BRIDGE)
BEGIN_S, LATEST_S = 0.9, 2.0
"""While limbs lift, swing and are put down."""
CYCLE_S = 0.02
"""A command may be on its way for a control period of the bus."""
ASKED_ON = 10
STILL_RAD_S = STILL_M_S = 0.02


class CountedWorld(SlippingWorld):
    """The slipping simulation, with the time.monotonic of every command that it got."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.commands_s: list[float] = []

    def send(self, targets_rad: Array, loads_rad: Array | None = None) -> None:
        """As the simulation."""
        self.commands_s.append(time.monotonic())
        super().send(targets_rad, loads_rad)

    def close(self) -> None:
        """Nothing: what it comes to after the run is looked at."""


class FaultyRunner(Runner):
    """A runner with a fault at a time after its first command. happened_s: when it was,
    time.monotonic.
    """

    def __init__(
        self, *arguments: Any, at_s: float, fault: Callable[[Array], Array], **options: Any
    ) -> None:
        super().__init__(*arguments, **options)
        self._at_s, self._fault = at_s, fault
        self._began: float | None = None
        self.happened_s: float | None = None

    def send(self, targets: Array, planned: Array, lean: Array | None = None) -> State:
        """As ``Runner``, but for one command."""
        self._began = time.monotonic() if self._began is None else self._began
        if self.happened_s is None and time.monotonic() - self._began > self._at_s:
            self.happened_s = time.monotonic()
            targets = self._fault(targets)
        return super().send(targets, planned, lean)


def on_bus(kind: str, path: Path, ending: Any, rng: np.random.Generator) -> dict[str, Any]:
    """A fault of the bus or of the host, while the runner runs."""
    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    start = first_pose(accepted)
    with bus_process(start, int(rng.integers(1 << 30))) as bus:
        calibration = resting(accepted.plan.problem.robot, start, bus.where["path"])
        if kind == WRONG_CALIBRATION:
            calibration, _ = spoiled(calibration, rng)
        runner = FaultyRunner(
            DynamixelWorld(accepted.plan.problem.robot, calibration),
            dry=False,
            at_s=at_s,
            fault=host_fault(kind, bus),
            settings=RunSettings(hung=True, ending=ending),
        )
        jumps = mock.patch("time.time", side_effect=lambda: float(rng.uniform(0.0, 4e9)))
        with jumps if kind == "clock jump" else nullcontext():
            found = outcome(runner, accepted)
        ask_on(runner)
        time.sleep(0.6)
        state = bus.state()
        happened = state["happened"][0][1] if state["happened"] else runner.happened_s
        return found | {
            "stop_s": None
            if not found["stopped"] or happened is None
            else max(0.0, found["over_s"] - happened),
            "after": sum(sent > runner.latch.time_s + CYCLE_S for sent in state["goal_packets_s"]),
            "state": servos(state),
        }


def host_fault(kind: str, bus: DeviceProcess) -> Callable[[Array], Array]:
    """What goes wrong, by kind; whatever is the bus's own is injected there."""

    def act(targets: Array) -> Array:
        if kind in OF_BUS:
            bus.inject(kind)
        elif kind == "nan command":
            targets = np.where(np.arange(len(targets)) == 7, np.nan, targets)
        elif kind == "limit exceeded":
            targets = targets + 3.0
        elif kind == "slow host":
            time.sleep(0.6)
        return targets

    return act


def outcome(runner: Runner, accepted: Accepted) -> dict[str, Any]:
    """Run; what the runner says of it."""
    try:
        report = runner.run(accepted)
    except StancekitError as error:
        return {
            "stopped": True,
            "moved": False,
            "message": str(error),
            "left": "as it was",
            "over_s": time.monotonic(),
        }
    return {
        "stopped": not report.succeeded,
        "moved": report.sent > 0,
        "message": report.message,
        "left": report.ended.left,
        "over_s": time.monotonic(),
        "clipped": report.clipped,
    }


def edited(path: Path, rng: np.random.Generator) -> dict[str, Any]:
    """One bit of the file flipped, in a copy, and run."""
    world = MemoryWorld()
    with tempfile.TemporaryDirectory() as folder:
        content = bytearray(path.read_bytes())
        content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(7))
        (Path(folder) / path.name).write_bytes(bytes(content))
        stopped, said = True, ""
        try:
            found = Accepted.from_file(Path(folder) / path.name)
            same = found.digest == Accepted.from_file(path).digest
            stopped, said = False, "the same content" if same else "TAKEN FOR ACCEPTED"
            Runner(world, dry=False).run(found)
        except StancekitError as error:
            said = str(error).replace(folder, "…")
    sent = len(world.commands)
    return {
        "stopped": stopped,
        "moved": bool(sent),
        "message": said,
        "left": "as it was" if stopped else said,
        "after": sent if stopped else None,
        "state": "torque on" if world.torque_on else "torque off",
    }


def slipped(path: Path, rng: np.random.Generator) -> dict[str, Any]:
    """All surfaces lose friction, in MuJoCo."""
    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    world = CountedWorld(accepted.plan.problem.robot, share=0.4)
    world.inject("friction differs", at_s)
    runner = Runner(world)
    found = outcome(runner, accepted)
    stopped_s = runner.latch.time_s if found["stopped"] else float("inf")
    state = runner.state
    assert state is not None
    ask_on(runner)
    after = sum(at > stopped_s for at in world.commands_s)
    world.latch = StopLatch()  # physics goes on, with what the joints were told last
    for _ in range(round(0.5 * world.rate_hz)):
        last = SlippingWorld.step(world, state.sent_rad)
    moving = float(np.linalg.norm(last.velocity[:3])) > STILL_M_S
    return found | {
        "stop_s": state.time_s - world.happened_s if found["stopped"] else None,
        "after": after,
        "state": "the body slides on" if moving else "the body rests",
    }


def behind_rosbridge(
    kind: str, path: Path, ending: Any, ros: Literal[1, 2], rng: np.random.Generator
) -> dict[str, Any]:
    """A fault of an emulated robot behind a rosbridge."""
    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    robot = accepted.plan.problem.robot
    joints = robot.joint_names
    with rosbridge.RosBridge(joints, first_pose(accepted), ros=ros) as bridge:
        setup = same_names(
            joints,
            port=bridge.port,
            ros=ros,
            estop="/e_stop",
            controller_manager="/controller_manager",
        )

        def happen(targets: Array) -> Array:
            bridge.inject(kind.removeprefix("rosbridge: "))
            return targets

        runner = FaultyRunner(
            RosWorld(robot, setup),
            dry=False,
            settings=RunSettings(hung=True, ending=ending),
            at_s=at_s,
            fault=happen,
        )
        found = outcome(runner, accepted)
        stop = (
            found["over_s"] - runner.happened_s
            if found["stopped"] and runner.happened_s is not None
            else None
        )
        ask_on(runner)
        time.sleep(0.6)
        got = [when for what, when in bridge.log if what == "stream"]
        return found | {
            "stop_s": stop,
            "after": sum(when > runner.latch.time_s + CYCLE_S for when in got),
            "state": controlled(bridge.state()),
        }


def ask_on(runner: Runner) -> None:
    """Ten commands more than a stopped runner should send."""
    for _ in range(ASKED_ON if runner.latch.tripped and runner.world.armed else 0):
        try:
            runner.world.step(runner.world.last_rad)
        except Stopped:
            continue
        raise AssertionError("a command went through after the stop")


def controlled(state: dict[str, Any]) -> str:
    """The state of an emulated robot behind a trajectory controller in a few words."""
    off = np.abs(np.subtract(state["position_rad"], state["desired_rad"])).max()
    what = (
        "controller off"
        if not state["on"]
        else "controller holds its last target"
        if off < 0.01
        else "on its way"
    )
    return what + (", MOVING" if np.abs(state["rate_rad_s"]).max() > STILL_RAD_S else "")


def first_pose(accepted: Accepted) -> Array:
    """Angles at the beginning of the plan's motion."""
    return Runner(MemoryWorld()).prepare(accepted).first.angles_rad
