"""Least steps of toes and of the rotation (Lin et al. (11)): what branching over directions costs, and
where it ends against closed forms.

    python benchmarks/least_steps.py [--courses walls icy-walls tube stairs] [--frames 8] [--json]

courses: contacts of built-in courses with least_toe_m = 0.05 and least_rotation_rad = 0.05, by the
two-stage planner, beside the same course without them; CPU seconds without compiling. limits: two
key frames of `walls`, with δ a share of the farthest that there is: 2 √3 times the tilt limit, from
corner to corner of its box; the corners of two patches that are farthest apart. Below 1 there is a
plan and above 1 there is none, which is what closed forms say; "parted" is how many sides were
parted, "asked" how many courses were solved.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _bench import Options, Row, launch, markdown

from stancekit import Answer, Motion, Status
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import StepLimits
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import lengths_of
from stancekit.planners.search.two_stage import TwoStage

LEAST = {"least_toe_m": 0.05, "least_rotation_rad": 0.05}
TILT_RAD = 0.03
SHARES = (0.5, 0.9, 0.98, 1.02, 1.1, 1.5)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses."""

    courses: tuple[str, ...] = ("walls", "icy-walls", "tube", "stairs")
    frames: int = 8
    limit_s: float = 120.0
    """Time limit of a course by the clock; on a busy machine nothing else ends a search."""


def main(arguments: Arguments) -> None:
    """Measure and print."""
    planner = TwoStage(time_limit_s=arguments.limit_s)
    for row in (*courses(planner, arguments), *limits(planner)):
        arguments.say(row)


def courses(planner: TwoStage, its: Arguments) -> Iterator[Row]:
    """Built-in courses with least steps, and without."""
    for name in its.courses:
        course = read_course(name, frames=its.frames)
        asked = replace(course, steps=replace(course.steps, **LEAST))
        planner.solve(course)  # compiles
        planner.solve(asked)
        plain, plain_s = timed(planner, course)
        answer, seconds = timed(planner, asked)
        row = {
            "course": name,
            "frames": its.frames,
            "status": str(answer.status.value),
            "asked": int(answer.details["asked"]),
            "parted": int(answer.details["parted"]),
            "cpu_ms": round(1e3 * seconds, 1),
            "without_ms": round(1e3 * plain_s, 1),
        }
        if answer.solution is not None:
            row |= {
                "shortest": round(share(answer.solution, asked), 6),
                "objective": round(answer.objective, 6),
                "without": round(plain.objective, 6),
            }
        yield row


def limits(planner: TwoStage) -> Iterator[Row]:
    """Verdicts on both sides of the farthest step that closed forms allow."""
    course = read_course("walls", frames=2)
    turn = 2.0 * math.sqrt(3.0) * TILT_RAD
    patches = [
        [course.footholds[p].candidates[0].vertices_m for p in move] for move in course.moves
    ]
    step = min(float(np.linalg.norm(a[:, None] - b, axis=2).max()) for a, b in patches)
    for kind, far in (("turn", turn), ("toe", step)):
        for portion in SHARES:
            asked = posed(course, kind, portion * far)
            planner.solve(asked)
            answer, seconds = timed(planner, asked)
            yield {
                "limit": kind,
                "share": portion,
                "right": answer.status is (Status.FEASIBLE if portion < 1 else Status.INFEASIBLE),
                "status": str(answer.status.value),
                "asked": int(answer.details["asked"]),
                "parted": int(answer.details["parted"]),
                "cpu_ms": round(1e3 * seconds, 1),
            }


def posed(course: Problem, kind: str, least: float) -> Problem:
    """The course with a least step of this kind, and room for it in the largest one."""
    changed: dict[str, Any] = (
        {"toe_m": 2.0 * least, "least_toe_m": least}
        if kind == "toe"
        else {"rotation_rad": 2.0 * least, "least_rotation_rad": least}
    )
    steps: StepLimits = replace(course.steps, **changed)
    tilt = TILT_RAD if kind == "turn" else course.tilt_limit_rad
    return replace(course, tilt_limit_rad=tilt, steps=steps)


def timed(planner: TwoStage, course: Problem) -> tuple[Answer[Motion], float]:
    """An answer and its CPU seconds."""
    began = time.process_time()
    answer = planner.solve(course)
    return answer, time.process_time() - began


def share(plan: Motion, course: Problem) -> float:
    """The shortest step over its least length."""
    return float((lengths_of(plan, course)[1] / course.least_steps).min())


def climbs(rows: list[Row]) -> Iterable[str]:
    """Courses with least steps, and without (docs/reproduction.md)."""
    head = ("course", "M", "verdict", "questions", "CPU-ms", "without least steps", "objective")
    names = ("course", "frames", "status", "asked", "cpu_ms", "without_ms", "objective", "without")
    return markdown(
        (*head, "without"),
        ([row.get(name, "") for name in names] for row in rows if "course" in row),
    )


def ends(rows: list[Row]) -> Iterable[str]:
    """Verdicts by the share of the farthest step (docs/reproduction.md)."""
    head = ("step", "share of the farthest", "verdict", "right", "questions", "CPU-ms")
    names = ("limit", "share", "status", "right", "asked", "cpu_ms")
    return markdown(
        head,
        (
            ["yes" if row[name] is True else row[name] for name in names]
            for row in rows
            if "limit" in row
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, climbs=climbs, ends=ends)
