"""Faults at random times of a run: what happened, how long until the stop, what was sent after it, what state was left.

    python benchmarks/faults.py [--kinds "nan command" …] [--count 20] [--seed 0] [--json]

The runner runs one step of the course ``walls``. Kinds of the host and of the bus happen on 24 emulated servos in a
process of their own, the robot hung in a stand, at 50 Hz; half of the runs end in hold, half in torque off. A plan is
edited by flipping one byte of one of its two files. Feet slip in MuJoCo: all surfaces lose 60 % of their friction at a
random time. The rosbridge is an emulated one. The host is killed as a process of its own. ``bus_faults`` looks at the
same faults of a bus from closer by, at the driver alone.

stop: from the fault (or from the latch, where the fault is the host's) until the ending was done. after: commands that
the device received later than 2 ms after the end of the run.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from stancekit.envs.runner.acceptance import Accepted
from stancekit.envs.runner.estop import StopLatch, file_source, on_signals
from stancekit.envs.runner.log import NoLog
from stancekit.envs.runner.runner import Runner, RunSettings
from stancekit.envs.worlds import make_world
from stancekit.envs.worlds.calibration import nominal
from stancekit.envs.worlds.dynamixel import DynamixelWorld
from stancekit.envs.worlds.world import State
from stancekit.planners.arrays import Array
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.outcome import StancekitError
from stancekit.planners.plan_file import write_plan
from stancekit.planners.scene.course_spec import read_course
from stancekit.planners.scene.urdf import joint_names
from stancekit.planners.verify_plan import check_plan
from tests.emulators.bus_faults import BusFaults, spoiled
from tests.emulators.memory_world import MemoryWorld
from tests.emulators.servo_bus import BusProcess

OF_BUS = ("silent servo", "corrupted packets", "delay", "overload", "power loss", "cable pulled", "wrong calibration")
OF_HOST = ("nan command", "limit exceeded", "e-stop signal", "e-stop file", "slow host", "clock jump")
KINDS = (*OF_BUS, *OF_HOST, "host killed", "plan edited", "friction lost", "rosbridge gone")
BEGIN_S, LATEST_S = 0.1, 2.0


class FaultyRunner(Runner):
    """A runner with a fault at a time after its first command. happened_s: when it was, time.monotonic."""

    def __init__(self, *arguments: Any, at_s: float, fault: Callable[[Array], Array], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._at_s, self._fault = at_s, fault
        self._began: float | None = None
        self.happened_s: float | None = None

    def send(self, targets: Array, planned: Array) -> State:
        """As ``Runner``, but for one command."""
        self._began = time.monotonic() if self._began is None else self._began
        if self.happened_s is None and time.monotonic() - self._began > self._at_s:
            self.happened_s = time.monotonic()
            targets = self._fault(targets)
        return super().send(targets, planned)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--host", type=Path, default=None, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.host is not None:
        host(asked.host)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        plan = TwoStageCoursePlanner().solve(read_course("walls", frames=2)).plan
        assert plan is not None
        write_plan(path, plan, check_plan(plan))
        for kind in asked.kinds:
            rng = np.random.default_rng([asked.seed, KINDS.index(kind)])
            runs = [once(kind, path, ("hold", "torque-off")[k % 2], rng) for k in range(asked.count)]
            for found in runs if asked.json else ():
                print(json.dumps({"kind": kind, **found}), flush=True)
            if not asked.json:
                print(table(kind, runs), flush=True)


def once(kind: str, path: Path, ending: Any, rng: np.random.Generator) -> dict[str, Any]:
    """One fault."""
    if kind == "plan edited":
        return edited(path, rng)
    if kind == "friction lost":
        return slipped(path, rng)
    if kind == "rosbridge gone":
        return bridgeless(path, ending, rng)
    return on_bus(kind, path, ending, rng)


def on_bus(kind: str, path: Path, ending: Any, rng: np.random.Generator) -> dict[str, Any]:
    """A fault of the bus or of the host, while the runner runs."""
    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    joints = joint_names(accepted.plan.course.robot)
    start = first_pose(accepted)
    with BusProcess(start.tolist(), seed=int(rng.integers(1 << 30))) as bus, tempfile.TemporaryDirectory() as folder:
        calibration = nominal(joints, port=bus.path)
        rest = {name: replace(calibration.joints[name], rest_rad=float(start[i])) for i, name in enumerate(joints)}
        calibration = replace(calibration, joints=rest)
        if kind == "wrong calibration":
            calibration, _ = spoiled(calibration, rng)
        if kind == "host killed":
            return killed(path, bus, at_s, Path(folder))
        stop_file, latch = Path(folder) / "stop", StopLatch()
        runner = FaultyRunner(
            DynamixelWorld(accepted.plan.course.robot, calibration), latch=latch, dry=False,
            sources=[file_source(stop_file)], at_s=at_s, fault=host_fault(kind, stop_file, bus),
            settings=RunSettings(hung=True, ending=ending),
        )  # fmt: skip
        jumps = mock.patch("time.time", side_effect=lambda: float(rng.uniform(0.0, 4e9)))
        with on_signals(latch), jumps if kind == "clock jump" else nullcontext():
            found = outcome(runner, accepted)
        over_s = time.monotonic()
        time.sleep(0.6)
        state = bus.state()
        happened = state["happened"][0][1] if state["happened"] else runner.happened_s
        return found | {
            "stop_s": None if not found["stopped"] or happened is None else max(0.0, found["over_s"] - happened),
            "after": sum(sent > over_s + 0.002 for sent in state["goal_packets_s"]),
            "state": servos(state),
        }


def host_fault(kind: str, stop_file: Path, bus: BusProcess) -> Callable[[Array], Array]:
    """What goes wrong, by kind; whatever is the bus's own is injected there."""

    def act(targets: Array) -> Array:
        if kind in OF_BUS and kind != "wrong calibration":
            BusFaults(bus).inject(kind, 0.0)
        elif kind == "nan command":
            targets = np.where(np.arange(len(targets)) == 7, np.nan, targets)
        elif kind == "limit exceeded":
            targets = targets + 3.0
        elif kind == "e-stop signal":
            os.kill(os.getpid(), signal.SIGUSR1)
        elif kind == "e-stop file":
            stop_file.touch()
        elif kind == "slow host":
            time.sleep(0.6)
        return targets

    return act


def outcome(runner: Runner, accepted: Accepted) -> dict[str, Any]:
    """Run; what the runner says of it."""
    try:
        report = runner.run(accepted)
    except StancekitError as error:
        return {"stopped": True, "moved": False, "message": str(error), "left": "as it was", "over_s": time.monotonic()}
    return {
        "stopped": not report.succeeded, "moved": report.sent > 0, "message": report.message,
        "left": report.ended.left, "over_s": time.monotonic(), "clipped": report.clipped,
    }  # fmt: skip


def killed(path: Path, bus: BusProcess, at_s: float, folder: Path) -> dict[str, Any]:
    """kill -9 to a host that is a process of its own; the bus's watchdogs are all that is left."""
    (folder / "host.json").write_text(json.dumps({"plan": str(path), "port": bus.path}))
    command = [sys.executable, __file__, "--host", str(folder / "host.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(at_s)
        child.kill()
        child.wait()
        killed_s = time.monotonic()
        time.sleep(1.0)
        state = bus.state()
    return {
        "stopped": True, "moved": True, "message": "", "left": "to its bus watchdogs",
        "stop_s": max(0.0, state["still_s"] - killed_s), "state": servos(state),
        "after": sum(sent > killed_s + 0.002 for sent in state["goal_packets_s"]),
    }  # fmt: skip


def host(path: Path) -> None:
    """The process that is killed: says when its first command goes out."""
    given = json.loads(path.read_text())
    accepted = Accepted.from_file(given["plan"])
    robot = accepted.plan.course.robot

    def say(targets: Array) -> Array:
        print("moving", flush=True)
        return targets

    world = DynamixelWorld(robot, nominal(joint_names(robot), port=given["port"]))
    FaultyRunner(world, dry=False, settings=RunSettings(hung=True), at_s=0.0, fault=say).run(accepted)


def edited(path: Path, rng: np.random.Generator) -> dict[str, Any]:
    """One byte of one file flipped, in a copy."""
    with tempfile.TemporaryDirectory() as folder:
        names = [path, path.with_suffix(".npz")]
        victim = int(rng.integers(2))
        for index, name in enumerate(names):
            content = bytearray(name.read_bytes())
            if index == victim:
                content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(7))
            (Path(folder) / name.name).write_bytes(bytes(content))
        try:
            found = Accepted.from_file(Path(folder) / path.name)
            said = "the same content" if found.digest == Accepted.from_file(path).digest else "TAKEN FOR ACCEPTED"
            return {"stopped": False, "moved": False, "message": said, "left": said, "after": None}
        except StancekitError as error:
            said = str(error).replace(folder, "…")
            return {"stopped": True, "moved": False, "message": said, "left": "as it was", "after": None}


def slipped(path: Path, rng: np.random.Generator) -> dict[str, Any]:
    """All surfaces lose friction, in MuJoCo."""
    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    course = accepted.plan.course
    world = make_world("mujoco", course.robot)
    latch = StopLatch()

    class Losing(FaultyRunner):
        def send(self, targets: Array, planned: Array) -> State:
            if self.happened_s is None and self.state is not None and self.state.time_s > at_s:
                self.happened_s = self.state.time_s
                model = world._model  # type: ignore[attr-defined]
                for index in range(model.ngeom):
                    if model.geom_priority[index] == 1:
                        model.geom_friction[index, 0] *= 0.4
            return Runner.send(self, targets, planned)

    runner = Losing(world, latch=latch, at_s=at_s, fault=lambda targets: targets, log=NoLog())
    found = outcome(runner, accepted)
    state, stop = runner.state, None
    if found["stopped"] and state is not None and runner.happened_s is not None:
        stop = state.time_s - runner.happened_s
    return found | {"stop_s": stop, "after": None, "state": found["left"]}


def bridgeless(path: Path, ending: Any, rng: np.random.Generator) -> dict[str, Any]:
    """The rosbridge goes away."""
    from stancekit.envs.worlds.ros import RosWorld
    from stancekit.envs.worlds.ros_setup import same_names
    from tests.emulators.rosbridge import RosBridge

    accepted, at_s = Accepted.from_file(path), float(rng.uniform(BEGIN_S, LATEST_S))
    robot = accepted.plan.course.robot
    joints = joint_names(robot)
    with RosBridge(joints, first_pose(accepted)) as bridge:
        setup = same_names(joints, port=bridge.port)

        def gone(targets: Array) -> Array:
            threading.Thread(target=bridge.inject, args=("rosbridge gone",)).start()
            return targets

        runner = FaultyRunner(
            RosWorld(robot, setup), dry=False, settings=RunSettings(hung=True, ending=ending), at_s=at_s, fault=gone,
        )  # fmt: skip
        found = outcome(runner, accepted)
        stop = found["over_s"] - runner.happened_s if found["stopped"] and runner.happened_s is not None else None
        return found | {"stop_s": stop, "after": None, "state": "controller holds its last target"}


def first_pose(accepted: Accepted) -> Array:
    """Angles at the beginning of the plan's motion."""
    return Runner(MemoryWorld()).prepare(accepted).first.angles_rad


def servos(state: dict[str, Any]) -> str:
    """The state of the servos in a few words."""
    kinds = Counter[str]()
    for torque, watchdog, powered in zip(state["torque"], state["watchdog"], state["powered"], strict=True):
        kinds[
            "no power" if not powered else "torque off" if not torque else "watchdog" if watchdog == 255 else "held"
        ] += 1
    moving = max(abs(rate) for rate in state["rate_rad_s"]) > 0.02
    return ", ".join(f"{count} {what}" for what, count in sorted(kinds.items())) + (", MOVING" if moving else "")


def table(kind: str, runs: list[dict[str, Any]]) -> str:
    """A few lines for one kind."""
    stopped = sum(run["stopped"] for run in runs)
    stops = [run["stop_s"] for run in runs if run.get("stop_s") is not None]
    lines = [f"{kind}: {stopped} of {len(runs)} stopped, {sum(not run['moved'] for run in runs)} before any motion"]
    if stops:
        lines.append(f"  stop: median {np.median(stops):.3f} s, worst {max(stops):.3f} s")
    counted = [run["after"] for run in runs if run["after"] is not None]
    lines.append(f"  commands after the stop: {sum(counted) if counted else 'not counted for this kind'}")
    left = Counter(f"{run['left']} ({run['state']})" if "state" in run else run["left"] for run in runs)
    lines += [f"  left: {count} × {state}" for state, count in left.most_common(5)]
    lines.append(f"  e.g. {next((run['message'] for run in runs if run['message']), 'it went on')}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
