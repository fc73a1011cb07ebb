"""Whoever reads a problem knows all of its fields: each is set to another value, alone, and every
reader gives another answer, or the problem is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit.learners.surrogates.surrogate import Surrogate
from stancekit.learners.zoo import shipped
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.problem.contact import StepLimits
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class, leap_to_json
from stancekit.planners.problem.walk import Walk
from stancekit.planners.verify.margins import stance_margins

Changes = dict[str, Callable[[Any], Any]]
BODY: Changes = {
    "com_nominal_m": lambda p: p.com_nominal_m + np.array([0.0, 0.0, 0.3]),
    "com_radius_m": lambda p: 1e-6 * p.com_radius_m,
    "tilt_limit_rad": lambda p: 0.0,
    "gravity_m_s2": lambda p: 2.0 * p.gravity_m_s2,
    "length_scale_m": lambda p: 2.0 * p.length_scale_m,
    "force_scale_n": lambda p: 2.0 * p.force_scale_n,
    "push_n": lambda p: 0.8 * p.weight_n,
    "doubts": lambda p: ("a hole is filled",),
    "wrench": lambda p: np.tile([0.0, 0.4 * p.weight_n, 0.0, 0.0, 0.0, 0.0], (p.frames, 1)),
    "robot": lambda p: replace(p.robot, mass_kg=2.0 * p.robot.mass_kg),
    "footholds": lambda p: tuple(
        replace(each, force_min=np.array([0.0, -0.01, -0.01]), force_max=np.full(3, 0.01))
        for each in p.footholds
    ),
}
"""What posture problems and courses have both."""
POSTURE: Changes = BODY | {
    "name": lambda p: "another",
    "terrain": lambda p: p.terrain[1:],
    "lifts": lambda p: ((), ("RF",)),
    "next_lift": lambda p: ("RF",),
    "goal_m": lambda p: p.goal_m + 1.0,
    "steps": lambda p: StepLimits(com_m=0.01, progress_m=0.0),
    "weights": lambda p: read_course("walls", frames=2).weights,
    "force_min": lambda p: np.array([0.0, -0.5, -0.5]),
    "force_max": lambda p: 0.5 * np.ones(3),
    "standing_m": lambda p: np.zeros((1, len(p.legs), 3)),
    "modes": lambda p: (1,),
    "sides": lambda p: np.zeros((0, 4)),
}
COURSE: Changes = BODY | {
    "name": lambda p: "another",
    "terrain": lambda p: tuple(replace(patch, friction=0.01) for patch in p.terrain),
    "lifts": lambda p: (p.lifts[0], p.lifts[1][1:], *p.lifts[2:]),
    "next_lift": lambda p: () if p.next_lift else p.lifts[1],
    "goal_m": lambda p: p.goal_m + 1.0,
    "steps": lambda p: StepLimits(com_m=0.01, toe_m=0.01, progress_m=0.0),
    "weights": lambda p: replace(p.weights, goal=2.0 * p.weights.goal + 1.0),
    "force_min": lambda p: np.array([0.9, -1.0, -1.0]),
    "force_max": lambda p: np.full(3, 0.01),
    "standing_m": lambda p: np.zeros((p.frames, len(p.legs), 3)),
    "modes": lambda p: (7,) * p.frames,
    "sides": lambda p: np.zeros((0, 4)),
}
LEAP: Changes = {
    "name": lambda p: "another",
    "robot": lambda p: replace(p.robot, mass_kg=2.0 * p.robot.mass_kg),
    "phases": lambda p: (replace(p.phases[0], intervals=3), *p.phases[1:]),
    "timings_s": lambda p: tuple(tuple(1.1 * s for s in timing) for timing in p.timings_s),
    "footholds": lambda p: (
        replace(p.footholds[0], candidates=p.footholds[0].candidates[1:]),
        *p.footholds[1:],
    ),
    "start": lambda p: replace(p.start, rotation_rad=np.array([0.0, 0.1, 0.0])),
    "goal": lambda p: replace(p.goal, com_m=p.goal.com_m + 0.1),
    "goal_radius_m": lambda p: 2.0 * p.goal_radius_m,
    "limits": lambda p: replace(p.limits, force_share=2.0),
    "duration_s": lambda p: None if p.duration_s else sum(p.timings_s[0]),
}
FLAT = stancekit.HeightField.from_array(np.zeros((81, 81)), spacing_m=0.1)
WALK: Changes = {
    "robot": lambda p: replace(p.robot, mass_kg=2.0 * p.robot.mass_kg),
    "terrain": lambda p: stancekit.HeightField.from_array(np.eye(81), spacing_m=0.1),
    "start": lambda p: p.start + 0.1,
    "goal": lambda p: p.goal + 0.1,
    "start_yaw_rad": lambda p: 0.2,
    "end_yaw_rad": lambda p: 0.2,
    "duration_s": lambda p: 3.0,
    "friction": lambda p: 0.4,
    "adhesive": lambda p: (True,) * 4,
    "suction_n": lambda p: 3.0 * p.suction_n,
    "gait": lambda p: "walk",
    "cycle_s": lambda p: 0.4,
    "timings": lambda p: "optimised",
}


@cache
def asked(kind: str) -> Any:
    """A question, with an answer of it where readers judge one."""
    if kind == "walk":
        return Walk.over(FLAT, (0.3, 0.0), duration_s=2.0, adhesive=("LF",)), None
    if kind == "leap":
        return leap_class("leap-hard").draw(np.random.default_rng(0)), None
    if kind == "course":
        plan = stancekit.plan("walls", frames=3).solution
        return plan.problem, plan
    status = Status.FEASIBLE if kind == "posture" else Status.INFEASIBLE
    answers = map(stancekit.solve, stancekit.sample("wall-3", 20, rng=5))
    found = next(each for each in answers if each.status is status)
    return found.problem, found.solution or found.certificate


def seen(value: Any) -> Any:
    """A value of numbers, in which all fields can be compared."""
    if is_dataclass(value):
        return {each.name: seen(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, list | tuple):
        return [seen(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def judged(problem: Problem) -> Any:
    answer = asked("posture" if problem.is_posture else "course")[1]
    report = stancekit.verify(replace(answer, problem=problem))
    return [report.doubts, *((each.name, each.verdict, each.value) for each in report.groups)]


def screened(problem: Problem) -> Any:
    surrogate = Surrogate.read(shipped("surrogates")["surrogate-wall-3"])
    return surrogate.screen(PostureBatch.stacked([problem]), 0.005).scores.tolist()


def programmed(walk: Walk) -> Any:
    program = formulate(walk, GaitSettings(chart="decoupled"), None)
    bounds = [program.nlp.lower.tolist(), program.nlp.upper.tolist()]
    x = program.perturbed(np.random.default_rng(0), 0.3)
    parameters = np.concatenate([x, np.zeros(3), [1.0]])
    return bounds, program.guess.tolist(), np.ravel(program.nlp.constraint(x, parameters)).tolist()


WORDS = {"name", "modes"}
"""Of a course they stand in reports."""
DOUBTS = {"doubts"}
"""They stand beside answers, in reports and files."""
UNITS = {"length_scale_m", "force_scale_n"}
AIM = {"goal_m", "weights", "standing_m"}
"""What the best plan is, and not whether one is right."""
READERS: dict[str, tuple[Changes, type[Any], dict[str, tuple[Callable[[Any], Any], set[str]]]]] = {
    "posture": (
        POSTURE,
        Problem,
        {
            "file": (lambda p: p.to_json(), DOUBTS),
            "numbers": (lambda p: seen(Scaled.of(p)), DOUBTS),
            "batch": (lambda p: PostureBatch.stacked([asked("posture")[0], p]), set()),
            "screen": (screened, DOUBTS),
            "verify": (judged, UNITS),
        },
    ),
    "proof": (
        POSTURE,
        Problem,
        {
            "proof": (
                lambda p: str(stancekit.verify(asked("proof")[1].of(p)).figures),
                {"push_n", "weights"} | DOUBTS,
            )
        },
    ),
    "course": (
        COURSE,
        Problem,
        {
            "file": (lambda p: p.to_json(), set()),
            "numbers": (
                lambda p: seen(Scaled.of(p)),
                WORDS | DOUBTS | {"terrain", "standing_m", "sides"},
            ),
            "verify": (judged, WORDS | UNITS | AIM),
        },
    ),
    "leap": (
        LEAP,
        Leap,
        {
            "file": (leap_to_json, set()),
            "numbers": (lambda p: seen(LeapNumbers.of(p, 0)), set()),
        },
    ),
    "walk": (WALK, Walk, {"program": (programmed, set())}),
}
"""By question: a change of each field, and its readers with the fields that say nothing to them:
a proof without a push or an aim holds with it, too, and numbers have candidates in the place of terrain."""


def test_every_field_is_changed() -> None:
    for changes, kind, _ in READERS.values():
        assert set(changes) == {each.name for each in fields(kind)}


@pytest.mark.parametrize(
    ("kind", "field"), [(kind, field) for kind, (has, *_) in READERS.items() for field in has]
)
def test_no_reader_ignores_a_field(kind: str, field: str) -> None:
    changes, _, readers = READERS[kind]
    question = asked(kind)[0]
    try:
        other = replace(question, **{field: changes[field](question)})
    except InvalidInput:
        return  # nobody can be asked it
    for name, (read, without_say) in readers.items():
        try:
            answer = read(other)
        except InvalidInput:
            continue
        assert (answer != read(question)) != (field in without_say), name


def test_a_push_is_borne_or_the_posture_is_refused() -> None:
    problem, posture = asked("posture")
    least_n = float(stance_margins(posture)["push_n"][0])
    for share in (0.9, 1.1):
        pushed = replace(problem, push_n=share * least_n)
        assert stancekit.verify(replace(posture, problem=pushed)).accepted == (share < 1.0)
    assert stancekit.solve(replace(problem, push_n=0.9 * least_n)).solution is not None
    assert stancekit.solve(replace(asked("proof")[0], push_n=5.0)).status is Status.INFEASIBLE
