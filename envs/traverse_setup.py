"""What a traverse is set up with: courses, the size of the views, planners to choose among, weights of the reward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem.candidates import NoFooting
from stancekit.planners.problem.course import Course
from stancekit.planners.problem.course_file import read_spec
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_terrain import FileTerrain
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import expert_envelopes
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.robot import hexapod
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.course_features import CourseFeatures
from stancekit.planners.search.enveloped import EnvelopeCoursePlanner
from stancekit.planners.search.two_stage import TwoStageCoursePlanner

from .distributions.courses import perturbed

DRAWS = 50
"""Of a source that has nothing for some toe, before it is given up."""
CourseSource = Callable[[np.random.Generator], Course]
Boxes = EnvelopeSet | Sequence[EnvelopeSet] | Modes
"""What one choice of a planner has: envelopes, several sets of them for different legs, or modes."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class TraverseSettings:
    """Keywords of ``TraverseEnv`` beside its courses; its page has their meaning. Raises InvalidInput."""

    frames: int | None = 9
    horizon: int = 2
    amount: float = 1.0
    envelopes: Sequence[Boxes] | None = None
    planners: Sequence[CoursePlanner] | None = None
    weights: TraverseWeights = TraverseWeights()
    patience: int = 4
    limbs: int | None = None
    regions: int | None = None
    corners: int = 4
    robot: str | Path | None = None
    terrain: str | Path | None = None
    executor: Executor | None = None
    programs: Programs | None = None
    timing: bool = False

    def __post_init__(self) -> None:
        for name, least in (("horizon", 1), ("patience", 1), ("corners", 3)):
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise InvalidInput(f"{name}: expected {least} or more, got {value!r}")


def course_source(
    courses: Sequence[str | CourseSpec] | CourseSource, settings: TraverseSettings
) -> tuple[CourseSource, CourseFeatures]:
    """What draws courses, and the size of their views: horizon, limbs, regions and corners, the courses' where None.

    robot, terrain of the settings: files in place of the courses' own. Raises InvalidInput.
    """
    robot, terrain = settings.robot, settings.terrain
    if callable(courses):
        if settings.regions is None:
            raise InvalidInput("regions: expected the most candidates of a toe where courses is a function, got None")
        if robot is not None or terrain is not None:
            raise InvalidInput("robot, terrain: expected none where courses is a function, which has its own")
        return _with_footing(courses), _features(settings, limbs=len(hexapod().limbs), regions=0)
    specs = [_spec(course, robot, terrain) for course in courses]
    if settings.frames is not None:
        specs = [spec.with_frames(settings.frames) for spec in specs]
    if not specs:
        raise InvalidInput("courses: expected one or more, got none")

    def draw(rng: np.random.Generator) -> Course:
        return perturbed(specs[int(rng.integers(len(specs)))], rng, amount=settings.amount)

    most = max(spec.candidates.most for spec in specs)
    return _with_footing(draw), _features(settings, limbs=max(_limbs(spec) for spec in specs), regions=most)


def _with_footing(draw: CourseSource) -> CourseSource:
    """The same source, asked again where a scene of a family has nothing for some toe. It may raise PlanningFailed."""

    def again(rng: np.random.Generator) -> Course:
        for _ in range(DRAWS):
            try:
                return draw(rng)
            except NoFooting as error:
                refused = error
        raise PlanningFailed(f"no course in {DRAWS} draws with footing for every toe; the last: {refused}")

    return again


def _features(settings: TraverseSettings, *, limbs: int, regions: int) -> CourseFeatures:
    return CourseFeatures(
        horizon=settings.horizon, corners=settings.corners,
        limbs=limbs if settings.limbs is None else settings.limbs,
        regions=regions if settings.regions is None else settings.regions,
    )  # fmt: skip


def _spec(course: str | CourseSpec, robot: str | Path | None, terrain: str | Path | None) -> CourseSpec:
    """A course's description whose files are found from anywhere."""
    if isinstance(course, str):
        spec, folder = read_spec(course), Path(course).parent
        if isinstance(spec.robot, str) and Path(spec.robot).suffix:
            spec = spec.model_copy(update={"robot": str((folder / spec.robot).resolve())})
        if isinstance(spec.terrain, FileTerrain):
            file = str((folder / spec.terrain.file).resolve())
            spec = spec.model_copy(update={"terrain": spec.terrain.model_copy(update={"file": file})})
    else:
        spec = course
    if robot is not None:
        path = Path(robot)
        spec = spec.model_copy(update={"robot": str(path.resolve()) if path.suffix else str(robot)})
    if terrain is not None:
        found = FileTerrain(file=str(Path(terrain).resolve()), friction=spec.terrain.friction)
        spec = spec.model_copy(update={"terrain": found})
    return spec


def _limbs(spec: CourseSpec) -> int:
    model = spec.robot_model()
    return len(spec.make_robot().limbs) if model is None else len(model.legs)


def offered_planners(envelopes: Sequence[Boxes] | None, programs: Programs) -> Sequence[CoursePlanner]:
    """The two-stage planner over the lift, and over each of the envelopes."""
    if envelopes is None:
        envelopes = (expert_envelopes("ground"), expert_envelopes("wall"))
    return [
        TwoStageCoursePlanner(programs=programs),
        *(EnvelopeCoursePlanner(given, programs=programs) for given in envelopes),
    ]
