"""Runs on the real ROS 1 robot that tests/emulators/ros1/build.py builds: what is wrong with it,
what stops it, and what moves after.

    python benchmarks/ros1.py FOLDER [--kinds faults healthy odd] [--count 3] [--only NAME …] [--tell]
    python benchmarks/ros1.py FOLDER --stand PLAN

Every run has a fresh robot and a fresh rosbridge, and is a process with ``stancekit run --arm`` of
a plan of some seconds. A fault comes ``AT_S`` after the robot's first motion, or before the run.
Motions, and when they were, are read from the joints' own log, 250 times a second. Results go to
FOLDER/results.jsonl, and what is there is not run again; --tell prints the tables alone. fastest:
of all joints at all times. after: motion [rad] after the process had ended, which is after its
report. off: of the joint farthest from the plan's end, where the exit code is 0.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import xmlrpc.client
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import ROOT, Lines, Options, launch
from _device_runs import ended, forked, planned, rows, running, said, wait

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.robot_file import Servo
from stancekit.runner.log import read_log
from stancekit.runner.worlds.ros.joint_states import same_names
from tests.emulators.devices import start_of
from tests.emulators.ros1.build import PYTHON

NODES = ROOT / "tests" / "emulators" / "ros1" / "nodes.py"
MASTER, PORT = 11411, 9190
STAND_MASTER, STAND_PORT = 11311, 9090
AT_S = 2.0
MOVES_RAD_S = 0.02
LEAST_RAD = 2e-3
"""Less is the end of a lag, and no motion."""
GOAL_RAD = 0.1
"""How far a run may end from its plan."""
COMMAND = "/joint_trajectory_controller/command"
Kind = Literal["faults", "healthy", "odd"]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A set-up, and what happens to it. act: does it, and is told so after ``AT_S``; before: a node
    that is there from the beginning; lead_s: that ``act`` is begun earlier; after_s: that is looked
    on at the end; setup: of the file; states_hz, shuffled, remap, namespace, rosapi, estop: of the
    robot; options: of the command; exits: codes that are right.
    """

    name: str
    act: Callable[[Robot, int], None] | None = None
    before: Sequence[str] = ()
    node: Sequence[str] = ()
    after_s: float = 1.0
    setup: dict[str, Any] = field(default_factory=dict)
    states_hz: float = 50.0
    shuffled: bool = False
    remap: str = ""
    namespace: str = ""
    rosapi: bool = True
    estop: str = "regular"
    options: Sequence[str] = ()
    exits: tuple[int, ...] = (1,)


class Robot:
    """The processes of a robot in a folder, and nodes beside it."""

    def __init__(self, folder: Path, master: str, prefix: str = "") -> None:
        self.folder, self._prefix = folder, prefix
        paths = f"{folder / 'py'}"
        self.environment = os.environ | {
            "PYTHONPATH": paths,
            "ROS_MASTER_URI": master,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder / "home"),
            "ROS_LOG_DIR": str(folder / "log"),
            "ROS_PACKAGE_PATH": f"{folder / 'src'}:/usr/share",
        }
        (folder / "log").mkdir(exist_ok=True)
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def start(self, name: str, *words: str) -> subprocess.Popen[str]:
        """Start a process; its output goes to a file, but for a node's."""
        pipe = subprocess.PIPE if words[1:] and words[1] == str(NODES) else None
        with (self.folder / "log" / f"{self._prefix}{name}.out").open("w") as output:
            self.processes[name] = subprocess.Popen(
                words,
                env=self.environment,
                stdin=subprocess.PIPE,
                stdout=pipe or output,
                stderr=output,
                start_new_session=True,
                text=True,
                cwd=self.folder,
            )
        return self.processes[name]

    def node(self, name: str, *words: str) -> None:
        """Start a node of ``nodes.py``, and wait until it is there."""
        child = self.start(name, PYTHON, str(NODES), *words)
        assert child.stdout is not None
        assert child.stdout.readline().strip() == "ready", name

    def tell(self, name: str, word: str) -> None:
        """Give a node a line, and wait until it has done it."""
        child = self.processes[name]
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(f"{word}\n")
        child.stdin.flush()
        child.stdout.readline()

    def send(self, name: str, number: int) -> None:
        """Send a process a signal."""
        self.processes[name].send_signal(number)

    def freeze(self, name: str, seconds: float) -> None:
        """Let a process stand still, while this one goes on."""
        pid = self.processes[name].pid
        os.kill(pid, signal.SIGSTOP)
        subprocess.Popen(["sh", "-c", f"sleep {seconds}; kill -CONT {pid}"], start_new_session=True)

    def end(self, *names: str) -> None:
        """End processes."""
        for name in names:
            if (child := self.processes.pop(name, None)) is not None:
                child.kill()
                child.wait()


def pressed(robot: Robot, host: int) -> None:
    """The e-stop."""
    robot.tell("estop", "press")


FAULTS = (
    Case(name="Ctrl-C", act=lambda robot, host: os.kill(host, signal.SIGINT)),
    Case(name="SIGTERM", act=lambda robot, host: os.kill(host, signal.SIGTERM)),
    Case(name="kill -9", act=lambda robot, host: os.kill(host, signal.SIGKILL), exits=(-9,)),
    Case(name="host stands still 1 s", act=lambda robot, host: stopped(host, 1.0)),
    Case(name="e-stop pressed", act=pressed),
    Case(name="e-stop node killed", act=lambda robot, host: robot.end("estop"), after_s=1.5),
    Case(name="e-stop of nobody", setup={"estop": "/e_stopp"}, exits=(2,)),
    Case(name="e-stop of another type", estop="int8", exits=(2,)),
    Case(name="rosbridge killed", act=lambda robot, host: robot.send("bridge", signal.SIGKILL)),
    Case(
        name="rosbridge frozen 4 s",
        act=lambda robot, host: robot.freeze("bridge", 4.0),
        after_s=6.0,
    ),
    Case(
        name="rosbridge frozen 1 s",
        act=lambda robot, host: robot.freeze("bridge", 1.0),
        after_s=3.0,
    ),
    Case(name="robot killed", act=lambda robot, host: robot.send("robot", signal.SIGKILL)),
    Case(name="robot frozen 1 s", act=lambda robot, host: robot.freeze("robot", 1.0), after_s=3.0),
    Case(name="joint stuck", node=("stuck", "9"), exits=(0, 1)),
    Case(name="zeros from the beginning", before=("states", "zeros", "25", "60"), exits=(2,)),
    Case(name="zeros", node=("states", "zeros", "25", "6")),
    Case(name="shifted by 0.2 rad", node=("states", "shifted", "30", "6")),
    Case(name="NaN", node=("states", "nan", "30", "6")),
    Case(name="another client's goal", node=("goal", "0.2"), after_s=4.0, exits=(0, 1)),
    Case(name="another client's stream", node=("commands", "2"), exits=(0, 1), after_s=2.0),
    Case(name="controller switched off", node=("switch",)),
    Case(name="ROS 2 in the setup", setup={"ros": 2}, exits=(2,)),
    Case(name="commands reach nobody", remap=f"{COMMAND}:=/nobody", exits=(2,)),
    Case(
        name="commands are heard after 4 s",
        before=("late", "4"),
        remap=f"{COMMAND}:=/late",
        exits=(0,),
    ),
    Case(
        name="commands are missed at first",
        before=("late", "0", "2"),
        remap=f"{COMMAND}:=/late",
        exits=(0,),
    ),
)
HEALTHY = (Case(name="healthy", exits=(0,)),)
ODD = (
    Case(name="states at 10 Hz", states_hz=10.0, exits=(0,)),
    Case(name="names shuffled", shuffled=True, exits=(0,)),
    Case(name="wheels beside it", before=("states", "wheels", "30", "120"), exits=(0,)),
    Case(name="e-stop says something when pressed alone", estop="quiet", exits=(0,)),
    Case(
        name="stamps of 0",
        before=("relay", "unstamped", "/states"),
        setup={"joint_states": "/states"},
        exits=(0,),
    ),
    Case(
        name="clock 2 s off",
        before=("relay", "old", "/states"),
        setup={"joint_states": "/states"},
        exits=(0,),
    ),
    Case(
        name="a namespace",
        namespace="/robot1",
        exits=(0,),
        setup={
            "joint_states": "/robot1/joint_states",
            "controller": "/robot1/joint_trajectory_controller",
        },
    ),
    Case(name="no rosapi", rosapi=False, exits=(0,)),
)
CASES: dict[Kind, tuple[Case, ...]] = {"faults": FAULTS, "healthy": HEALTHY, "odd": ODD}


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Options of the script."""

    folder: Annotated[Path, tyro.conf.Positional]
    """What tests/emulators/ros1/build.py built."""
    kinds: tuple[Kind, ...] = ("faults", "healthy", "odd")
    count: int = 3
    """Runs per case."""
    only: tuple[str, ...] = ()
    """Names of cases; all where none is named."""
    tell: bool = False
    """Print what is there, and run nothing."""
    stand: Path | None = None
    """A plan: let a robot stand as it begins, behind a rosbridge on port 9090, until Ctrl-C, and
    run nothing. Lines on standard input, ``press`` and ``release``, are for its e-stop."""
    load: float = 3.0
    """Wait before every run until the machine's load is no more than this, but no longer than
    ``patience_s``."""
    patience_s: float = 60.0
    rate_hz: float = 50.0
    """Commands, joint states and states of the controller per second; a busy machine wants
    fewer."""


def main(arguments: Arguments) -> None:
    """Run what is not there yet, and print the tables."""
    signal.signal(
        signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM)
    )  # and leave no process behind
    folder = arguments.folder.resolve()
    if arguments.stand is not None:
        stand(folder, arguments.stand, arguments.rate_hz)
        return
    results = Lines(folder / "results.jsonl")
    if not arguments.tell:
        plan = planned(folder)
        with ExitStack() as stack:
            robot = Robot(folder, f"http://127.0.0.1:{MASTER}")
            stack.callback(lambda: robot.end(*list(robot.processes)))
            robot.start("master", PYTHON, "/usr/bin/rosmaster", "--core", "-p", str(MASTER))
            opened(MASTER)
            for index in range(arguments.count):
                for case in [case for kind in arguments.kinds for case in CASES[kind]]:
                    key = f"{case.name} {index}"
                    if (arguments.only and case.name not in arguments.only) or key in results.rows:
                        continue
                    before = quiet(arguments.load, arguments.patience_s)
                    row = tried(robot, case, plan, arguments.rate_hz)
                    row |= {"load": max(before, os.getloadavg()[0])}
                    if not row["right"]:
                        keep(robot, key)
                    results.add(key, row)
                    arguments.say(row)
    for kind in arguments.kinds:
        print(table(CASES[kind], list(results.rows.values())))


def quiet(load: float, patience_s: float) -> float:
    """Wait for the machine; its load then."""
    end = time.monotonic() + patience_s
    while os.getloadavg()[0] > load and time.monotonic() < end:
        time.sleep(1.0)
    return os.getloadavg()[0]


def keep(robot: Robot, name: str) -> None:
    """Keep what a run that went wrong left behind: its log and output, and what the robot's
    processes said.
    """
    kept = robot.folder / "kept" / re.sub(r"\W+", "-", name)
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(robot.folder / "run", kept)
    shutil.copy(robot.folder / "motions.txt", kept)
    for process in robot.processes:
        shutil.copy(robot.folder / "log" / f"{process}.out", kept)


def tried(robot: Robot, case: Case, plan: Path, rate_hz: float) -> dict[str, Any]:
    """One run, with a fresh robot and a fresh rosbridge."""
    names, start = start_of(plan)
    order = (
        np.random.default_rng(3).permutation(len(names)) if case.shuffled else np.arange(len(names))
    )
    robot.end(*(robot.processes.keys() - {"master", "rosapi", "estop"}))
    motions = robot.folder / "motions.txt"
    motions.unlink(missing_ok=True)
    describe(robot, case, [names[k] for k in order], start[order], motions, rate_hz)
    begun(robot, case, PORT)
    wait(lambda: written(motions))
    time.sleep(1.0)
    if case.before:
        robot.node("before", *case.before)
    if case.node and case.node[0] != "states":
        robot.node("node", *case.node)
    folder = robot.folder / "run"
    folder.mkdir(exist_ok=True)
    settings = {"ros": 1, "port": PORT, "estop": "/e_stop"} | case.setup
    same_names(names, **settings).write(folder / "ros.yaml")
    (folder / "run.mcap").unlink(missing_ok=True)
    words = ["run", str(plan), "--world", "ros", "--arm", "--rate-hz", str(rate_hz)]
    words += ["--setup", str(folder / "ros.yaml")]
    began_s = time.time()
    host = forked([*words, "--log", str(folder / "run.mcap"), *case.options], folder / "run")
    acted_s = acted(robot, case, host, motions)
    code, over_s = ended(host), time.time()
    time.sleep(case.after_s)
    if case.estop != "regular":
        robot.end("estop")
    return judged(case, code, (began_s, acted_s, over_s), motions, order, folder)


def begun(robot: Robot, case: Case, port: int) -> None:
    """Start a robot that was described, and a rosbridge, and what is beside them."""
    robot.start(
        "robot",
        str(robot.folder / "robot_hw"),
        f"__ns:={case.namespace or '/'}",
        *case.remap.split(),
    )
    robot.start(
        "bridge", PYTHON, "rosbridge_websocket.py", "--address", "127.0.0.1", "--port", str(port)
    )
    if case.rosapi and "rosapi" not in robot.processes:
        robot.start("rosapi", PYTHON, "rosapi_node")
    if not case.rosapi:
        robot.end("rosapi")
    standing = robot.processes.get("estop")
    if standing is None or case.estop != "regular" or standing.poll() is not None:
        robot.end("estop")
        robot.node("estop", "estop", case.estop)
    robot.tell("estop", "release") if case.estop == "regular" else None
    opened(port)


def stand(folder: Path, plan: Path, rate_hz: float) -> None:
    """A robot that stands as a plan begins, behind a rosbridge, until somebody ends it."""
    names, start = start_of(plan)
    robot = Robot(folder, f"http://127.0.0.1:{STAND_MASTER}", "stand-")
    with ExitStack() as stack:
        stack.callback(lambda: robot.end(*list(robot.processes)))
        robot.start("master", PYTHON, "/usr/bin/rosmaster", "--core", "-p", str(STAND_MASTER))
        opened(STAND_MASTER)
        motions = folder / "stand-motions.txt"
        motions.unlink(missing_ok=True)
        describe(robot, HEALTHY[0], names, start, motions, rate_hz)
        begun(robot, HEALTHY[0], STAND_PORT)
        wait(lambda: written(motions))
        print(json.dumps({"port": STAND_PORT, "ros": 1, "estop": "/e_stop"}), flush=True)
        for line in sys.stdin:  # press, release
            robot.tell("estop", line.strip())
        with suppress(KeyboardInterrupt):
            signal.pause()


def describe(
    robot: Robot, case: Case, names: Sequence[str], start: Array, motions: Path, rate_hz: float
) -> None:
    """The robot's parameters, at the master."""
    master = xmlrpc.client.ServerProxy(robot.environment["ROS_MASTER_URI"])
    limit = "<limit lower='-3' upper='3' effort='10' velocity='10'/>"
    joints = "".join(
        f"<link name='l{k}'/><joint name='{name}' type='revolute'><parent link='base'/><child link='l{k}'/>"
        f"<axis xyz='0 0 1'/>{limit}</joint>"
        for k, name in enumerate(names)
    )
    space = case.namespace
    constraints = {"goal_time": 0.6, "stopped_velocity_tolerance": 0.05}
    tolerances = {name: {"trajectory": 0.5, "goal": 0.1} for name in names}
    for key, value in {
        "/robot_description": f"<robot name='r'><link name='base'/>{joints}</robot>",
        f"{space}/hw": {
            "joints": list(names),
            "start": start.tolist(),
            "log": str(motions),
            "rate_hz": 5.0 * rate_hz,
        },
        f"{space}/joint_state_controller": {
            "type": "joint_state_controller/JointStateController",
            "publish_rate": min(case.states_hz, rate_hz),
        },
        f"{space}/joint_trajectory_controller": {
            "type": "position_controllers/JointTrajectoryController",
            "joints": list(names),
            "state_publish_rate": rate_hz,
            "constraints": constraints | tolerances,
        },
    }.items():
        master.setParam("/ros1.py", key, value)  # type: ignore[arg-type]


def acted(robot: Robot, case: Case, host: int, motions: Path) -> float | None:
    """Let the fault happen; when it did, None where the run ended before."""
    first_s = None
    with motions.open() as log:
        log.seek(0, os.SEEK_END)
        while first_s is None and running(host):
            time.sleep(0.05)
            heads = [line.split(" ", 2)[:2] for line in log.readlines()]
            moved = [head[0] for head in heads if len(head) == 2 and float(head[1]) > MOVES_RAD_S]
            first_s = float(moved[0]) if moved else None
    if first_s is None or not (case.act or case.node):
        return first_s
    while time.time() < first_s + AT_S and running(host):
        time.sleep(0.005)
    acted_s = time.time()
    if case.act is not None:
        case.act(robot, host)
    elif case.node[0] == "states":
        robot.node("node", *case.node)
        acted_s = time.time()
    else:
        robot.tell("node", "now")
    return acted_s


def judged(
    case: Case,
    code: int,
    times_s: tuple[float, float | None, float],
    motions: Path,
    order: Array,
    folder: Path,
) -> dict[str, Any]:
    """What came of it, by the joints' own log."""
    began_s, acted_s, over_s = times_s
    seen = rows(motions)
    text, verdict = said(folder / "run")
    ours = seen[seen[:, 0] > began_s]
    after = ours[ours[:, 0] > over_s]
    moved = 0.0 if len(after) < 2 else float(np.ptp(after[:, 2:], axis=0).max())
    still = ours[ours[:, 1] > MOVES_RAD_S]
    off = None
    if code == 0:
        sent = [entry["planned_rad"] for entry in read_log(folder / "run.mcap").of("command")]
        off = float(np.abs(np.asarray(sent[-1])[order] - ours[-1, 2:]).max())
    fault = case.act is not None or bool(case.node)
    return {
        "case": case.name,
        "exit": code,
        "right": code in case.exits,
        "fastest": float(ours[:, 1].max()),
        "stopped_s": over_s - acted_s if fault and acted_s is not None else None,
        "still_s": float(still[-1, 0]) - acted_s
        if fault and acted_s is not None and len(still)
        else None,
        "moved": bool(len(still)),
        "after": moved,
        "said": any(word in text for word in ("may still", "still moves")),
        "off": off,
        "message": verdict,
    }


def table(cases: Sequence[Case], done: Sequence[dict[str, Any]]) -> str:
    """One line per case."""
    lines = [
        "| case | runs | load | exit | fastest [rad/s] | at rest after [s] | moved after [rad] | off [rad] | says |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|---|")
    for case in cases:
        found = [row for row in done if row["case"] == case.name]
        if not found:
            continue
        codes = [row["exit"] for row in found]
        exits = ", ".join(f"{codes.count(code)} × {code}" for code in sorted(set(codes)))
        still = [max(row["still_s"], 0.0) for row in found if row["still_s"] is not None]
        off = [row["off"] for row in found if row["off"] is not None]
        silent = [row["after"] for row in found if not row["said"] and row["exit"] >= 0]
        columns = (
            case.name,
            len(found),
            f"{max(row['load'] for row in found):.1f}",
            exits,
            f"{max(row['fastest'] for row in found):.2f}",
            f"{max(still):.2f}" if still else "",
            f"{max(silent, default=0.0):.3f}",
            f"{max(off):.3f}" if off else "",
            min(found, key=lambda row: row["right"])["message"][:160].replace("|", "/"),
        )
        lines.append(f"| {' | '.join(map(str, columns))} |")
    ours = [row for row in done if row["case"] in {case.name for case in cases}]
    limit = Servo().velocity_rad_s
    quiet = [
        row for row in ours if not row["said"] and row["exit"] >= 0 and row["case"] not in FOREIGN
    ]
    bad = {
        f"faster than {limit:g} rad/s": sum(row["fastest"] > limit for row in ours),
        "moved after a report that does not say so": sum(row["after"] > LEAST_RAD for row in quiet),
        f"exit 0 more than {GOAL_RAD:g} rad off": sum(
            (row["off"] or 0.0) > GOAL_RAD for row in ours
        ),
        f"another exit code than expected, {sum(starved(row) for row in ours)} of them for want of a processor": sum(
            not row["right"] for row in ours
        ),
    }
    return "\n".join(
        [
            *lines,
            "",
            f"{len(ours)} runs: " + "; ".join(f"{count} {what}" for what, count in bad.items()),
        ]
    )


def starved(row: dict[str, Any]) -> bool:
    """Whether a run ended otherwise than it should because the machine, at a load of more than its
    processors, did not let a process run in time.
    """
    late = ("host watchdog", "host was silent", "nothing heard for")
    return (
        not row["right"]
        and row["load"] > (os.cpu_count() or 1)
        and any(word in row["message"] for word in late)
    )


FOREIGN = {"another client's goal", "another client's stream"}
"""Where somebody else goes on moving the robot."""


def stopped(host: int, seconds: float) -> None:
    """Let a process stand still."""
    os.kill(host, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(host, signal.SIGCONT)


def written(motions: Path) -> bool:
    """Whether the joints have begun to write."""
    return motions.exists() and motions.stat().st_size > 5000


def opened(port: int) -> None:
    """Wait until somebody listens."""

    def listens() -> bool:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
            return True
        return False

    wait(listens)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
