"""Plans of perturbed courses executed in simulation: how many are planned, and how many of these
succeed.

    python benchmarks/execution.py [--courses stairs walls …] [--worlds bullet mujoco] [--count 20]
    [--seed 0]
        [--pace 1] [--workers 1] [--no-reserve] [--planned-forces] [--json]

Every course is the built-in one with other heights, distances, leans, friction and panels
(``courses.perturbed``), planned by the two-stage planner; what the planner refuses is counted
apart. An execution is a success where the robot did not fall, its centre of mass ended within 3 cm
of the plan's, and no foot slid by more than 2 cm (``Tolerance``). Plans keep a reserve of friction
where there is one (``friction_margin``); --no-reserve plans with all of it, and --planned-forces
presses as the plan says instead of distributing the forces anew with a reserve of friction. Times
to compute are shown as simulated seconds a second ("real_time"); --workers runs so many processes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from _bench import Options, launch
from joblib import Parallel, delayed

from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import builtin_courses
from stancekit.planners.search.friction_margin import SHARES, plan_with_reserve
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.runner.execution import Execution
from stancekit.runner.report import RunReport
from stancekit.runner.run import simulate
from stancekit.runner.settings import RunSettings


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, in which worlds, and how."""

    courses: tuple[str, ...] = builtin_courses()
    worlds: tuple[str, ...] = ("bullet", "mujoco")
    count: int = 20
    pace: float = 1.0
    workers: int = 1
    planned_forces: bool = False
    reserve: bool = True


def main(arguments: Arguments) -> None:
    """Measure and print."""
    forces: Literal["planned", "shared"] = "planned" if arguments.planned_forces else "shared"
    for name in arguments.courses:
        begin = time.perf_counter()
        plans, refused = planned(name, arguments.count, arguments.seed, reserve=arguments.reserve)
        seconds = time.perf_counter() - begin
        for world in arguments.worlds:
            timing = Timing().at_pace(arguments.pace)
            settings = RunSettings(forces=forces, timing=timing, check_limits=False)
            jobs = (delayed(simulate)(plan, world, settings=settings) for plan in plans)
            runs: list[RunReport] = list(Parallel(n_jobs=arguments.workers)(jobs))
            record = {
                "course": name,
                "planned": len(plans),
                "refused": refused,
                "planning_s": seconds,
                "world": world,
            }
            record |= summary(runs)
            arguments.say(record, line)
            for index, run in enumerate(runs):
                if not run.succeeded and not arguments.json:
                    print(f"    plan {index}: {run.message}", flush=True)


def planned(name: str, count: int, seed: int, *, reserve: bool) -> tuple[list[Plan], int]:
    """Plans of ``count`` perturbed courses, and how many courses got none."""
    planner = TwoStageCoursePlanner()
    rng = np.random.default_rng(seed)
    shares = SHARES if reserve else (1.0,)
    outcomes = [
        plan_with_reserve(planner, perturbed(name, child), shares) for child in rng.spawn(count)
    ]
    plans = [outcome.solution for outcome in outcomes if outcome.solution is not None]
    return plans, count - len(plans)


def summary(reports: Sequence[RunReport]) -> dict[str, Any]:
    """Successes, and medians and extremes of what was measured."""
    runs: list[Execution] = [report.execution for report in reports if report.execution is not None]
    if not runs:
        return {"succeeded": 0}
    final, worst, slip, force = (
        [1e3 * run.com_final_m for run in runs],
        [1e3 * run.com_worst_m for run in runs],
        [1e3 * float(run.slip_m.max()) for run in runs],
        [run.force_rms_n for run in runs],
    )
    return {
        "succeeded": sum(report.succeeded for report in reports),
        "fallen": sum(run.fallen_s is not None for run in runs),
        "com_final_mm": [float(np.median(final)), max(final)],
        "com_worst_mm": [float(np.median(worst)), max(worst)],
        "slip_mm": [float(np.median(slip)), max(slip)],
        "force_rms_n": [float(np.median(force)), max(force)],
        "torque_nm": max(run.torque_worst_nm for run in runs),
        "torque_planned_nm": max(run.planned_torque_nm for run in runs),
        "shift_mm": 1e3 * max(run.shift_m for run in runs),
        "bump_s": max(run.bump_s for run in runs),
        "real_time": sum(run.seconds for run in runs) / sum(run.wall_s for run in runs),
    }


def line(record: dict[str, Any]) -> str:
    """One line of the table."""
    text = f"{record['course']:15} {record['world']:7} {record['succeeded']:3} of {record['planned']} executed"
    if record["refused"]:
        text += f" ({record['refused']} not planned)"
    if "com_final_mm" not in record:
        return text
    pairs = ("com_final_mm", "com_worst_mm", "slip_mm", "force_rms_n")
    text += "".join(f"  {name} {record[name][0]:.1f} ≤ {record[name][1]:.1f}" for name in pairs)
    for name in ("torque_nm", "torque_planned_nm", "shift_mm", "bump_s", "real_time"):
        text += (
            f"  {name} {record[name]:.2f}"
            if name != "torque_nm"
            else f"  torque_nm {record[name]:.1f}"
        )
    return text


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
