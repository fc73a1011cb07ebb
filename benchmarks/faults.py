"""Faults at random times of a run: what happened, how long until the stop, what was sent after it,
what state was left.

    python benchmarks/faults.py [--kinds "nan command" …] [--count 20] [--seed 0] [--log FILE]
    [--realtime] [--json]

The runner runs one step of the course ``walls``, and the fault happens while the joints move. Kinds
of the host and of the bus happen on 24 emulated servos in a process of their own, the robot hung in
a stand, at 50 Hz; half of the runs end in hold, half in torque off. A plan is edited by flipping
one bit of one of its two files, and handed to servos in memory. Feet slip in MuJoCo: all surfaces
lose 60 % of their friction. Faults of a rosbridge, and of what is behind it, happen on an emulated
one, half of them of ROS 1. Stops from outside (``stop_runs``) come from another process at random
times, half of them while the robot is armed, to the command ``stancekit run`` itself.

stop: from the fault until the ending was done, in simulation in simulated time; of stops from
outside, until the latch. after: commands that the device, the emulated robot or the simulation got
later than a control period of the bus (20 ms) after the latch (in simulation: after it), in most
kinds while the host goes on asking ten times more. late: the last command that the device got,
counted from the latch. written: commands that were on their way at the latch, and when their write
had returned, by the host's own count. left: what the runner says, or was asked for, and in brackets
what the device is in then; the simulation goes on for half a second with what it was told last.
--log keeps every finished run in FILE, as JSON lines, and takes those in there for done. --realtime
gives host and devices a real-time priority (SCHED_FIFO, as root): on a machine that is busy with
other things the rest finds those.
"""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch, realtime
from _fault_runs import FAULTS, OF_BRIDGE, behind_rosbridge, edited, first_pose, on_bus, slipped
from _stop_runs import STOPS, stopped

from stancekit.planners.files.arrays import Array
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted

KINDS = (*FAULTS, *STOPS)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which faults, and how often."""

    kinds: tuple[str, ...] = KINDS
    count: int = 20
    log: Path | None = None
    realtime: bool = False


def main(arguments: Arguments) -> None:
    """Measure and print."""
    realtime(arguments.realtime)
    done = finished(arguments.log)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        plan = TwoStage().solve(read_course("walls", frames=2)).solution
        assert plan is not None
        write_motion(path, plan, check_plan(plan))
        for kind in arguments.kinds:
            runs = list[dict[str, Any]]()
            for k in range(arguments.count):
                rng = np.random.default_rng([arguments.seed, KINDS.index(kind), k])
                key = (arguments.seed, kind, k)
                run = done.get(key) or once(kind, path, k, rng)
                runs.append({"seed": arguments.seed, "kind": kind, "index": k} | run)
                if arguments.log is not None and key not in done:
                    with arguments.log.open("a") as file:
                        file.write(json.dumps(runs[-1]) + "\n")
                if arguments.json:
                    arguments.say(runs[-1])
            if not arguments.json:
                print(table(kind, runs), flush=True)


def finished(log: Path | None) -> dict[tuple[int, str, int], dict[str, Any]]:
    """The runs of a log by seed, kind and number."""
    if log is None or not log.exists():
        return {}
    runs = [json.loads(row) for row in log.read_text().splitlines()]
    return {(run["seed"], run["kind"], run["index"]): run for run in runs}


def once(kind: str, path: Path, index: int, rng: np.random.Generator) -> dict[str, Any]:
    """One fault."""
    if kind in STOPS:
        return stopped(kind, path, start_of(path), index, rng)
    ending: Any = ("hold", "torque-off")[index % 2]
    if kind == "plan edited":
        return edited(path, rng)
    if kind == "friction lost":
        return slipped(path, rng)
    if kind in OF_BRIDGE:
        return behind_rosbridge(kind, path, ending, (2, 1)[index // 2 % 2], rng)
    return on_bus(kind, path, ending, rng)


@cache
def start_of(path: Path) -> Array:
    """Joint angles at the beginning of the plan."""
    return first_pose(Accepted.from_file(path))


def table(kind: str, runs: list[dict[str, Any]]) -> str:
    """A few lines for one kind."""
    stopped = sum(run["stopped"] for run in runs)
    stops = [run["stop_s"] for run in runs if run.get("stop_s") is not None]
    lines = [
        f"{kind}: {stopped} of {len(runs)} stopped, {sum(not run['moved'] for run in runs)} before any motion"
    ]
    if stops:
        lines.append(f"  stop: median {np.median(stops):.3f} s, worst {max(stops):.3f} s")
    counted = [run["after"] for run in runs if run["after"] is not None]
    lines.append(f"  commands after the stop: {sum(counted)} in {len(counted)} runs")
    left = Counter(
        f"{run['left']} ({run['state']})" if "state" in run else run["left"] for run in runs
    )
    if "phase" in runs[0]:
        phases = Counter(run["phase"] for run in runs)
        message = [run["written_s"] for run in runs if run["written"]]
        lines += [
            f"  when: {', '.join(f'{count} {phase}' for phase, count in phases.most_common())}",
            f"  late: {1e3 * max(run['late_s'] for run in runs):.1f} ms at most at the device; "
            f"written: {len(message)}, {1e3 * max(message, default=0.0):.1f} ms at most",
            f"  left as asked for: {sum(run['as_asked'] for run in runs)} of {len(runs)}",
        ]
    lines += [f"  left: {count} × {state}" for state, count in left.most_common(5)]
    lines.append(f"  e.g. {next((run['message'] for run in runs if run['message']), 'it went on')}")
    return "\n".join(lines)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
