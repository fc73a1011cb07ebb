"""Leaps with legs: how many that are solved can joints and bodies do, before and after bending, and
how many of these run in MuJoCo.

    python benchmarks/legged_leaps.py plan CLASS ROBOT FOLDER --scenes 30
    python benchmarks/legged_leaps.py run FOLDER
    python benchmarks/legged_leaps.py stop FOLDER FILE
    python benchmarks/legged_leaps.py table FOLDER

A scene is CLASS:SEED on the robot. A run of the benchmark that is stopped goes on. Shares have
Wilson's 95 % intervals; ``table`` takes ``--markdown`` and ``--json``.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import Lines, Options, launch, share

from stancekit.motions import run
from stancekit.planners.answer.hindrance import LEAP_BODY
from stancekit.planners.equilibrium.programs import programs_of_this_thread
from stancekit.planners.formats.leap_file import read_leap, write_leap
from stancekit.planners.leap.bend import judged_answer
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.motion.leap_run import REST_S
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.worlds import make_world

UPRIGHT = 0.9
"""Least cosine of the tilt of a body that stands."""


def plan(asked: Asked, kind: str, robot: str, folder: Path) -> None:
    """Solve and bend scenes, one line each in FOLDER/plans.jsonl."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = Lines(folder / "plans.jsonl", "seed")
    for seed in range(asked.first, asked.first + asked.scenes):
        if seed in lines.rows:
            continue
        if sum(row["solved"] for row in lines.rows.values()) >= asked.solved:
            break
        begin = time.process_time()
        leap = read_leap(f"{kind}:{seed}", robot).leap
        answer = find_leap(leap, LeapFinder(solves=asked.solves, proof=0))
        row: dict[str, Any] = {"solved": answer.solution is not None}
        if answer.solution is not None:
            deadline = time.perf_counter() + asked.limit_s
            judged = judged_answer(answer, programs_of_this_thread(), deadline=deadline)
            assert judged.report is not None
            assert judged.solution is not None
            groups = {group.name: group for group in judged.report.groups}
            row |= {
                "before": {
                    name: judged.details[f"{name}_before"]
                    for name in LEAP_BODY
                    if f"{name}_before" in judged.details
                },
                "after": {name: groups[name].value for name in LEAP_BODY if name in groups},
                "fails": [
                    name
                    for name in LEAP_BODY
                    if name in groups and groups[name].verdict == "violated"
                ],
                "accepted": judged.report.accepted,
                "rounds": judged.details["bending_rounds"],
                "timing": judged.solution.problem.timings_s[judged.solution.timing],
                "message": judged.message,
            }
            if judged.report.accepted:
                write_leap(folder / f"{kind}-{seed}.json", judged.solution.problem, judged.solution)
        row["cpu_s"] = time.process_time() - begin
        lines.add(seed, row)


def play(folder: Path) -> None:
    """Run every accepted leap in MuJoCo, one line each in FOLDER/runs.jsonl."""
    lines = Lines(folder / "runs.jsonl", "file")
    for path in sorted(folder.glob("leap-*.json")):
        if path.name not in lines.rows:
            lines.add(path.name, outcome(run(path, "mujoco")))


def outcome(report: Any) -> dict[str, Any]:
    """What came of a run."""
    execution = report.execution
    if execution is None:
        return {"succeeded": False, "upright": False, "message": report.message}
    trace = execution.trace
    return {
        "succeeded": report.succeeded,
        "upright": bool(trace.rotation[-1, 2, 2] > UPRIGHT) and execution.com_final_m < 0.1,
        "rested_s": REST_S,
        "com_worst_m": execution.com_worst_m,
        "com_final_m": execution.com_final_m,
        "slip_m": float(np.max(execution.slip_m)),
        "message": report.message or execution.message,
    }


def stop(path: Path, times: int = 20) -> None:
    """Press the e-stop at so many instants of a leap, spread evenly over it."""
    plan = read_leap(path).plan
    assert plan is not None
    accepted = Accepted.verified(plan, str(path))
    from stancekit.planners.motion.leap_run import LeapRun

    duration = LeapRun(plan).duration_s
    for when in np.linspace(0.05, 0.95, times) * duration:
        runners = list[Runner]()

        def pressed(at: float = float(when), runners: list[Runner] = runners) -> str:
            state = runners[0].state if runners else None
            return "e-stop" if state is not None and state.time_s >= at else ""

        runners.append(Runner(make_world("mujoco", accepted.robot), sources=(pressed,)))
        report = runners[0].run(accepted)
        row = {
            "pressed_s": round(float(when), 3),
            "ended_s": report.execution and report.execution.seconds,
        }
        print(json.dumps(row | outcome(report)), flush=True)


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """What to do, with a class, a robot and a folder; or with a folder, and a leap's file.

    Arguments:
        scenes: how many are planned.
        first: the seed of the first.
        solved: planning ends when so many are solved.
        solves: convex problems at most that a scene's solution takes.
        limit_s: for bending a scene, by the clock.
    """

    what: Annotated[Literal["plan", "run", "stop", "table"], tyro.conf.Positional]
    names: Annotated[tuple[str, ...], tyro.conf.Positional]
    scenes: int = 30
    first: int = 0
    solved: float = np.inf
    solves: int = 50
    limit_s: float = 400.0


def table(asked: Asked, folder: Path) -> None:
    """Print shares by group, before and after."""
    rows = list(Lines(folder / "plans.jsonl", "seed").rows.values())
    solved = [row for row in rows if row["solved"]]
    figures = {
        "solved": share(len(solved), len(rows)),
        "accepted after bending": share(sum(row["accepted"] for row in solved), len(solved)),
        "CPU-s, median": float(np.median([row["cpu_s"] for row in rows])),
        "binds": dict(Counter(row["fails"][0] for row in solved if row["fails"])),
    }
    played = list(Lines(folder / "runs.jsonl", "file").rows.values())
    if played:
        upright = sum(row["upright"] for row in played)
        figures["upright 2 s after landing"] = share(upright, len(played))
        figures["run as planned"] = share(sum(row["succeeded"] for row in played), len(played))
    for name, value in figures.items():
        asked.say({"figure": name, "value": value}, lambda row: f"{row['figure']}: {row['value']}")
    for name in LEAP_BODY:
        medians = {}
        for when in ("before", "after"):
            values = [row[when][name] for row in solved if name in row[when]]
            medians[f"median {when}"] = float(np.median(values)) if values else None
        fails = sum(name in row["fails"] for row in solved)
        asked.say({"group": name, **medians, "fails after": fails})
    for row in played:
        if not row["upright"]:
            asked.say({"fell": row["file"], "message": row["message"]})


def main(asked: Asked) -> None:
    """Plan, run, stop or tell."""
    if asked.what == "plan":
        kind, robot, folder = asked.names
        plan(asked, kind, robot, Path(folder))
    elif asked.what == "run":
        play(Path(asked.names[0]))
    elif asked.what == "stop":
        stop(Path(asked.names[-1]))
    else:
        table(asked, Path(asked.names[0]))


if __name__ == "__main__":
    launch(main, Asked, __doc__)
