"""Faults of a servo bus at random times: what happened, how long until nothing moved, what was sent
afterwards.

    python benchmarks/bus_faults.py [--kinds "silent servo" …] [--count 20] [--seed 0] [--json]

24 emulated servos (``tests/emulators``) in a process of their own, on a pseudo-terminal that the
real SDK opens; a host, another process, moves all joints at 50 Hz in waves of .25 rad and, when its
world raises, does what the ending says: hold, or torque off. A fault happens at a random time of
the first two seconds. Half of the runs end each way.

stop: from the fault until no shaft turned faster than .02 rad/s. noticed: until the host's world
raised. after: goal packets that reached the bus more than 2 ms after that. state: what the servos
were in a second later.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import Options, launch, resting, servos

from stancekit.planners.errors import StancekitError
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.urdf import joint_names
from stancekit.runner.emulators.bus_process import BusProcess
from stancekit.runner.worlds.dynamixel.calibration import Calibration
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators.bus_faults import KINDS, WRONG_CALIBRATION, BusFaults, spoiled

RUN_S, AFTER_S = 3.0, 1.0


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which faults, and how often. host, ending: of the process that moves the joints."""

    kinds: tuple[str, ...] = KINDS
    count: int = 20
    host: Annotated[Path | None, tyro.conf.arg(help="")] = None
    ending: Literal["hold", "torque off"] = "hold"


def main(arguments: Arguments) -> None:
    """Measure and print."""
    if arguments.host is not None:
        host(arguments.host, arguments.ending)
        return
    for kind in arguments.kinds:
        rng = np.random.default_rng([arguments.seed, KINDS.index(kind)])
        runs = [run(kind, ("hold", "torque off")[k % 2], rng) for k in range(arguments.count)]
        for found in runs if arguments.json else ():
            arguments.say(found)
        if not arguments.json:
            print(table(kind, runs), flush=True)


def host(calibration: Path, ending: str) -> None:
    """Move until something raises or the time is over, then end as asked and stay for a while."""
    robot = hexapod()
    world = DynamixelWorld(robot, Calibration.from_yaml(calibration, joint_names(robot)))
    phases = np.linspace(0.0, 2 * np.pi, len(world.joints), endpoint=False)
    say = {"message": "", "noticed_s": 0.0, "ending": ""}
    try:
        state = world.reset((), np.zeros(len(world.joints)), np.zeros(3), np.eye(3))
        world.torque(True)
        print(json.dumps({"began_s": time.monotonic()}), flush=True)
        middle = state.angles_rad.copy()
        for k in range(round(RUN_S * world.rate_hz)):
            wave = np.sin(2 * np.pi * 0.4 * k / world.rate_hz + phases) - np.sin(phases)
            world.step(middle + 0.25 * min(1.0, k / world.rate_hz) * wave)
    except StancekitError as error:
        say |= {"message": f"{type(error).__name__}: {error}", "noticed_s": time.monotonic()}
    try:
        world.hold() if ending == "hold" else world.relax()
    except StancekitError as error:
        say["ending"] = str(error)
    print(json.dumps(say), flush=True)
    time.sleep(AFTER_S)
    world.close()


def run(kind: str, ending: str, rng: np.random.Generator) -> dict[str, Any]:
    """One fault."""
    joints = joint_names(hexapod())
    start = np.tile([0.4, 0.6, 0.3, 1.2], len(joints) // 4)
    with (
        BusProcess(start.tolist(), seed=int(rng.integers(1 << 30))) as bus,
        tempfile.TemporaryDirectory() as folder,
    ):
        calibration = resting(joints, start, bus.path)
        if kind == WRONG_CALIBRATION:
            calibration, _ = spoiled(calibration, rng)
        calibration.write(Path(folder) / "servos.yaml")
        command = [
            sys.executable,
            __file__,
            "--host",
            str(Path(folder) / "servos.yaml"),
            "--ending",
            ending,
        ]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        first = json.loads(child.stdout.readline())
        if "began_s" in first:
            BusFaults(bus, child.pid).inject(kind, float(rng.uniform(0.1, 2.0)))
            killed_s = time.monotonic()
            line = child.stdout.readline()
            killed_s = time.monotonic() if not line else killed_s
            said = (
                json.loads(line)
                if line
                else {"message": "killed", "noticed_s": killed_s, "ending": ""}
            )
        else:
            said, killed_s = first, 0.0
        time.sleep(AFTER_S)
        state = bus.state()
        child.wait()
    happened_s = state["happened"][0][1] if state["happened"] else said["noticed_s"]
    after = (
        sum(time_s > said["noticed_s"] + 0.002 for time_s in state["goal_packets_s"])
        if said["message"]
        else 0
    )
    return {
        "kind": kind,
        "ending": ending,
        "message": said["message"],
        "why_not": said["ending"],
        "after": after,
        "noticed_s": said["noticed_s"] - happened_s if said["message"] else None,
        "stop_s": max(0.0, state["still_s"] - happened_s) if said["message"] else None,
        "state": servos(state),
        "moved": "began_s" in first,
    }


def table(kind: str, runs: list[dict[str, Any]]) -> str:
    """A few lines for one kind."""
    stops = [run["stop_s"] for run in runs if run["stop_s"] is not None and run["moved"]]
    noticed = [run["noticed_s"] for run in runs if run["noticed_s"] is not None and run["moved"]]
    stopped = sum(bool(run["message"]) for run in runs)
    lines = [
        f"{kind}: {stopped} of {len(runs)} stopped, {sum(not r['moved'] for r in runs)} before any motion"
    ]
    if stops:
        lines.append(
            f"  stop median {np.median(stops):.3f} s, worst {max(stops):.3f} s; noticed after median "
            f"{np.median(noticed):.3f} s, worst {max(noticed):.3f} s"
        )
    lines.append(f"  goal packets after the stop: {sum(run['after'] for run in runs)}")
    for ending in ("hold", "torque off"):
        seen = Counter(run["state"] for run in runs if run["ending"] == ending)
        lines += [f"  {ending}: {count} × {state}" for state, count in seen.most_common()]
    lines.append(
        f"  e.g. {next((run['message'] for run in runs if run['message']), 'nothing was noticed')}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
