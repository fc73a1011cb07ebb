"""Runs on a bus whose packets are ROBOTIS' own code: what is wrong with it, what stops it, and what
moves after.

    python benchmarks/robot/servo_bus.py FOLDER [--sources CLONES] [--emulated] [--count 3]
    [--realtime] [--only NAME …]
        [--tell]

``robotis_bus.cpp`` beside this file is 24 servos on a pseudo-terminal; framing, CRC, stuffing,
pings and status packets are those of Dynamixel2Arduino, fetched by name with git, or taken from
--sources, a folder of bare clones ``owner+name/repo``. --emulated runs the same faults on
``stancekit emulate bus``. Every run has a fresh bus, and is a process with ``stancekit run --arm``
of the course of docs/running-on-a-robot.md, shortened to some seconds. A fault comes before the
run, or ``AT_S`` after the first motion. Motions are read from the servos' own log. Results go to
FOLDER/results.jsonl, and what is there is not run again; --tell prints the table alone.

fastest: of all joints at all times [rad/s]. after: motion [rad] after the process had ended, which
is after its report, and after the servos' watchdog time where it was killed. exit: its code.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))
from _bench import ROOT, Options, launch, realtime

from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text
from stancekit.runner.emulators.start import start_of
from stancekit.runner.worlds.dynamixel.calibration import Calibration, nominal

HERE = Path(__file__).parent
SOURCE = "ROBOTIS-GIT/Dynamixel2Arduino"
AT_S = 1.0
LONGEST_S = 120.0
AFTER_S = 1.0
WATCHDOG_S = 0.2
MOVED_RAD = 0.02
LEAST_RAD = 5e-3
"""Less is the end of a servo's lag, and no motion."""
WINDOW_S = 0.1
"""Speeds are means over so long."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A fault, when it comes, and what is right.

    before: it is there from the beginning. exits: codes that are right; says: pattern of the line
    that is right.
    """

    fault: str
    before: bool = False
    exits: tuple[int, ...] = (1,)
    says: str = ""


CASES = (
    Case(fault="none", exits=(0,), says="run as planned"),
    Case(fault="no fast sync read", before=True, exits=(0,), says="run as planned"),
    Case(fault="echo", before=True, exits=(0,), says="run as planned"),
    Case(fault="garbage", before=True, exits=(0,), says="run as planned"),
    Case(fault="status return 1", before=True, exits=(0,), says="run as planned"),
    Case(
        fault="delay",
        before=True,
        exits=(2,),
        says=r"servo 1 \(LF_yaw\) answers after \d+ ms, latency_ms",
    ),
    Case(
        fault="silent servo 4", says=r"servo 4 \(LF_knee\): no answer; is it connected and powered"
    ),
    Case(
        fault="overload 4",
        says=r"servo 4 \(LF_knee\): overload; its torque is off until it is rebooted",
    ),
    Case(fault="reboot 4", says=r"servo 4 \(LF_knee\): its torque went off: did it restart"),
    Case(fault="power loss", says="has the bus power"),
    Case(fault="cable pulled", says="is the cable in"),
    Case(fault="jumping values 4", says=r"servo 4 \(LF_knee\): measured to jump 0\.[5-7]\d rad"),
    Case(
        fault="stale values 4", says=r"servo 4 \(LF_knee\): (its values are old|measured to turn)"
    ),
    Case(fault="killed host", exits=(-signal.SIGKILL,)),
)
"""12 faults, and two runs without one: a bus as it should be, and one that only lacks Fast Sync
Read."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Options of the script."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Where it is built, and its results are."""
    sources: Path | None = None
    """Bare clones, owner+name/repo, in place of the network."""
    emulated: bool = False
    """Run on the emulated bus in place of ROBOTIS' packets."""
    count: int = 3
    """Runs of each case."""
    realtime: bool = False
    """A real-time priority (SCHED_FIFO, as root) for host and bus, as a robot's host has."""
    only: tuple[str, ...] = ()
    """Cases, by the beginnings of their names."""
    tell: bool = False
    """Print the table of what is there."""


def main(arguments: Arguments) -> int:
    """Build, run, print; 1 where a run was not as it should be."""
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    realtime(arguments.realtime)
    results = folder / ("emulated.jsonl" if arguments.emulated else "results.jsonl")
    if not arguments.tell:
        if not arguments.emulated:
            build(folder, arguments.sources)
        prepare(folder)
    there = rows_of(results)
    for case in CASES:
        if arguments.only and not case.fault.startswith(arguments.only):
            continue
        for k in range(
            sum(row["fault"] == case.fault for row in there),
            0 if arguments.tell else arguments.count,
        ):
            row = run(case, folder, arguments.emulated) | {"run": k, "load": os.getloadavg()[0]}
            with results.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(line(row), flush=True)
    return told(rows_of(results))


def build(folder: Path, sources: Path | None) -> None:
    """Compile ``robotis_bus`` with ROBOTIS' sources, where that is not done."""
    if (folder / "robotis_bus").exists():
        return
    clone = folder / "dynamixel2arduino"
    if not clone.exists():
        origin = (
            f"https://github.com/{SOURCE}"
            if sources is None
            else str(sources / SOURCE.replace("/", "+") / "repo")
        )
        subprocess.run(["git", "clone", "--quiet", "--depth", "1", origin, str(clone)], check=True)
    code = clone / "src"
    files = [
        HERE / "robotis_bus.cpp",
        code / "utility" / "slave.cpp",
        code / "dxl_c" / "protocol.cpp",
    ]
    command = ["g++", "-O1", "-std=c++17", f"-I{HERE / 'bus_stub'}", f"-I{code}", *map(str, files)]
    subprocess.run([*command, "-o", str(folder / "robotis_bus"), "-lutil"], check=True)


def prepare(folder: Path) -> None:
    """Plan the page's course, shortened, and write a calibration file, where that is not done."""
    plan = folder / "desk.json"
    if not plan.exists():
        page = (ROOT / "docs" / "running-on-a-robot.md").read_text()
        found = re.search(r"<!-- file: desk.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
        assert found is not None, "the page has a course"
        text = (
            found[1].replace("frames: 6", "frames: 3").replace("goal_m: [0.10,", "goal_m: [0.04,")
        )
        write_text(folder / "desk.yaml", text)
        command = [
            sys.executable,
            "-m",
            "stancekit.cli.main",
            "plan",
            "desk.yaml",
            "--out",
            "desk.json",
        ]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    names, _ = start_of(plan)
    nominal(names, port="bus", desk=True, watchdog_s=WATCHDOG_S).write(folder / "servos.yaml")


@contextmanager
def robotis(folder: Path, case: Case) -> Iterator[IO[str]]:
    """Standard input of a fresh bus of ROBOTIS' packets."""
    names, angles = start_of(folder / "desk.json")
    shafts = Calibration.from_yaml(folder / "servos.yaml", names).shafts(names, angles)
    firmware = "48" if case.fault == "no fast sync read" else "44"
    command = [
        str(folder / "robotis_bus"),
        "bus",
        firmware,
        ",".join(f"{x:.5f}" for x in shafts),
        "bus.log",
    ]
    with subprocess.Popen(command, cwd=folder, stdin=subprocess.PIPE, text=True) as bus:
        assert bus.stdin is not None
        wait(lambda: (folder / "bus").is_symlink() and len(shafts_of(folder)[0]) > 0)
        yield bus.stdin
        bus.stdin.close()


@contextmanager
def emulated(folder: Path) -> Iterator[IO[str]]:
    """Standard input of a fresh emulated bus; a thread keeps the log that the other bus keeps
    itself.
    """
    from threading import Event, Thread

    from stancekit.runner.emulators.servo_bus import EmulatedBus

    names, angles = start_of(folder / "desk.json")
    shafts = Calibration.from_yaml(folder / "servos.yaml", names).shafts(names, angles)
    over, path = Event(), folder / "bus"
    with EmulatedBus(position_rad=shafts.tolist()) as bus, (folder / "bus.log").open("w") as log:

        def follow() -> None:
            while not over.wait(4e-3):
                at = bus.state()["position_rad"]
                print(f"{time.monotonic():.4f}", *(f"{x:.5f}" for x in at), file=log, flush=True)

        keeper = Thread(target=follow)
        keeper.start()
        path.unlink(missing_ok=True)
        path.symlink_to(bus.path)
        yield Faults(bus.inject)  # type: ignore[misc]  # a stream as far as it is used
        over.set()
        keeper.join()


@dataclass(frozen=True)
class Faults:
    """What is written is injected."""

    inject: Any

    def write(self, text: str) -> None:
        """Let a fault happen."""
        self.inject(text.strip())

    def flush(self) -> None:
        """Nothing waits."""


def run(case: Case, folder: Path, emulate: bool) -> dict[str, Any]:
    """Row of one run of a case."""
    for name in ("bus", "bus.log", "run.mcap"):
        (folder / name).unlink(missing_ok=True)
    with emulated(folder) if emulate else robotis(folder, case) as faults:
        injected = case.fault not in ("none", "killed host") and (
            emulate or case.fault != "no fast sync read"
        )
        if injected and case.before:
            faults.write(case.fault + "\n")
            faults.flush()
        began_s = time.monotonic()
        command = [
            sys.executable,
            "-m",
            "stancekit.cli.main",
            "run",
            "desk.json",
            "--world",
            "dynamixel",
        ]
        command += ["--setup", "servos.yaml", "--arm", "--log", "run.mcap"]
        environment = os.environ | {"COLUMNS": "400"}
        host = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
            start_new_session=True,
        )
        happened_s = None
        if not case.before and case.fault != "none":
            wait(lambda: moved(folder) or host.poll() is not None)
            time.sleep(AT_S)
            happened_s = time.monotonic()
            if case.fault == "killed host":
                host.kill()
            else:
                faults.write(case.fault + "\n")
                faults.flush()
        try:
            text, _ = host.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            host.kill()
            text, _ = host.communicate()
        ended_s = time.monotonic()
        time.sleep(AFTER_S)
    said = [" ".join(each.split()) for each in text.splitlines() if each.strip()]
    quiet_s = ended_s + (WATCHDOG_S + 0.1 if case.fault == "killed host" else 0.0)
    row = {
        "fault": case.fault,
        "exit": host.returncode,
        "seconds": ended_s - began_s,
        "said": verdict(said),
        "left": next((each for each in said if each.startswith("robot left")), ""),
        "log": log_of(folder),
    } | motions(folder, happened_s, quiet_s)
    right = host.returncode in case.exits and bool(re.search(case.says, " ".join(said)))
    return row | {"right": right and row["after"] <= LEAST_RAD and row["fastest"] <= 3.2}


def verdict(said: list[str]) -> str:
    """The one line that says what came of a run."""
    errors = [each for each in said if each.startswith("stancekit: error")]
    place = next((k for k, each in enumerate(said) if each.startswith("verdict")), None)
    if errors or place is None:
        return errors[0] if errors else (said[-1] if said else "")
    return said[place] if "run as planned" in said[place] else said[place + 1]


def log_of(folder: Path) -> str:
    """State of the run's log: whole, cut off and readable up to there, or none."""
    from stancekit.runner.log import read_log

    path = folder / "run.mcap"
    return "none" if not path.exists() else "whole" if read_log(path).whole else "cut off"


def motions(folder: Path, happened_s: float | None, quiet_s: float) -> dict[str, float | None]:
    """Fastest joint, motion after a time, and how long after the fault the last motion was."""
    time_s, angles = shafts_of(folder)
    step = max(1, round(WINDOW_S / max(1e-3, float(np.median(np.diff(time_s))))))
    speed = np.abs(angles[step:] - angles[:-step]).max(axis=1) / (time_s[step:] - time_s[:-step])
    late = time_s >= quiet_s
    after = float(np.ptp(angles[late], axis=0).max()) if late.any() else 0.0
    stop_s = None
    if happened_s is not None:
        still = np.abs(angles - angles[-1]).max(axis=1) > LEAST_RAD
        stop_s = max(0.0, float(time_s[still].max(initial=happened_s)) - happened_s)
    return {"fastest": float(speed.max(initial=0.0)), "after": after, "stop_s": stop_s}


def shafts_of(folder: Path) -> tuple[Array, Array]:
    """Times and positions of all shafts in the bus's log, whole lines alone."""
    path = folder / "bus.log"
    text = path.read_text() if path.exists() else ""
    rows = [each.split() for each in text[: text.rfind("\n") + 1].splitlines()]
    table = np.array([row for row in rows if len(row) == len(rows[0])], dtype=float).reshape(
        -1, len((rows or [[""]])[0])
    )
    return table[:, 0], table[:, 1:]


def moved(folder: Path) -> bool:
    """Whether a shaft has left its first place."""
    _, angles = shafts_of(folder)
    return len(angles) > 1 and bool(np.abs(angles[-1] - angles[0]).max() > MOVED_RAD)


def wait(there: Any) -> None:
    """Until something is there."""
    until = time.monotonic() + LONGEST_S
    while not there() and time.monotonic() < until:
        time.sleep(0.05)


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Rows that are there."""
    return [json.loads(each) for each in path.read_text().splitlines()] if path.exists() else []


def line(row: dict[str, Any]) -> str:
    """One run for people."""
    stop = "" if row["stop_s"] is None else f" stop {row['stop_s']:.2f} s"
    return (
        f"{'right' if row['right'] else 'WRONG'} {row['fault']:18} exit {row['exit']:3} fastest {row['fastest']:.2f} "
        f"rad/s after {1e3 * row['after']:.1f} mrad{stop} load {row['load']:.0f}: {row['said']:.150}"
    )


def told(rows: list[dict[str, Any]]) -> int:
    """Print the table; 1 where a run was not as it should be."""
    for fault in dict.fromkeys(row["fault"] for row in rows):
        some = [row for row in rows if row["fault"] == fault]
        stops = [row["stop_s"] for row in some if row["stop_s"] is not None]
        print(
            f"{fault:18} {sum(row['right'] for row in some)} of {len(some)} right  "
            f"exit {sorted({row['exit'] for row in some})}  fastest {max(row['fastest'] for row in some):.2f} rad/s  "
            f"after {1e3 * max(row['after'] for row in some):.1f} mrad  "
            + (f"stop {max(stops):.2f} s  " if stops else "")
            + f"{some[0]['said']:.120}"
        )
    wrong = sum(not row["right"] for row in rows)
    print(
        f"{len(rows)} runs, {wrong} not as they should be, load {np.median([row['load'] for row in rows] or [0]):.0f}"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
