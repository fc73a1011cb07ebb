"""Runs on a bus whose packets are ROBOTIS' own code: what is wrong with it, what stops it, and what
moves after.

    python benchmarks/servo_bus.py FOLDER [--sources CLONES] [--count 3] [--realtime] [--only NAME …]
        [--tell]

``tests/emulators/robotis`` is 24 servos on a pseudo-terminal; framing, CRC, stuffing, pings and
status packets are those of Dynamixel2Arduino, fetched by name with git, or taken from --sources, a
folder of bare clones ``owner+name/repo``. Every run has a fresh bus, and is a process with
``stancekit run --arm`` of the course of docs/running-on-a-robot.md, shortened to some seconds. A
fault comes before the run, or ``AT_S`` after the first motion. Motions are read from the servos'
own log. Results go to FOLDER/results.jsonl, and what is there is not run again; --tell prints the
table alone.

fastest: of all joints at all times [rad/s]. after: motion [rad] after the process had ended, which
is after its report, and after the servos' watchdog time where it was killed. exit: its code.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import ROOT, Lines, Options, launch, realtime
from _device_runs import ended, forked, planned, rows, running, said, wait

from stancekit.planners.formats.motion_file import read_motion
from stancekit.runner.worlds.dynamixel.control_table import nominal
from tests.emulators.devices import shafts, start_of

HERE = ROOT / "tests" / "emulators" / "robotis"
SOURCE = "ROBOTIS-GIT/Dynamixel2Arduino"
AT_S = 1.0
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
    results = Lines(folder / "results.jsonl")
    if not arguments.tell:
        build(folder, arguments.sources)
        plan = planned(folder)
        names, start = start_of(plan)
        calibration = nominal(
            read_motion(plan)[0].robot,
            port=str(folder / "bus"),
            desk=True,
            watchdog_s=WATCHDOG_S,
        )
        calibration.write(folder / "servos.yaml")
        stand = ",".join(f"{angle:.5f}" for angle in shafts(calibration, names, start))
        for case in CASES:
            if arguments.only and not case.fault.startswith(arguments.only):
                continue
            for key in (f"{case.fault} {k}" for k in range(arguments.count)):
                if key not in results.rows:
                    print(line(results.add(key, run(case, folder, stand))), flush=True)
    return told(list(results.rows.values()))


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
    command = ["g++", "-O1", "-std=c++17", f"-I{HERE / 'stub'}", f"-I{code}", *map(str, files)]
    subprocess.run([*command, "-o", str(folder / "robotis_bus"), "-lutil"], check=True)


def run(case: Case, folder: Path, stand: str) -> dict[str, Any]:
    """Row of one run of a case, on a fresh bus."""
    log = folder / "bus.log"
    for name in ("bus", "bus.log", "run.mcap"):
        (folder / name).unlink(missing_ok=True)
    fast = case.fault == "no fast sync read"  # which the firmware should have, and has not
    command = [str(folder / "robotis_bus"), "bus", "48" if fast else "44", stand, "bus.log"]
    with subprocess.Popen(command, cwd=folder, stdin=subprocess.PIPE, text=True) as bus:
        assert bus.stdin is not None
        wait(lambda: (folder / "bus").is_symlink() and len(rows(log)) > 0)
        if case.before and not fast:
            print(case.fault, file=bus.stdin, flush=True)
        began_s, happened_s = time.monotonic(), None
        words = ["run", str(folder / "desk.json"), "--world", "dynamixel", "--arm"]
        words += ["--setup", str(folder / "servos.yaml"), "--log", str(folder / "run.mcap")]
        host = forked(words, folder / "run")
        if not case.before and case.fault != "none":
            wait(lambda: moved(log) or not running(host))
            time.sleep(AT_S)
            happened_s = time.monotonic()
            if case.fault == "killed host":
                os.kill(host, signal.SIGKILL)
            else:
                print(case.fault, file=bus.stdin, flush=True)
        code, ended_s = ended(host), time.monotonic()
        time.sleep(AFTER_S)
        bus.stdin.close()
    text, verdict = said(folder / "run")
    quiet_s = ended_s + (WATCHDOG_S + 0.1 if case.fault == "killed host" else 0.0)
    motion = motions(log, happened_s, quiet_s)
    right = code in case.exits and bool(re.search(case.says, text))
    return {
        "fault": case.fault,
        "exit": code,
        "seconds": ended_s - began_s,
        "said": verdict,
        "load": os.getloadavg()[0],
        "right": right and motion["after"] <= LEAST_RAD and motion["fastest"] <= 3.2,
        **motion,
    }


def motions(log: Path, happened_s: float | None, quiet_s: float) -> dict[str, Any]:
    """Fastest joint, motion after a time, and how long after the fault the last motion was."""
    time_s, angles = np.split(rows(log), [1], axis=1)
    time_s = time_s[:, 0]
    step = max(1, round(WINDOW_S / max(1e-3, float(np.median(np.diff(time_s))))))
    speed = np.abs(angles[step:] - angles[:-step]).max(axis=1) / (time_s[step:] - time_s[:-step])
    late = time_s >= quiet_s
    after = float(np.ptp(angles[late], axis=0).max()) if late.any() else 0.0
    stop_s = None
    if happened_s is not None:
        still = np.abs(angles - angles[-1]).max(axis=1) > LEAST_RAD
        stop_s = max(0.0, float(time_s[still].max(initial=happened_s)) - happened_s)
    return {"fastest": float(speed.max(initial=0.0)), "after": after, "stop_s": stop_s}


def moved(log: Path) -> bool:
    """Whether a shaft has left its first place."""
    seen = rows(log)
    return len(seen) > 1 and bool(np.abs(seen[-1, 1:] - seen[0, 1:]).max() > MOVED_RAD)


def line(row: dict[str, Any]) -> str:
    """One run for people."""
    stop = "" if row["stop_s"] is None else f" stop {row['stop_s']:.2f} s"
    return (
        f"{'right' if row['right'] else 'WRONG'} {row['fault']:18} exit {row['exit']:3} fastest {row['fastest']:.2f} "
        f"rad/s after {1e3 * row['after']:.1f} mrad{stop} load {row['load']:.0f}: {row['said']:.150}"
    )


def told(seen: list[dict[str, Any]]) -> int:
    """Print the table; 1 where a run was not as it should be."""
    for fault in dict.fromkeys(row["fault"] for row in seen):
        some = [row for row in seen if row["fault"] == fault]
        stops = [row["stop_s"] for row in some if row["stop_s"] is not None]
        print(
            f"{fault:18} {sum(row['right'] for row in some)} of {len(some)} right  "
            f"exit {sorted({row['exit'] for row in some})}  fastest {max(row['fastest'] for row in some):.2f} rad/s  "
            f"after {1e3 * max(row['after'] for row in some):.1f} mrad  "
            + (f"stop {max(stops):.2f} s  " if stops else "")
            + f"{some[0]['said']:.120}"
        )
    wrong = sum(not row["right"] for row in seen)
    print(
        f"{len(seen)} runs, {wrong} not as they should be, load {np.median([row['load'] for row in seen] or [0]):.0f}"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
