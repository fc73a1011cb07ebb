"""How far from the best is the two-stage plan? Against the exact planner on small perturbed
courses, one thread each.

python benchmarks/optimality.py --count 30 --seed 0 --out out/optimality

Courses of two and three frames, in turn: perturbed as the built-in ones are, and the same with less
friction, a wider body and a goal aside, which pulls the plan against limits; and four limbs on
small tilted patches of little friction, where the lift is not tight and some courses have no plan.
The two-stage planner is asked twice: for its first plan, and with a gap, which goes on over the
choices of patches and descends. Finished courses are kept in the folder.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, kept, launch
from rich.console import Console
from rich.table import Table

from stancekit.envs.distributions.courses import SMALL, perturbed
from stancekit.planners.answer.answer import Answer
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold, StepLimits
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.exact import ExactCoursePlanner
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain import Patch


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, and for how long."""

    count: int = 40
    gap: float = 1e-3
    """Relative gap at which the exact planner stops."""
    time_limit_s: float = 30.0
    """Of every planner, a course."""
    out: Path = Path("out/optimality")
    """Folder of finished courses; another run goes on from them."""


def course_of(index: int, seed: int) -> tuple[str, Problem]:
    """A kind and a course; the same ones for the same numbers."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    kinds = (*SMALL, "tilted")
    kind, frames = kinds[index % len(kinds)], 2 + (index // len(kinds)) % 2
    if kind == "tilted":
        return kind, tilted(rng, frames)
    course = perturbed(kind, rng, frames=frames)
    if (index // (2 * len(kinds))) % 2 == 0:
        return kind, course
    return f"{kind}, pulled", pulled(course, rng)


def pulled(course: Problem, rng: np.random.Generator) -> Problem:
    """With up to a third less friction, a body that may go three times as far, and a goal .2 m
    off.
    """
    less = rng.uniform(0.67, 1.0)
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                replace(patch, friction=less * patch.friction) for patch in put.candidates
            ),
        )
        for put in course.footholds
    )
    aside = rng.normal(size=3)
    return replace(
        course,
        footholds=footholds,
        com_radius_m=3.0 * course.com_radius_m,
        goal_m=course.goal_m + 0.2 * aside / np.linalg.norm(aside),
    )


def tilted(rng: np.random.Generator, frames: int) -> Problem:
    """Four limbs between two walls of small patches, each tilted and slippery in its own way; one
    limb moves.
    """
    names = ("LF", "LR", "RF", "RR")
    robot = Robot(name="four limbs", mass_kg=10.0, limbs=hexapod().select(names))
    com = np.array([[0.0, 0.0, 0.04 * k] for k in range(frames)])
    lifts = ((), *((names[k % 4],) for k in range(frames - 1)))
    footholds = tuple(
        Foothold(limb=limb.name, frame=k, candidates=(_tilted_patch(rng, com[k], limb),))
        for k in range(frames)
        for limb in robot.limbs
        if k == 0 or limb.name in lifts[k]
    )
    return Problem(
        name="tilted",
        robot=robot,
        terrain=tuple(put.candidates[0] for put in footholds),
        footholds=footholds,
        lifts=lifts,
        com_nominal_m=com,
        com_radius_m=np.full(frames, 0.05),
        goal_m=com[-1] + rng.uniform(-0.1, 0.1, 3),
        steps=StepLimits(com_m=0.09, toe_m=0.3, progress_m=0.01),
    )


def _tilted_patch(rng: np.random.Generator, com: Array, limb: Limb) -> Patch:
    ahead, side = np.sign(limb.shoulder_m[:2])
    normal = np.array([rng.uniform(-0.25, 0.25), -side, rng.uniform(-0.25, 0.25)])
    first = np.cross(normal, [0.0, 0.0, 1.0])
    second = np.cross(first, normal)
    first, second = 0.05 * first / np.linalg.norm(first), 0.05 * second / np.linalg.norm(second)
    away = [limb.shoulder_m[0] + 0.06 * ahead, 0.36 * side, -0.03]
    corners = [first + second, first - second, -first - second, second - first]
    return Patch(
        vertices_m=com + away + rng.uniform(-0.06, 0.06, 3) + np.array(corners),
        normal=normal / np.linalg.norm(normal),
        shear_reference=np.array([0.0, 0.0, 1.0]),
        friction=rng.uniform(0.5, 0.9),
    )


def main(options: Arguments) -> None:
    """Solve, print and keep."""
    programs = Programs()
    first = TwoStageCoursePlanner(programs=programs, time_limit_s=options.time_limit_s)
    best = TwoStageCoursePlanner(
        programs=programs, time_limit_s=options.time_limit_s, gap=options.gap
    )
    exact = ExactCoursePlanner(
        programs=programs, time_limit_s=options.time_limit_s, gap=options.gap
    )
    planners: dict[str, Planner] = {"first": first, "best": best, "exact": exact}
    rows = []
    for index in range(options.count):
        path = options.out / f"{options.seed}-{index}-{options.gap:g}-{options.time_limit_s:g}.json"
        kind, course = course_of(index, options.seed)
        rows.append(kept(path, partial(measured, {"index": index, "kind": kind}, course, planners)))
        if options.json:
            options.say(rows[-1])
    if not options.json:
        show(rows)


def measured(head: dict[str, Any], course: Problem, planners: dict[str, Planner]) -> dict[str, Any]:
    """What every planner answers."""
    return (
        head
        | {"frames": course.frames}
        | {name: summary(one.solve(course)) for name, one in planners.items()}
    )


def summary(outcome: Answer[Plan]) -> dict[str, Any]:
    """What is kept of an answer."""
    return {
        "status": outcome.status.value,
        "objective": _number(outcome.objective),
        "bound": _number(outcome.bound),
        "seconds": outcome.effort.seconds,
        "compile_s": outcome.effort.compile_s,
        "nodes": outcome.details.get("nodes", 0.0),
        "cuts": outcome.details.get("cuts", 0.0),
        "claim": outcome.claim,
    }


def loss(row: dict[str, Any], name: str) -> float | None:
    """By how much the plan's objective is above the exact planner's [%]; None where either has
    none.
    """
    ours, theirs = row[name]["objective"], row["exact"]["objective"]
    return None if ours is None or theirs is None else 100.0 * (ours - theirs) / max(theirs, 1e-6)


def show(rows: list[dict[str, Any]]) -> None:
    """The table, and what it comes to."""
    table = Table(title="objective of the two-stage plan against the exact one")
    for head in (
        "course",
        "M",
        "first [m²]",
        "exact [m²]",
        "bound [m²]",
        "gap %",
        "with gap %",
        "ms",
        "exact ms",
        "nodes",
    ):
        table.add_column(head, justify="left" if head == "course" else "right")
    for row in rows:
        first, exact = row["first"], row["exact"]
        table.add_row(
            row["kind"],
            str(row["frames"]),
            _text(first["objective"], ".3e") or first["status"],
            _text(exact["objective"], ".3e") or f"{exact['status']} {exact['claim']}",
            _text(exact["bound"], ".3e"),
            _text(loss(row, "first"), ".2f"),
            _text(loss(row, "best"), ".2f"),
            f"{1e3 * first['seconds']:.0f}",
            f"{1e3 * exact['seconds']:.0f}",
            f"{exact['nodes']:.0f}",
        )
    console = Console(width=120)
    console.print(table)
    for name, label in (("first", "first plan"), ("best", "with a gap")):
        losses = np.array(
            [value for value in (loss(row, name) for row in rows) if value is not None]
        )
        if len(losses):
            console.print(
                f"{label}: {len(losses)} of {len(rows)} courses, gap median {np.median(losses):.3f} %, "
                f"mean {losses.mean():.2f} %, largest {losses.max():.1f} %, at most 0.1 %: {np.sum(losses <= 0.1)}"
            )
    closed = sum(row["exact"]["claim"] == "optimal" for row in rows)
    console.print(
        f"exact: {closed} closed to the gap, {sum(row['exact']['status'] == 'infeasible' for row in rows)} refuted"
    )


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _text(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
