"""Leaps with legs: how many that are solved can joints and bodies do, before and after bending, and
how many of these run in MuJoCo.

    python benchmarks/legged_leaps.py plan CLASS ROBOT FOLDER --scenes 30
    python benchmarks/legged_leaps.py run FOLDER
    python benchmarks/legged_leaps.py perturbed FILE --runs 5
    python benchmarks/legged_leaps.py stop FILE
    python benchmarks/legged_leaps.py table FOLDER

A scene is CLASS:SEED on the robot; FILE is of a leap or of a crossing. A run of the benchmark that is stopped goes on. Shares have
Wilson's 95 % intervals; ``table`` takes ``--markdown`` and ``--json``.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import Lines, Options, launch, share

from stancekit.motions import run
from stancekit.planners.answer.plan import LEAP_BODY
from stancekit.planners.equilibrium.programs import programs_of_this_thread
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.formats.question_file import read_leap
from stancekit.planners.leap.bend import judged_answer
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.motion.gait_motion import crossing_motion
from stancekit.planners.motion.leap_motion import REST_S, SETTLE_S, leap_motion
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.worlds.world import Imperfections, make_world

HELD_S = 2.0
"""How long joints are held after a stop before the robot is looked at again."""
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
        leap = read_leap(f"{kind}:{seed}", robot)
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
                write_motion(folder / f"{kind}-{seed}.json", judged.solution, judged.report)
        row["cpu_s"] = time.process_time() - begin
        lines.add(seed, row)


def play(folder: Path) -> None:
    """Run every accepted leap in MuJoCo, one line each in FOLDER/runs.jsonl."""
    lines = Lines(folder / "runs.jsonl", "file")
    for path in sorted(folder.glob("leap-*.json")):
        if path.name not in lines.rows:
            lines.add(path.name, outcome(run(path, "mujoco")))


def perturbed(asked: Asked, path: Path) -> None:
    """Run a leap or a crossing again and again, with all errors drawn evenly by seed: mass up to
    3 % more or less, friction down to 90 %, joints up to 5 mrad off, delays of none or one period.
    """
    accepted, lines = Accepted.from_file(path), Lines(path.with_suffix(".runs.jsonl"), "run")
    for number in range(asked.runs):
        if number in lines.rows:
            continue
        rng = np.random.default_rng([asked.seed, number])
        drawn = {
            "mass_share": round(1.0 + rng.uniform(-0.03, 0.03), 3),
            "offset_rad": round(rng.uniform(0.0, 5e-3), 4),
            "delay_s": float(rng.choice([0.0, 5e-3])),
        }
        friction = round(1.0 - rng.uniform(0.0, 0.1), 3)
        wrong = Imperfections(**drawn, seed=int(rng.integers(2**31)))
        world = make_world("mujoco", accepted.robot, imperfections=wrong)
        report = Runner(world).run(accepted, accepted.plan.ground(friction))
        lines.add(number, {**drawn, "friction": friction} | outcome(report))
    rows = list(lines.rows.values())
    for row in rows:
        asked.say(row)
    asked.say({"as planned": share(sum(row["succeeded"] for row in rows), len(rows))})


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


def stop(asked: Asked, path: Path) -> None:
    """Press the e-stop at instants of the leap in a file, of a crossing, too, spread evenly over its
    stances and its flight, and look at the robot again when its joints were held for a while.
    """
    accepted = Accepted.from_file(path)
    leaps = accepted.plan.has("timing")
    plan = next(p for p in accepted.plan.parts or [accepted.plan] if p.has("timing"))
    whole, alone = leap_motion(plan) if leaps else crossing_motion(accepted.plan), leap_motion(plan)
    begin = whole.committed_s[0][0] - alone.committed_s[0][0] + SETTLE_S
    lines = Lines(path.with_suffix(".stops.jsonl"), "instant")
    for k, at in enumerate(np.linspace(0.0, float(plan.ends_s[-1]), asked.instants)):
        if k not in lines.rows:
            lines.add(k, {"leap_s": round(float(at), 3)} | stopped(accepted, begin + float(at)))
    rows = list(lines.rows.values())
    for row in rows:
        asked.say(row)
    asked.say({"upright, held for a while": share(sum(row["upright"] for row in rows), len(rows))})


def stopped(accepted: Accepted[Any], when_s: float) -> dict[str, Any]:
    """What comes of an e-stop at a time of the motion; upright: when its joints were held for HELD_S
    after the run.
    """
    world, later = make_world("mujoco", accepted.robot), list[Any]()
    close = world.close

    def held() -> None:
        if not later:
            later.append(
                [world._advanced(world._sent) for _ in range(round(HELD_S * world.rate_hz))]
            )
        close()

    world.close = held  # type: ignore[method-assign]
    runner = Runner(world)
    moves = list[float]()

    def seen(target: Any, state: Any) -> None:
        moves.append(float(target.sample.frame))
        if moves[-1] >= when_s and not runner.latch.tripped:
            runner.latch.trip("e-stop")

    runner.check_body = seen  # type: ignore[method-assign]
    report = runner.run(accepted)
    last = later[0][-1]
    return {
        "went_on_s": round(moves[-1] - when_s, 3),
        "upright": bool(last.rotation[2, 2] > UPRIGHT),
        "feet_that_bear": int((np.linalg.norm(last.forces_n, axis=1) > 1.0).sum()),
        "speed_m_s": round(float(np.linalg.norm(last.velocity[:3])), 4),
        "message": report.message,
    }


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """What to do, with a class, a robot and a folder; or with a folder, and a leap's file.

    Arguments:
        scenes: how many are planned.
        first: the seed of the first.
        solved: planning ends when so many are solved.
        solves: convex problems at most that a scene's solution takes.
        runs: with errors.
        instants: of e-stops.
        limit_s: for bending a scene, by the clock.
    """

    what: Annotated[Literal["plan", "run", "perturbed", "stop", "table"], tyro.conf.Positional]
    names: Annotated[tuple[str, ...], tyro.conf.Positional]
    scenes: int = 30
    first: int = 0
    solved: float = np.inf
    solves: int = 50
    runs: int = 5
    instants: int = 20
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
    """Plan, run, perturb, stop or tell."""
    if asked.what == "plan":
        kind, robot, folder = asked.names
        plan(asked, kind, robot, Path(folder))
    elif asked.what == "run":
        play(Path(asked.names[0]))
    elif asked.what == "perturbed":
        perturbed(asked, Path(asked.names[0]))
    elif asked.what == "stop":
        stop(asked, Path(asked.names[-1]))
    else:
        table(asked, Path(asked.names[0]))


if __name__ == "__main__":
    launch(main, Asked, __doc__)
