"""What a traverse is set up with: courses, the size of the views, planners to choose among, weights of the reward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course import Course
from stancekit.planners.problem.course_file import read_spec
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import expert_envelopes
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.course_features import CourseFeatures
from stancekit.planners.search.enveloped import EnvelopeCoursePlanner
from stancekit.planners.search.two_stage import TwoStageCoursePlanner

from .distributions.courses import perturbed

CourseSource = Callable[[np.random.Generator], Course]


class Executed(Protocol):
    """What an executor says: whether the robot did what was planned."""

    @property
    def succeeded(self) -> bool:
        """Whether it arrived, upright and without slipping."""


Executor = Callable[[Plan], Executed]


@dataclass(frozen=True, kw_only=True)
class TraverseWeights:
    """What a step is worth: reward = progress · (share of the path's length that the COM went forward along it)
    + feasible · [a verified plan] − failure · [none, or one whose execution failed] − solve · (convex problems solved)
    − second · (seconds of planning, compiling left out; with ``timing`` only).
    """

    progress: float = 1.0
    feasible: float = 0.1
    failure: float = 0.2
    solve: float = 0.005
    second: float = 0.1


def path_length_m(course: Course) -> float:
    """Length of the nominal path [m]; 1 where it does not move."""
    length = float(np.linalg.norm(np.diff(course.com_nominal_m, axis=0), axis=1).sum())
    return length if length > 1e-9 else 1.0


def course_source(
    courses: Sequence[str | CourseSpec] | CourseSource,
    frames: int | None,
    amount: float,
    horizon: int,
    limbs: int,
    regions: int | None,
    corners: int,
) -> tuple[CourseSource, CourseFeatures]:
    """What draws courses, and the size of their views. Raises InvalidInput."""
    if callable(courses):
        if regions is None:
            raise InvalidInput("regions: expected the most candidates of a toe where courses is a function, got None")
        return courses, CourseFeatures(limbs=limbs, horizon=horizon, regions=regions, corners=corners)
    specs = [read_spec(course) if isinstance(course, str) else course for course in courses]
    specs = [spec if frames is None else spec.with_frames(frames) for spec in specs]
    if not specs:
        raise InvalidInput("courses: expected one or more, got none")
    seen = regions or max(spec.candidates.count for spec in specs)

    def draw(rng: np.random.Generator) -> Course:
        return perturbed(specs[int(rng.integers(len(specs)))], rng, amount=amount)

    return draw, CourseFeatures(limbs=limbs, horizon=horizon, regions=seen, corners=corners)


def offered_planners(envelopes: Sequence[EnvelopeSet | Modes] | None, programs: Programs) -> Sequence[CoursePlanner]:
    """The two-stage planner over the lift, and over each of the envelopes."""
    if envelopes is None:
        envelopes = (expert_envelopes("ground"), expert_envelopes("wall"))
    return [
        TwoStageCoursePlanner(programs=programs),
        *(EnvelopeCoursePlanner(given, programs=programs) for given in envelopes),
    ]
