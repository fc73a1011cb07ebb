"""Setup of a traverse: courses, the size of the views, planners to choose among, weights of the
reward.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import check_numbers, checked, checked_int
from stancekit.planners.files.validation import shown, typed
from stancekit.planners.problem import Problem
from stancekit.planners.problem.candidates import NoFooting
from stancekit.planners.problem.course_file import read_spec, spec_from
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_terrain import FileTerrain
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import expert_envelopes
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.robot import hexapod
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.course_features import CourseFeatures
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.control.envelope_choice import SelectorPlanner

from .distributions.courses import perturbed
from .learned_selectors import LearnedSelector, class_envelopes

DRAWS = 50
"""Number of draws of a source that has nothing for some toe, before it is given up."""
CourseSource = Callable[[np.random.Generator], Problem]
Courses = Sequence[str | Path | CourseSpec | Mapping[str, Any]] | CourseSource
"""Sources of courses: names, files and descriptions, also as mappings with a file's keys; or a
function."""
Boxes = EnvelopeSet | Sequence[EnvelopeSet | str | Path] | Modes | LearnedSelector | str | Path
"""Boxes of a planner: envelopes, several sets of them for different legs, modes, a selector, or a
file of these."""
READERS: Mapping[str, str] = MappingProxyType(
    {
        ".json": "stancekit.planners.formats.answer_file:read_boxes",
        ".safetensors": "stancekit.learners.selectors.selector_file:load_selector",
        "": "stancekit.learners.selectors.selector_file:load_selector",  # the name of one that ships
    }
)
"""Readers of files by their endings, and of names, which have none; named, as in a registry,
because networks are read on a higher floor."""


Executor = Callable[[Plan], Any]
"""Executor of a plan: its report says by ``succeeded`` whether the robot arrived, upright and
without slipping."""


@dataclass(frozen=True, kw_only=True)
class TraverseWeights:
    """Weights of the reward of a step: reward = progress · (share of the path's length that the COM
    went forward along it) + feasible · [a verified plan] − failure · [none, or one whose execution
    failed] − solve · (convex problems solved) − second · (seconds of planning, compiling left out;
    with ``timing`` only).
    """

    progress: float = 1.0
    feasible: float = 0.1
    failure: float = 0.2
    solve: float = 0.005
    second: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(self, finite=self.__dataclass_fields__)


def path_length_m(course: Problem) -> float:
    """Length of the nominal path [m]; 1 where it does not move."""
    length = float(np.linalg.norm(np.diff(course.com_nominal_m, axis=0), axis=1).sum())
    return length if length > 1e-9 else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class TraverseSettings:
    """Keywords of ``TraverseEnv`` beside its courses; its page has their meaning.

    Raises InvalidInput for what is out of range or does not go together.
    """

    frames: int | None = 9
    horizon: int = 2
    amount: float = 1.0
    envelopes: Sequence[Boxes] | None = None
    planners: Sequence[Planner] | None = None
    weights: TraverseWeights | Mapping[str, float] = TraverseWeights()
    patience: int = 4
    limbs: int | None = None
    regions: int | None = None
    corners: int = 4
    robot: str | Path | None = None
    terrain: str | Path | None = None
    executor: Executor | None = None
    programs: Programs | None = None
    timing: bool = False
    margins: bool = False

    def __post_init__(self) -> None:
        for name, least in LEAST.items():
            if (value := getattr(self, name)) is not None:
                checked_int(value, name, least=least)
        checked(self.amount, "amount", least=0.0)
        if self.envelopes is not None and self.planners is not None:
            raise InvalidInput("envelopes: expected none beside planners, which replace them")
        _ = self.rewards  # refuses wrong keys

    @property
    def rewards(self) -> TraverseWeights:
        """The weights, read from a mapping where they came as one.

        Raises InvalidInput.
        """
        weights = self.weights
        return (
            weights
            if isinstance(weights, TraverseWeights)
            else typed(TraverseWeights, weights, "weights")
        )


LEAST: Mapping[str, int] = MappingProxyType(
    {"horizon": 1, "patience": 1, "corners": 3, "limbs": 1, "regions": 1}
)


def course_source(
    courses: Courses, settings: TraverseSettings
) -> tuple[CourseSource, CourseFeatures]:
    """Source that draws courses, and the size of their views: horizon, limbs, regions and corners,
    the courses' where None.

    robot, terrain of the settings: files in place of the courses' own. Raises InvalidInput.
    """
    robot, terrain = settings.robot, settings.terrain
    if not isinstance(courses, Sequence):
        if settings.regions is None:
            raise InvalidInput(
                "regions: expected the most candidates of a toe where courses is a function, got "
                "None"
            )
        if robot is not None or terrain is not None:
            raise InvalidInput(
                "robot, terrain: expected none where courses is a function, which has its own"
            )
        return partial(_with_footing, courses), _features(
            settings, limbs=len(hexapod().limbs), regions=0
        )
    specs = [_spec(course, robot, terrain) for course in courses]
    if settings.frames is not None:
        specs = [spec.with_frames(settings.frames) for spec in specs]
    if not specs:
        raise InvalidInput("courses: expected one or more, got none")
    most = max(spec.candidates.most for spec in specs)
    features = _features(settings, limbs=max(_limbs(spec) for spec in specs), regions=most)
    return Perturbed(specs=tuple(specs), amount=settings.amount), features


@dataclass(frozen=True, kw_only=True, eq=False)
class Perturbed:
    """A source that draws one of these courses, each as likely, and perturbs it."""

    specs: tuple[CourseSpec, ...]
    amount: float

    def __call__(self, rng: np.random.Generator) -> Problem:
        """Draw one.

        Raises PlanningFailed where none of many draws has footing for every toe.
        """
        return _with_footing(self._one, rng)

    def _one(self, rng: np.random.Generator) -> Problem:
        return perturbed(self.specs[int(rng.integers(len(self.specs)))], rng, amount=self.amount)


def _with_footing(draw: CourseSource, rng: np.random.Generator) -> Problem:
    """Draw a course, again where a scene of a family has nothing for some toe.

    Raises PlanningFailed after DRAWS.
    """
    for _ in range(DRAWS):
        try:
            return draw(rng)
        except NoFooting as error:
            refused = error
    raise PlanningFailed(
        f"no course in {DRAWS} draws with footing for every toe; the last: {refused}"
    )


def _features(settings: TraverseSettings, *, limbs: int, regions: int) -> CourseFeatures:
    return CourseFeatures(
        horizon=settings.horizon,
        corners=settings.corners,
        limbs=limbs if settings.limbs is None else settings.limbs,
        regions=regions if settings.regions is None else settings.regions,
    )


def _spec(
    course: str | Path | CourseSpec | Mapping[str, Any],
    robot: str | Path | None,
    terrain: str | Path | None,
) -> CourseSpec:
    """A course's description whose files are found from anywhere."""
    if isinstance(course, Mapping):
        spec = spec_from(dict(course))
    elif isinstance(course, str | Path):
        spec, folder = read_spec(str(course)), Path(course).parent
        if isinstance(spec.robot, str) and Path(spec.robot).suffix:
            spec = spec.model_copy(update={"robot": str((folder / spec.robot).resolve())})
        if isinstance(spec.terrain, FileTerrain):
            file = str((folder / spec.terrain.file).resolve())
            spec = spec.model_copy(
                update={"terrain": spec.terrain.model_copy(update={"file": file})}
            )
    else:
        spec = course
    if robot is not None:
        path = Path(robot)
        spec = spec.model_copy(update={"robot": str(path.resolve()) if path.suffix else str(robot)})
    if terrain is not None:
        terrain_file = FileTerrain(
            file=str(Path(terrain).resolve()), friction=spec.terrain.friction
        )
        spec = spec.model_copy(update={"terrain": terrain_file})
    return spec


def _limbs(spec: CourseSpec) -> int:
    return len(spec.make_robot().limbs)


def offered_planners(envelopes: Sequence[Boxes] | None, programs: Programs) -> Sequence[Planner]:
    """The two-stage planner over the lift, and over each of the envelopes.

    Raises InvalidInput.
    """
    if envelopes is None:
        envelopes = (expert_envelopes("ground"), expert_envelopes("wall"))
    return [
        TwoStagePlanner(programs=programs),
        *(_within(_there(each), programs) for each in envelopes),
    ]


def check_selectors(planners: Sequence[Planner], source: CourseSource) -> None:
    """Raise InvalidInput for a selector that no course has a stance for: it would be asked for
    nothing.

    Of a function, nobody knows before it draws.
    """
    if not isinstance(source, Perturbed):
        return
    for planner in planners:
        if isinstance(planner, SelectorPlanner):
            refused = [
                error for spec in source.specs if (error := _refusal(planner, spec)) is not None
            ]
            if len(refused) == len(source.specs):
                raise InvalidInput(
                    f"envelopes: expected a selector for the courses, got another: {refused[0]}"
                )


def _refusal(planner: SelectorPlanner, spec: CourseSpec) -> InvalidInput | None:
    """Why nothing of a course, as it is undisturbed, is for a selector; None where something is, or
    may be.
    """
    try:
        planner.check_fits(perturbed(spec, np.random.default_rng(0), amount=0.0))
    except NoFooting:
        return None
    except InvalidInput as error:
        return error
    return None


def _there(given: Boxes) -> EnvelopeSet | Sequence[EnvelopeSet] | Modes | LearnedSelector:
    """Envelopes that an entry of ``envelopes`` names, with its files read.

    Raises InvalidInput, also for a file in a list of sets that holds no set of envelopes.
    """
    if isinstance(given, str | Path):
        return _read(given)
    if not isinstance(given, Sequence):
        return given
    sets = []
    for each in given:
        one = _read(each) if isinstance(each, str | Path) else each
        if not isinstance(one, EnvelopeSet):
            raise InvalidInput(
                f"envelopes: expected sets of envelopes in a list of them, got {each}: "
                f"{type(one).__name__}"
            )
        sets.append(one)
    return sets


def _read(path: str | Path) -> EnvelopeSet | Modes | LearnedSelector:
    """Envelopes, modes or a selector from a file.

    Raises InvalidInput.
    """
    suffix = Path(path).suffix
    if suffix not in READERS:
        known = " or ".join(filter(None, READERS))
        raise InvalidInput(
            f"envelopes: expected a file that ends in {known}, got {shown(str(path))}"
        )
    choice: EnvelopeSet | Modes | LearnedSelector = resolve_name(READERS[suffix])(Path(path))
    return choice


def _within(
    given: EnvelopeSet | Sequence[EnvelopeSet] | Modes | LearnedSelector, programs: Programs
) -> Planner:
    if isinstance(given, EnvelopeSet | Modes | Sequence):
        return TwoStagePlanner(given, programs=programs)
    return SelectorPlanner(given.selector, class_envelopes(given), programs=programs)
