"""What happens when a robot behind an emulated rosbridge goes wrong: every kind of fault at random
times.

    python benchmarks/ros_faults.py [--kinds …] [--count 20] [--seed 0] [--ros 2] [--ending hold]
    [--json]

All 24 joints swing by ±0.4 rad at 0.4 Hz, streamed at 50 Hz through the guard (``SafeWorld``) to
the emulator of ``runner/emulators``, in the same process or, for "host killed" (SIGKILL), in one of
its own. A fault comes at a time drawn from [0.3, 2] s. told: from the fault until the loop was
stopped. still: from the fault until the last time that any joint of the emulated robot turned
faster than 0.02 rad/s, seen every 5 ms. after: commands that the robot got beyond those sent before
the stop, while the loop went on asking ten times more (for a host that was killed: later than 0.1 s
after that). Medians, and the worst of all in brackets. For "stuck joint" the swing has to come far
enough from where that joint is. Times are wall-clock times on whatever machine this runs on.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from _bench import Options, launch, tally

from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.urdf import joint_names
from stancekit.runner.emulators.rosbridge import FAULTS, RosBridge
from stancekit.runner.safety.ending import Ending, end
from stancekit.runner.safety.guard import SafeWorld
from stancekit.runner.safety.latch import StopLatch, Stopped
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.setup import same_names

ROBOT = hexapod()
JOINTS = joint_names(ROBOT)
START = np.tile([0.0, 0.3, 0.0, 1.2], len(ROBOT.limbs))
HOST = ("host killed", "slow host", "NaN command", "stop pressed")
KINDS = (*(kind for kind in FAULTS if kind != "rejects goals"), *HOST)
SETTLE_S = 0.6


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which faults, and how often."""

    kinds: tuple[str, ...] = KINDS
    count: int = 20
    ros: Literal[1, 2] = 2
    ending: Ending = "hold"


def main(arguments: Arguments) -> None:
    """Measure and print."""
    for kind in arguments.kinds:
        rng = np.random.default_rng([arguments.seed, KINDS.index(kind)])
        runs = [
            tried(kind, float(rng.uniform(0.3, 2.0)), arguments.ros, arguments.ending)
            for _ in range(arguments.count)
        ]
        record = {"kind": kind, "ros": arguments.ros, "ending": arguments.ending} | summary(runs)
        arguments.say(record, line)


def tried(kind: str, at_s: float, ros: Literal[1, 2], ending: Ending) -> dict[str, Any]:
    """One run with one fault."""
    with RosBridge(JOINTS, START, ros=ros) as bridge:
        moved = Moved(bridge)
        message = (
            killed(bridge, at_s, ros)
            if kind == "host killed"
            else driven(bridge, kind, at_s, ros, ending)
        )
        time.sleep(SETTLE_S)
        fault_s, stop_s = message.pop("fault_s"), message.pop("stop_s")
        got = [when for what, when in bridge.log if what in ("stream", "goal")]
        sent = message.pop("sent", None)
        after = (
            sum(when > stop_s + 0.1 for when in got) if sent is None else max(len(got) - sent, 0)
        )
        moved.end()
        return message | {
            "told_s": stop_s - fault_s,
            "still_s": max(moved.last_s - fault_s, 0.0),
            "after": after,
        }


def driven(
    bridge: RosBridge, kind: str, at_s: float, ros: Literal[1, 2], ending: Ending
) -> dict[str, Any]:
    """Swing until the fault stops it, and then try to go on."""
    message, stop_s = "nothing stopped it", float("nan")
    setup = same_names(
        JOINTS, port=bridge.port, ros=ros, estop="/e_stop", controller_manager="/controller_manager"
    )
    device = CountedWorld(ROBOT, setup)
    with SafeWorld(device, dry=False) as world:
        world.reset((), START, np.zeros(3), np.eye(3))
        device.torque(True)
        begin = time.monotonic()
        if kind in FAULTS:
            bridge.inject(kind, at_s)
        try:
            while (passed := time.monotonic() - begin) < at_s + 4.0:
                world.step(spoiled(kind, passed > at_s, swing(passed), world.latch))
        except (Stopped, HardwareFault) as error:
            message, stop_s = str(error), time.monotonic()
        sent = device.streamed + 1  # and the one that armed
        for _ in range(10):
            refused(world)
        ended = end(world, ending, None, 0.4)
    faults = [when for what, when in bridge.log if what == f"fault: {kind}"]
    fault_s = (faults or [begin + at_s])[0]
    return {
        "message": message,
        "left": ended.left,
        "fault_s": fault_s,
        "stop_s": stop_s,
        "sent": sent,
    }


class CountedWorld(RosWorld):
    """Counts what it streams; a command that a fault kept it from sending does not count."""

    streamed = 0

    def sendable(self, targets_rad: Array) -> Array:
        """As the world's; asked once for every command that goes out."""
        self.streamed += 1
        return super().sendable(targets_rad)


def spoiled(kind: str, now: bool, targets: Array, latch: StopLatch) -> Array:
    """The targets, with what the host does wrong from now on."""
    if now and kind == "slow host":
        time.sleep(0.5)
    elif now and kind == "stop pressed":
        latch.trip("stop pressed")
    return np.full_like(targets, np.nan) if now and kind == "NaN command" else targets


def refused(world: SafeWorld) -> None:
    """One command more; it may not go through."""
    try:
        world.step(START)
    except (Stopped, HardwareFault):
        return
    raise AssertionError("a command went through after the stop")


def killed(bridge: RosBridge, at_s: float, ros: Literal[1, 2]) -> dict[str, Any]:
    """Swing in a process of its own, and kill that."""
    host = multiprocessing.get_context("spawn").Process(
        target=host_main, args=(bridge.port, ros), daemon=True
    )
    host.start()
    while sum(what == "stream" for what, _ in list(bridge.log)) < 5:
        time.sleep(0.01)
    time.sleep(at_s)
    assert host.pid is not None
    os.kill(host.pid, signal.SIGKILL)
    now = time.monotonic()
    host.join()
    return {"message": "", "left": "left to the device", "fault_s": now, "stop_s": now}


def host_main(port: int, ros: Literal[1, 2]) -> None:
    """The process that is killed."""
    with RosWorld(ROBOT, same_names(JOINTS, port=port, ros=ros)) as world:
        world.reset((), START, np.zeros(3), np.eye(3))
        world.torque(True)
        begin = time.monotonic()
        while (passed := time.monotonic() - begin) < 30.0:
            world.step(swing(passed))


def swing(passed_s: float) -> Array:
    """Targets of all joints, shape (J,)."""
    return np.asarray(START + 0.4 * np.sin(2.0 * np.pi * 0.4 * passed_s))


class Moved:
    """When a joint of the emulated robot turned last."""

    def __init__(self, bridge: RosBridge) -> None:
        self.last_s, self._bridge, self._over = 0.0, bridge, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(0.005):
            state = self._bridge.state()
            if np.abs(state["rate_rad_s"]).max() > 0.02:
                self.last_s = state["now_s"]


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts, medians and worst."""
    message, still = (np.array([run[key] for run in runs]) for key in ("told_s", "still_s"))
    return {
        "runs": len(runs),
        "stopped": int(np.isfinite(message).sum()),
        "told_ms": 1e3 * float(np.median(message)),
        "told_worst_ms": 1e3 * float(message.max()),
        "still_ms": 1e3 * float(np.median(still)),
        "still_worst_ms": 1e3 * float(still.max()),
        "after": sum(run["after"] for run in runs),
        "left": tally(run["left"] for run in runs),
        "message": runs[0]["message"],
    }


def line(record: dict[str, Any]) -> str:
    """A record for people."""
    return (
        f"{record['kind']:16s} {record['stopped']}/{record['runs']} stopped, told {record['told_ms']:.0f} "
        f"({record['told_worst_ms']:.0f}) ms, still {record['still_ms']:.0f} ({record['still_worst_ms']:.0f}) ms, "
        f"{record['after']} commands after, {record['left']}: {record['message']}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
