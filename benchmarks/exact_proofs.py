"""Are proofs decided in exact arithmetic, and at what cost? Postures, courses and leaps are drawn,
and every certificate of theirs that the verifier accepts is replayed in fractions and balls.

    python benchmarks/exact_proofs.py --postures 20000 --courses 2000 --leaps 200

A row per kind: certificates, how many are accepted exactly, leaves by arithmetic, nodes by kind,
CPU seconds of both verifiers, and how many stay accepted without their last row, or as a proof of
the last problem that has an answer (none should). Exit code 1 if one of a thousand or more is not
decided, or a forgery is accepted.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _bench import Options, launch

import stancekit
from stancekit.planners.answer.answer import Answer
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify.certificate import check_certificate
from stancekit.planners.verify.exact import check_exact

CLASSES = ("wall-3", "wall-5", "wall-3", "ground-3", "wall-4")
COURSES = ("walls", "icy-walls", "stairs", "tube")
LEAPS = ("leap-few", "leap-few", "leap-hard", "leap-given")
Drawn = tuple[Problem | Leap, Answer[Any]]


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """How many problems of each kind."""

    postures: int = 500
    courses: int = 60
    leaps: int = 12
    limit_s: float = 10.0
    """Time limit of a course or a posture."""


def main(asked: Asked) -> int:
    """Draw, prove, replay and print."""
    undecided, forged, every = 0, 0, 0
    for kind, drawn in (("posture", postures), ("course", courses), ("leap", leaps)):
        row: dict[str, float] = dict.fromkeys(
            ("certificates", "exact", "forgeries", "forged accepted"), 0
        )
        spent, leaves, nodes = Counter[str](), Counter[str](), Counter[int]()
        possible: Problem | Leap | None = None
        for problem, answer in drawn(asked, np.random.default_rng(asked.seed)):
            possible = problem if answer.solution is not None else possible
            if answer.certificate is None:
                continue
            certificate = answer.certificate.of(problem)
            began = time.process_time()
            accepted = check_certificate(certificate).accepted
            spent["float"] += time.process_time() - began
            if not accepted:
                continue
            question, rows = certificate.question, certificate.multipliers.tolist()
            began = time.process_time()
            exact, kinds, why = check_exact(question, certificate.tree.tolist(), rows)
            spent["exact"] += time.process_time() - began
            leaves.update(kinds)
            nodes.update(certificate.tree[:, 0].astype(int).tolist())
            row["certificates"] += 1
            row["exact"] += exact
            if not exact:
                asked.say({"kind": kind, "undecided": why})
            fakes = [(question, rows[:-1])]
            fakes += [] if possible is None else [(possible.to_json(), rows)]
            for asks, given in fakes:
                row["forgeries"] += 1
                row["forged accepted"] += check_exact(asks, certificate.tree.tolist(), given)[0]
        every += int(row["certificates"])
        undecided += int(row["certificates"] - row["exact"])
        forged += int(row["forged accepted"])
        shares = {f"{name} CPU-s": round(spent[name], 2) for name in ("float", "exact")}
        asked.say({"kind": kind, **row, "leaves": dict(leaves), "nodes": dict(nodes), **shares})
    return int(1000 * undecided > every or forged > 0)


def postures(asked: Asked, rng: np.random.Generator) -> Iterator[Drawn]:
    """Postures, half of them with friction and reach of their own."""
    planner = Exact(programs=Programs(), time_limit_s=asked.limit_s)
    for name in CLASSES:
        for problem in stancekit.sample(name, asked.postures // len(CLASSES), rng=rng):
            less, far = rng.uniform(0.3, 1.0), rng.uniform(0.9, 1.05)
            contacts = tuple(
                replace(
                    each,
                    patch=replace(each.patch, friction=less * each.patch.friction),
                    reach_m=far * each.reach_m,
                )
                for each in problem.contacts
            )
            changed = problem.posture_with(contacts=contacts)
            for one in (problem, changed):
                yield one, planner.solve(one)


def courses(asked: Asked, rng: np.random.Generator) -> Iterator[Drawn]:
    """Courses: friction, reach and steps of their own, some with a load or least steps."""
    planner = TwoStage(programs=Programs(), time_limit_s=asked.limit_s)
    bases = [read_course(name, frames=2) for name in COURSES]
    for n in range(asked.courses):
        course = _changed(bases[n % len(bases)], rng)
        yield course, planner.solve(course)


def _changed(base: Problem, rng: np.random.Generator) -> Problem:
    """A course whose candidates, reaches and limits are drawn."""
    share, reach = rng.uniform(0.15, 0.6), rng.uniform(0.7, 1.05)
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                replace(patch, friction=patch.friction * share * rng.uniform(0.7, 1.3))
                for patch in put.candidates * (1 if put.toe_m is not None else 2)
            ),
        )
        for put in base.footholds
    )
    limbs = tuple(replace(limb, reach_m=limb.reach_m * reach) for limb in base.robot.limbs)
    steps = base.steps
    if rng.random() < 0.4:
        steps = replace(
            steps,
            yaw_rad=float(rng.uniform(0.0, 0.05)),
            progress_m=float(rng.uniform(0.0, steps.com_m)),
            least_rotation_rad=float(rng.uniform(0.05, 0.15)) * (rng.random() < 0.5),
            least_toe_m=float(rng.uniform(0.1, 0.3)) * (rng.random() < 0.5),
        )
    course = replace(base, footholds=footholds, robot=replace(base.robot, limbs=limbs), steps=steps)
    load = rng.normal(size=6) * np.array([20.0, 20.0, 20.0, 5.0, 5.0, 5.0])
    return course.loaded(load if rng.random() < 0.3 else None)


def leaps(asked: Asked, rng: np.random.Generator) -> Iterator[Drawn]:
    """Leaps."""
    classes = [leap_class(name) for name in LEAPS]
    for n in range(asked.leaps):
        leap = classes[n % len(classes)].draw(rng)
        yield leap, find_leap(leap, LeapFinder(solves=4))


if __name__ == "__main__":
    launch(main, Asked, __doc__)
