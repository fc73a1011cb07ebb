"""What happens when the ground lets go in simulation: a foot that slips, or friction that drops, at
random times.

    python benchmarks/slips.py [--course walls] [--share 0.5] [--count 20] [--seed 0] [--ending
    hold] [--json]

One plan of a built-in course is run in MuJoCo by the runner (``tests/emulators/slipping.py``); at a
random time one random foot is left with a friction of 0.02, or all patches with --share of theirs,
for good. as planned: runs whose report is a success all the same. Those that stop are stopped by
the runner's bounds on the body (0.1 m, 0.5 rad) or the joints; told: simulated time from the fault
to the stop, median and worst.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch, tally

from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.safety.ending import Ending
from stancekit.runner.settings import RunSettings
from tests.emulators.slipping import FAULTS, SlippingWorld


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which course, and how slippery it gets."""

    course: str = "walls"
    share: float = 0.5
    count: int = 20
    ending: Ending = "hold"


def main(arguments: Arguments) -> None:
    """Measure and print."""
    plan = plan_with_reserve(TwoStageCoursePlanner(), read_course(arguments.course)).solution
    if plan is None:
        raise SystemExit(f"no plan for {arguments.course}")
    accepted = Accepted.verified(plan, arguments.course)
    for kind in FAULTS:
        rng = np.random.default_rng([arguments.seed, FAULTS.index(kind)])
        runs = [
            tried(accepted, kind, rng, arguments.share, arguments.ending)
            for _ in range(arguments.count)
        ]
        record = {"course": arguments.course, "kind": kind, "ending": arguments.ending} | summary(
            runs
        )
        arguments.say(record, line)


def tried(
    accepted: Accepted, kind: str, rng: np.random.Generator, share: float, ending: Ending
) -> dict[str, Any]:
    """One run with one fault at a random time of the plan."""
    robot = accepted.plan.problem.robot
    world = SlippingWorld(robot, limb=int(rng.integers(len(robot.limbs))), share=share)
    runner = Runner(world, settings=RunSettings(ending=ending))
    at_s = float(rng.uniform(0.2, 12.0))
    world.inject(kind, at_s)
    report = runner.run(accepted)
    stop_s = float("nan") if runner.state is None else runner.state.time_s
    happened = bool(np.isfinite(world.happened_s))
    return {
        "happened": happened,
        "good": report.succeeded,
        "told_s": stop_s - world.happened_s,
        "stopped": runner.latch.tripped,
        "left": report.ended.left,
        "message": report.message,
    }


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts, and times of those that were stopped."""
    stopped = [run for run in runs if run["stopped"] and run["happened"]]
    message = [run["told_s"] for run in stopped] or [float("nan")]
    return {
        "runs": len(runs),
        "as_planned": sum(run["good"] for run in runs),
        "stopped": len(stopped),
        "told_s": float(np.median(message)),
        "told_worst_s": float(np.max(message)),
        "left": tally(run["left"] for run in runs),
        "message": next((run["message"] for run in runs if run["message"]), ""),
    }


def line(record: dict[str, Any]) -> str:
    """A record for people."""
    return (
        f"{record['course']} {record['kind']:17s} {record['as_planned']}/{record['runs']} as planned, "
        f"{record['stopped']} stopped, told {record['told_s']:.2f} ({record['told_worst_s']:.2f}) s, "
        f"{record['left']}: {record['message']}"
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
