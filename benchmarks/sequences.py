"""What is named of contact sequences that were spoiled in one known way, and of those that were not?

    python benchmarks/sequences.py [--count 40] [--out sequences.jsonl]

A sequence is what a plan of a robot over a ground puts down, as a CSV says it: foot, step, place,
normal and friction alone. Each is asked as it is; with one foot two reaches to the side; with all
ground steep and slippery; and with two steps taken at once by feet of one side. named: the foot and
its reach, the friction, or the step to blame.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Lines, Options, Row, launch, share

import stancekit
from stancekit.planners.answer.report import Report
from stancekit.planners.problem.sequence import Rows
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.search.doctor import diagnosed

ROBOTS = ("hexapod", "go1", "anymal_c", "solo12", "a1")
GROUNDS = ("stones:0.1", "stairs:0.1", "slopes:0.2", "rubble:0.1", "ramps:0.2")
GOAL_M, STEEP, SLIPPERY, LIMIT_S = (0.7, 0.0), np.array([0.5, 0.0, np.sqrt(0.75)]), 0.05, 60.0


@dataclass(frozen=True, kw_only=True)
class Sequences(Options):
    """Options of the table."""

    count: int = 40
    """Sequences, over all robots and grounds in turn."""
    out: Path = field(default_factory=lambda: Path("out/sequences.jsonl"))
    """Rows as they come; a run that was stopped goes on from them."""


def rows_of(plan: stancekit.Motion) -> Rows:
    """What a plan puts down, as a file of another tool would say it."""
    course, footholds = plan.problem, plan.problem.footholds
    patches = [course.patch(j, plan.choice) for j in range(len(footholds))]
    table = np.column_stack([plan.toes_m, [patch.normal for patch in patches]]).T
    return {
        "foot": np.array([each.limb for each in footholds]),
        "step": np.unique([each.frame for each in footholds], return_inverse=True)[1],
        "friction": np.array([patch.friction for patch in patches]),
        **dict(zip(("x", "y", "z", "nx", "ny", "nz"), table, strict=True)),
    }


def far(rows: dict[str, Any], row: int, robot: Robot) -> Callable[[Report[Any]], bool]:
    """A foot comes down two reaches to the side."""
    foot = str(rows["foot"][row])
    limb = next(limb for limb in robot.limbs if limb.name == foot)
    rows["y"][row] += 2.0 * limb.reach_m * np.sign(limb.shoulder_m[1])
    return lambda report: any(
        (group.limb, group.figures.get("limit")) == (foot, "reach") for group in report.groups
    )


def slippery(rows: dict[str, Any], row: int, robot: Robot) -> Callable[[Report[Any]], bool]:
    """All ground is steep and slippery."""
    rows["friction"][:] = SLIPPERY
    for name, value in zip(("nx", "ny", "nz"), STEEP, strict=True):
        rows[name][:] = value
    return lambda report: any("friction" in group.message for group in report.refused)


def at_once(rows: dict[str, Any], row: int, robot: Robot) -> Callable[[Report[Any]], bool]:
    """A foot of the same side is lifted in the same step."""
    step, foot = int(rows["step"][row]), str(rows["foot"][row])
    sides = {limb.name: np.sign(limb.shoulder_m[1]) for limb in robot.limbs}
    lifted = [name for name in sides if sides[name] == sides[foot] and name != foot]
    for name in lifted:
        last = np.flatnonzero((rows["foot"] == name) & (rows["step"] < step))[-1]
        keep = (rows["foot"] != name) | (rows["step"] != step)
        for key in rows:
            rows[key] = np.insert(rows[key][keep], row, rows[key][last])
        rows["step"][row] = step
    order = np.argsort(rows["step"], kind="stable")
    rows |= {key: rows[key][order] for key in rows}
    return lambda report: f"step {step}" in report.message or f"step {step - 1} b" in report.message


SPOILT = {"as it is": None, "far": far, "slippery": slippery, "at once": at_once}


def main(given: Sequences) -> None:
    """Ask, print, and count."""
    lines, pairs = Lines(given.out), [(who, where) for where in GROUNDS for who in ROBOTS]
    for k in range(given.count):
        who, where = pairs[k % len(pairs)][0], f"{pairs[k % len(pairs)][1]}:{k // len(pairs)}"
        if f"{who} {where} {list(SPOILT)[-1]}" in lines.rows:
            continue
        robot, rng = robot_of(who), np.random.default_rng(k)
        ends: dict[str, Any] = {"start": (0.0, 0.0), "goal": GOAL_M, "time_limit_s": LIMIT_S}
        try:
            plan = stancekit.plan(where, robot=robot, **ends).solution
        except stancekit.InvalidInput:
            continue
        for name, spoil in SPOILT.items() if plan is not None else ():
            if spoil is at_once and len(robot.limbs) > 4:
                continue
            rows = {key: column.copy() for key, column in rows_of(plan).items()}
            row = int(rng.choice(np.flatnonzero(rows["step"] > 0)))
            named = None if spoil is None else spoil(rows, row, robot)
            begin = time.process_time()
            report = diagnosed(rows, robot, None, deadline=time.perf_counter() + LIMIT_S)
            found: Row = {"cpu_s": time.process_time() - begin, "said": report.message}
            found["right"] = report.accepted if named is None else named(report)
            given.say(lines.add(f"{who} {where} {name}", {"of": name, **found}))
    for name in SPOILT:
        of = [row for row in lines.rows.values() if row["of"] == name]
        print(f"{name}: {share(sum(row['right'] for row in of), len(of))} right")


if __name__ == "__main__":
    launch(main, Sequences, __doc__)
