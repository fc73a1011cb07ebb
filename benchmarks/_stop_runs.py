"""Stops from another process, of ``faults``: the command ``stancekit run`` itself, on devices that
are processes.

The host is forked, runs the command's own entry, and says when it begins to arm. Half of the stops
come while it arms, a quarter in the first second, a quarter in the first 2.5 s, at times drawn
evenly; half of the runs end in hold, half in torque off. Times are CLOCK_MONOTONIC in all
processes. The latch is the host's; where there is none to trip (a host that is killed or stands
still, a cable that is pulled), it is the moment of that.
"""

from __future__ import annotations

import json
import os
import pty
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import resting

from stancekit.cli.main import main as command
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import hexapod
from stancekit.runner.safety.estop import StopLatch
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import same_names
from tests.emulators.devices import DeviceProcess, bridge_process, bus_process

SIGNALS = {
    name: getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1")
}
TERMINAL = ("key", "closed terminal", "lost line")
TOPIC = ("stop topic", "stop topic lost")
ON_BUS = (
    *SIGNALS,
    "two signals",
    "stop file",
    *TERMINAL,
    "output closed",
    *TOPIC,
    "exception",
    "full disk",
    "host killed",
    "host frozen",
    "cable unplugged",
    "servo unplugged",
    "monitor killed",
    "monitor frozen",
)
BY_ROS = ("ros SIGTERM", "ros e-stop", "ros exception", "ros host killed", "ros host frozen")
STOPS = (*ON_BUS, *BY_ROS)
CYCLE_S = 0.02
"""A control period of the bus."""
ARMING_S, FIRST_S, LATEST_S = 0.05, 1.0, 2.5
FROZEN_S, SETTLE_S, LIMIT_S = 1.0, 0.5, 40.0
STILL_RAD_S = 0.02


@dataclass
class Host:
    """A forked process that runs the command. told: what it says of itself; terminal, output: the
    other ends.
    """

    pid: int
    told: int
    terminal: int
    output: int
    text: str = ""

    def said(self, what: str) -> float:
        """When it said this, waiting for it; NaN where it ended without."""
        end = time.monotonic() + LIMIT_S
        while time.monotonic() < end:
            for row in self.text.splitlines():
                if row.startswith(what + " "):
                    return float(row.split()[1])
            if select.select([self.told], [], [], 0.05)[0]:
                more = os.read(self.told, 65536).decode()
                if not more:
                    return float("nan")
                self.text += more
        raise AssertionError(f"the host did not say {what!r}: {self.text}")

    def ended(self) -> dict[str, Any]:
        """Its last words, empty where it had none; it is gone then."""
        self.said("nothing more")
        os.waitpid(self.pid, 0)
        rows = [row for row in self.text.splitlines() if row.startswith("latch ")]
        return json.loads(rows[0].removeprefix("latch ")) if rows else {}

    def close(self) -> None:
        """Give back what is left."""
        for stream in {self.told, self.terminal, self.output} - {-1}:
            os.close(stream)


def forked(kind: str, arguments: list[str], errors: Path) -> Host:
    """Begin the command in a process, and a session, of its own."""
    hears, says = os.pipe()
    reads, writes = os.pipe()
    outer, inner = pty.openpty() if kind in TERMINAL else (-1, -1)
    pid = os.fork()
    if pid == 0:
        for stream in (hears, reads, outer):
            if stream >= 0:
                os.close(stream)
        os.setsid()
        if kind == "key" or kind == "closed terminal":
            os.close(
                os.open(os.ttyname(inner), os.O_RDWR)
            )  # a session's first terminal is the one that hangs it up
        shown = inner if kind in ("closed terminal", "lost line") else writes
        given = inner if inner >= 0 else os.open(os.devnull, os.O_RDONLY)
        wrong = (
            inner if kind == "closed terminal" else os.open(errors, os.O_WRONLY | os.O_CREAT, 0o600)
        )
        for number, stream in enumerate((given, shown, wrong)):
            os.dup2(stream, number)
        host_main(arguments, says)
    for stream in (says, writes, inner):
        if stream >= 0:
            os.close(stream)
    return Host(pid=pid, told=hears, terminal=outer, output=reads)


def host_main(arguments: list[str], says: int) -> None:
    """The host: says when it arms, is armed, and what its latch counted."""
    latches = list[StopLatch]()

    def on_progress(kind: type[Any]) -> None:
        arm = kind.arm

        def noted(world: Any) -> None:
            latches.append(world.latch)
            os.write(says, f"arming {time.monotonic()}\n".encode())
            arm(world)
            os.write(says, f"armed {time.monotonic()}\n".encode())

        kind.arm = noted

    def burst(*_: Any) -> None:
        raise ZeroDivisionError("a bug, from outside")

    code = 1
    try:
        for stream, mode in ((0, "r"), (1, "w"), (2, "w")):
            setattr(sys, ("stdin", "stdout", "stderr")[stream], open(stream, mode, closefd=False))  # noqa: SIM115
        for kind in (DynamixelWorld, RosWorld):
            on_progress(kind)
        for number in SIGNALS.values():
            signal.signal(
                number, signal.SIG_DFL
            )  # a benchmark in the background may have inherited others
        signal.signal(signal.SIGUSR2, burst)
        command(arguments)
    except SystemExit as end:
        code = int(str(end.code))
    except BaseException:
        traceback.print_exc(file=sys.__stderr__)
    finally:
        for latch in latches[:1]:
            words = {
                "time_s": latch.time_s if latch.tripped else None,
                "reason": latch.reason,
                "after": latch.after,
                "after_s": latch.after_s,
                "code": code,
            }
            os.write(says, f"latch {json.dumps(words)}\n".encode())
        os._exit(code)


def stopped(
    kind: str, path: Path, start: Array, index: int, rng: np.random.Generator
) -> dict[str, Any]:
    """One stop. start: joint angles at the plan's beginning."""
    ending, joints = ("hold", "torque-off")[index // 4 % 2], hexapod().joint_names
    most_s = (ARMING_S, ARMING_S, FIRST_S, LATEST_S)[index % 4]
    ros = kind in BY_ROS
    with (
        tempfile.TemporaryDirectory() as name,
        bridge_process(path) if ros else bus_process(start) as device,
    ):
        folder = Path(name)
        arguments = [
            "run",
            str(path),
            "--world",
            "ros" if ros else "dynamixel",
            "--setup",
            str(folder / "setup.yaml"),
            "--arm",
            "--hung",
            "--ending",
            ending,
            "--log",
            str(folder / "run.mcap"),
            "--stop-file",
            str(folder / "stop"),
        ]
        topic = bridge_process(path) if kind in TOPIC else None
        if topic is not None:
            arguments += ["--stop-topic", f"127.0.0.1:{topic.where['port']}/e_stop"]
        if ros:
            setup = same_names(
                joints,
                port=device.where["port"],
                estop="/e_stop",
                controller_manager="/controller_manager",
            )
            setup.write(folder / "setup.yaml")
            device.inject(
                "controller off"
            )  # as it is found, so that an interrupted arming must leave it
        else:
            resting(hexapod(), start, device.where["path"]).write(folder / "setup.yaml")
        host = forked(kind, arguments, folder / "errors")
        try:
            begun_s = host.said("arming")
            assert begun_s == begun_s, (folder / "errors").read_text()
            time.sleep(max(0.0, begun_s + float(rng.uniform(0.0, most_s)) - time.monotonic()))
            did_s = time.monotonic()
            inject(kind, host, device, topic, folder, rng)
            words, armed_s = host.ended(), host.said("armed")
        finally:
            host.close()
            if topic is not None:
                topic.close()
        time.sleep(SETTLE_S)
        return judged(kind, ending, device.state(), words, (begun_s, armed_s, did_s))


def inject(
    kind: str,
    host: Host,
    device: DeviceProcess,
    topic: DeviceProcess | None,
    folder: Path,
    rng: np.random.Generator,
) -> None:
    """What is done to it, from here."""
    what = kind.removeprefix("ros ")
    acts: dict[str, Callable[[], Any]] = {
        "two signals": lambda: twice(host.pid, float(rng.uniform(0.0, 0.01))),
        "stop file": (folder / "stop").touch,
        "key": lambda: os.write(host.terminal, b" "),
        "exception": lambda: os.kill(host.pid, signal.SIGUSR2),
        "full disk": lambda: resource.prlimit(host.pid, resource.RLIMIT_FSIZE, (1, 1)),
        "host killed": lambda: os.kill(host.pid, signal.SIGKILL),
        "host frozen": lambda: read_only(host.pid),
        "monitor killed": lambda: os.kill(monitor(host.pid), signal.SIGKILL),
        "monitor frozen": lambda: os.kill(monitor(host.pid), signal.SIGSTOP),
        "cable unplugged": lambda: device.inject("cable pulled"),
        "servo unplugged": lambda: device.inject("silent servo"),
        "e-stop": lambda: device.inject("e-stop"),
    }
    if topic is not None:
        topic.inject("e-stop" if kind == "stop topic" else "rosbridge gone")
    elif kind in ("closed terminal", "lost line"):
        os.close(host.terminal)
        host.terminal = -1
    elif kind == "output closed":
        os.close(host.output)
        host.output = -1
    elif what in SIGNALS:
        os.kill(host.pid, SIGNALS[what])
    else:
        acts[what]()


def twice(pid: int, apart_s: float) -> None:
    """A second signal shortly after the first, while that one is being obeyed."""
    os.kill(pid, signal.SIGINT)
    time.sleep(apart_s)
    os.kill(pid, signal.SIGTERM)


def read_only(pid: int) -> None:
    """The host stands still, and goes on later as if nothing had been."""
    os.kill(pid, signal.SIGSTOP)
    time.sleep(FROZEN_S)
    os.kill(pid, signal.SIGCONT)


def monitor(pid: int) -> int:
    """The host's monitor."""
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])


def judged(
    kind: str,
    ending: str,
    state: dict[str, Any],
    words: dict[str, Any],
    times: tuple[float, float, float],
) -> dict[str, Any]:
    """What came of it. times: when arming began and ended (NaN where it did not), and when the stop
    was injected.
    """
    begun_s, armed_s, did_s = times
    what = kind.removeprefix("ros ")
    outside = what in ("host killed", "host frozen", "cable unplugged")
    latched = words.get("time_s")
    from_s = did_s if outside else latched
    if what == "cable unplugged" and state["happened"]:
        from_s = state["happened"][0][1]  # by the bus's own clock
    if "log" in state:
        moved_s = [when for message, when in state["log"] if message == "stream"]
        torque, moving = [state["on"]], np.abs(state["rate_rad_s"]).max() > STILL_RAD_S
    else:
        moved_s = state["goal_packets_s"] + state["torque_packets_s"]
        torque, moving = state["torque"], np.abs(state["rate_rad_s"]).max() > STILL_RAD_S
    arming = from_s is not None and not armed_s <= from_s
    helpless = what == "host killed" or what == "cable unplugged"
    on = sum(torque)
    spare = int(what == "servo unplugged")  # nobody reaches that one: its own watchdog stops it
    if helpless:  # what its torque was, and its own watchdog
        right = on in (0, len(torque))
    elif arming or ending == "torque-off":
        right = on <= spare
    else:
        right = on >= len(torque) - spare
    late_s = (
        max([when - from_s for when in moved_s], default=-np.inf) if from_s is not None else np.inf
    )
    return {
        "stopped": from_s is not None,
        "moved": armed_s == armed_s,
        "ending": ending,
        "phase": "arming"
        if arming
        else "first second"
        if from_s is not None and from_s < begun_s + 1.0
        else "later",
        "message": words.get("reason", ""),
        "stop_s": None if latched is None or outside else latched - did_s,
        "after": 0 if from_s is None else sum(when > from_s + CYCLE_S for when in moved_s),
        "late_s": float(np.clip(late_s, 0.0, 1e3)),
        "written": words.get("after", 0),
        "written_s": words.get("after_s", 0.0),
        "as_asked": bool(right and not moving),
        "left": f"{'arming, ' if arming else ''}{ending}",
        "state": f"{on} of {len(torque)} on" + (", MOVING" if moving else ""),
        "code": words.get("code"),
    }
