"""Traverse-v0: a course walked window by window, by the planner that the agent chooses for the
coming key frames.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from stancekit.planners.answer.answer import Answer, Effort, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import check_argument, settings_from
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import checked, checked_int
from stancekit.planners.files.documents import shown
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import NoFooting
from stancekit.planners.problem.course_file import read_spec, spec_from
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_terrain import FileTerrain
from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.relaxation.envelope import EnvelopeSet, expert_envelopes
from stancekit.planners.robot import hexapod
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.choice import CourseFeatures, Features
from stancekit.planners.search.pieces import Standing, joined
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.runner.control.envelope_choice import SelectorPlanner

from .distributions.courses import perturbed
from .episodes import Finite, Step, TaskEnv, boxes, checked_action, weighted
from .scenes import margin_info
from .selection import LearnedSelector, class_envelopes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CourseSource = Callable[[np.random.Generator], Problem]
Courses = Sequence[str | Path | CourseSpec | Mapping[str, Any]] | _CourseSource
"""Sources of courses: names, files and descriptions, also as mappings with a file's keys; or a
function."""
_Boxes = EnvelopeSet | Sequence[EnvelopeSet | str | Path] | Modes | LearnedSelector | str | Path
"""Boxes of a planner: envelopes, several sets of them for different legs, modes, a selector, or a
file of these."""
_READERS: Mapping[str, str] = MappingProxyType(
    {
        ".json": "stancekit.planners.formats.question_file:read_boxes",
        ".safetensors": "stancekit.learners.selectors.selector:load_selector",
        "": "stancekit.learners.selectors.selector:load_selector",  # the name of one that ships
    }
)
"""Readers of files by their endings, and of names, which have none; named, as in a registry,
because networks are read on a higher floor."""


_Executor = Callable[[Plan], Any]
"""Executor of a plan: its report says by ``succeeded`` whether the robot arrived, upright and
without slipping."""


@dataclass(frozen=True, kw_only=True)
class TraverseWeights(Finite):
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


def _path_length_m(course: Problem) -> float:
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
    envelopes: Sequence[_Boxes] | None = None
    planners: Sequence[Planner] | None = None
    weights: TraverseWeights | Mapping[str, float] = TraverseWeights()
    patience: int = 4
    limbs: int | None = None
    regions: int | None = None
    corners: int = 4
    robot: str | Path | None = None
    terrain: str | Path | None = None
    executor: _Executor | None = None
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
        weighted(self.weights, TraverseWeights)  # refuses wrong keys


LEAST: Mapping[str, int] = MappingProxyType(
    {"horizon": 1, "patience": 1, "corners": 3, "limbs": 1, "regions": 1}
)


def _course_source(
    courses: Courses, settings: TraverseSettings
) -> tuple[_CourseSource, CourseFeatures]:
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
    features = _features(
        settings, limbs=max(len(spec.make_robot().limbs) for spec in specs), regions=most
    )
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


def _with_footing(draw: _CourseSource, rng: np.random.Generator) -> Problem:
    """Draw a course, again where a scene of a family has nothing for some toe.

    Raises PlanningFailed after MAX_DRAWS.
    """
    for _ in range(MAX_DRAWS):
        try:
            return draw(rng)
        except NoFooting as error:
            refused = error
    raise PlanningFailed(
        f"no course in {MAX_DRAWS} draws with footing for every toe; the last: {refused}"
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


def _offered_planners(envelopes: Sequence[_Boxes] | None, programs: Programs) -> Sequence[Planner]:
    """The two-stage planner over the lift, and over each of the envelopes.

    Raises InvalidInput.
    """
    if envelopes is None:
        envelopes = (expert_envelopes("ground"), expert_envelopes("wall"))
    return [
        TwoStage(programs=programs),
        *(_within(_there(each), programs) for each in envelopes),
    ]


def _check_selectors(planners: Sequence[Planner], source: _CourseSource) -> None:
    """Raise InvalidInput for a selector that no course has a stance for: it would never be used.

    For a function this is unknown until it draws.
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


def _there(given: _Boxes) -> EnvelopeSet | Sequence[EnvelopeSet] | Modes | LearnedSelector:
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
    if suffix not in _READERS:
        known = " or ".join(filter(None, _READERS))
        raise InvalidInput(
            f"envelopes: expected a file that ends in {known}, got {shown(str(path))}"
        )
    choice: EnvelopeSet | Modes | LearnedSelector = resolve_name(_READERS[suffix])(Path(path))
    return choice


def _within(
    given: EnvelopeSet | Sequence[EnvelopeSet] | Modes | LearnedSelector, programs: Programs
) -> Planner:
    if isinstance(given, EnvelopeSet | Modes | Sequence):
        return TwoStage(envelopes=given, programs=programs)
    return SelectorPlanner(given.selector, class_envelopes(given), programs=programs)


LOG = logging.getLogger(__name__)
MAX_DRAWS = 50
"""Draws until a course that offers every toe something, and until one whose first key frame holds."""
NO_MODE = -1
"""In ``info``: a frame beyond the course's end, or a course that does not say its modes."""


class TraverseEnv(TaskEnv[Problem]):
    """Choose who plans the next key frames of a climb, and be moved there.

    ## Description

    A course of M key frames (Lin et al. §IV-B) an episode. One step: see the coming candidate
    patches, choose a planner for the next ``horizon`` key frames, be moved there if it finds a plan
    that the verifier accepts together with what was walked before. Where it finds none the robot
    stays, and the agent may choose again.

    ## Observation Space

    A ``Dict`` of flat float32 ``Box``es, with H = ``horizon``, N = ``limbs``, R = ``regions``, U =
    ``corners``; lengths in the course's length scale, places as seen from the COM:

    | name | shape | meaning |
    |---|---|---|
    | corners | (H * N * R * U * 3,) | candidate patches of the limb's next toe, by coming frame, limb and candidate |
    | normals | (H * N * R * 3,) | their normals |
    | friction | (H * N * R,) | and friction |
    | offered | (H * N * R,) | 1 where there is a candidate, 0 where the rest is zero |
    | toes | (3 * N,) | where the toes stand |
    | footing | (3 * N,) | the normals there |
    | grip | (N,) | and the friction |
    | shoulders | (3 * N,) | shoulders in the body frame |
    | reach | (N,) | Δ_FK of the limbs |
    | path | (3 * H,) | the nominal COM at the coming frames, the last one repeated |
    | goal | (3,) | where the COM should end |
    | left | (1,) | share of the frames that are left |

    ## Action Space

    ``Discrete``: 0 is the two-stage planner over the lift, 1 and up over the envelopes given,
    several sets of them, or those that a selector chooses for the stances ahead.

    ## Reward

    progress · (share of the path's length that the COM went forward along it) + feasible · [a
    verified plan] − failure · [none, or one whose execution failed] − solve · (convex problems
    solved) − second · (seconds of planning, with ``timing`` only), with the weights of
    ``TraverseWeights``.

    ## Starting State

    The first key frame of one of ``courses``, perturbed by ``amount``; courses whose first frame
    does not hold are drawn again.

    ## Episode End

    Terminated at the last frame, where it is proved that no plan goes on from here, and where an
    execution fails. Truncated after ``patience`` steps without a plan, counted over the whole
    episode.

    ## Info

    After a reset and a step (numeric, fixed shapes): ``feasible``, ``infeasible`` (proved),
    ``refused`` (the envelope was not learned for these limbs or patches), ``planner`` (whose plan
    it is, by its action, −1 where there is none), ``executed`` (1 done, 0 failed, −1 not tried),
    ``is_success`` (at the last frame, no execution failed), ``frame``, ``solves``, ``progress_m``,
    ``objective``, ``residual``, ``com_m`` (3,), ``toes_m`` (N, 3), ``terrain_modes`` (H,): the mode
    of the terrain under each coming frame, −1 where unknown; ``reward_<term>``; ``plan_seconds``,
    ``compile_seconds``, which stay 0 unless ``timing``; and of the window's stances the least
    ``push_n`` (horizontal push at the body that is borne in every direction), ``support_m``
    (distance from the centre of mass to the border of support) and ``friction_left`` (share of the
    friction that is not needed), which stay 0 unless ``margins``, and where there is no plan.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | courses | ('stairs', 'walls', 'ground-to-wall') | names, FAMILY:LEVEL, files, keys as in one; or a function |
    | frames | 9 | M of each, None for its own |
    | horizon | 2 | key frames a step |
    | amount | 1.0 | how far a course is perturbed; 1 keeps the built-in ones climbable |
    | envelopes | None | what to offer beside the lift, see below; the expert's for walking and climbing where None |
    | planners | None | replaces all of these |
    | weights | TraverseWeights() | what a step is worth; or a mapping with some of its keys, and terms of your own |
    | patience | 4 | steps without a plan, in all, after which an episode is truncated |
    | limbs | None | of the observation: how many limbs; those of the courses' robots where None |
    | regions | None | the most candidates a toe; those of the courses where None |
    | corners | 4 | the most corners a patch |
    | robot | None | in place of the courses': a built-in name, a URDF, a YAML file |
    | terrain | None | a mesh in place of the courses' terrain |
    | executor | None | plays the plan of every window on a world, each from a standing start |
    | programs | None | compiled models to share with other environments of this process |
    | timing | False | put seconds into ``info`` and the reward |
    | margins | False | measure the margins in ``info``, half a millisecond per stance with numba |
    | render_mode | None | "rgb_array" |

    Each entry of ``envelopes`` is one more action: a set of envelopes, a list of sets for different
    legs, modes, or a selector (what ``fit`` returned; a network chooses its boxes for every stance
    ahead). In place of each of these its file will do, also in a list of sets, and so will the name
    of one that ships. A selector that has a stance in none of the courses is refused. A window with
    a stance that an entry was not learned for is ``refused``: the logger ``stancekit`` names the
    stance at the level INFO.

    ## Version History

    - v0: the first version
    """

    def __init__(
        self,
        courses: Courses = ("stairs", "walls", "ground-to-wall"),
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(render_mode)
        check_argument("courses", courses, Courses)
        settings = settings_from(TraverseSettings, options, beside=("courses", "render_mode"))
        self._draw, self._features = _course_source(courses, settings)
        programs = settings.programs or Programs()
        planners = settings.planners
        self._planners = tuple(
            _offered_planners(settings.envelopes, programs) if planners is None else planners
        )
        if not self._planners:
            raise InvalidInput("planners: expected one or more, got none")
        _check_selectors(self._planners, self._draw)
        self._start, self._executor = TwoStage(programs=programs), settings.executor
        self._horizon = settings.horizon
        self._weights, self._terms = weighted(settings.weights, TraverseWeights)
        self._patience, self._timing = settings.patience, bool(settings.timing)
        self._margins = bool(settings.margins)
        self._walked: list[Plan] = []
        self._frame = self._vain = 0
        self.observation_space = boxes(self._features.bounds())
        self.action_space = spaces.Discrete(len(self._planners))
        if self._terms.by_key:
            course = self._draw(np.random.default_rng(0))
            plan = replan(None, course, horizon=0, planner=self._start).solution
            if plan is not None:
                self._walked = [plan]
                self._try_terms(course, self._info(course, _Try()))
                self._walked = []

    def _begin(self) -> tuple[Problem, dict[str, Any]]:
        """Draw courses until one has a first key frame that holds.

        Raises PlanningFailed after MAX_DRAWS.
        """
        for _ in range(MAX_DRAWS):
            course = self._draw(self.np_random)
            if course.frames < 2:
                raise InvalidInput(
                    f"course: expected two or more frames to go, got {course.frames}"
                )
            plan = replan(None, course, horizon=0, planner=self._start).solution
            if plan is not None:
                self._walked, self._frame, self._vain = [plan], 0, 0
                return course, self._info(course, _Try())
        raise PlanningFailed(f"no course in {MAX_DRAWS} draws whose first key frame holds")

    def _act(self, episode: Problem, action: np.int64) -> Step:
        """Let the chosen planner plan the next window; go there if it can."""
        chosen = int(checked_action(action, self.action_space))
        course, begin = episode, self._frame
        tried = self._try(course, chosen)
        if tried.plan is not None:
            self._walked = [
                *self._walked,
                tried.plan,
            ]  # a new list: a copy of the environment is a state to go back to
            self._frame += tried.plan.problem.frames - 1
        self._vain += tried.plan is None
        terminated = tried.infeasible or tried.executed == 0 or self._frame == course.frames - 1
        truncated = not terminated and self._vain >= self._patience
        info = self._info(course, tried, begin)
        return Step(
            reward=sum(value for name, value in info.items() if name.startswith("reward_")),
            terminated=terminated,
            truncated=truncated,
            info=info,
            question=course,
            answer=tried.plan,
            action=action,
        )

    def _drawn(self, episode: Problem) -> Figure:
        """The path so far over the course."""
        from stancekit.views.plans import draw_plan

        caption = f"{episode.name}: key frame {self._frame} of {episode.frames - 1}"
        return draw_plan(self.walk(), caption=caption, size_px=(960, 720))

    def walk(self) -> Plan:
        """The plan of everything that was walked in this episode, from the first key frame on."""
        return joined(self._now("asking for the walk"), self._walked)

    def _try(self, course: Problem, chosen: int) -> _Try:
        """Plan the next window, have the walk with it verified, execute it."""
        state, planner = Standing.at_end(self._walked[-1]), self._planners[chosen]
        try:
            outcome = replan(
                state, course, frame=self._frame, horizon=self._horizon, planner=planner
            )
        except InvalidInput as error:  # not learned for these limbs or patches
            LOG.info("Traverse-v0: action %d is refused: %s", chosen, error)
            return _Try(refused=True)
        plan = outcome.solution
        if plan is not None and not check_plan(joined(course, [*self._walked, plan])).accepted:
            plan = None  # it holds by itself, but cannot be reached from where the last one ended
        executed = (
            -1 if plan is None or self._executor is None else int(self._executor(plan).succeeded)
        )
        return _Try(
            outcome=outcome, plan=plan, executed=executed, planner=-1 if plan is None else chosen
        )

    def _observe(self, episode: Problem) -> Features:
        return self._features.observe(episode, self._frame, Standing.at_end(self._walked[-1]))

    def _info(self, course: Problem, tried: _Try, begin: int = 0) -> dict[str, Any]:
        weights, standing = self._weights, Standing.at_end(self._walked[-1])
        coming = range(self._frame + 1, self._frame + 1 + self._horizon)
        modes, outcome, clock = course.modes or (), tried.outcome, float(self._timing)
        effort = Effort() if outcome is None else outcome.effort
        seconds = clock * effort.seconds
        return {
            "feasible": int(tried.plan is not None),
            "infeasible": int(tried.infeasible),
            "refused": int(tried.refused),
            "planner": tried.planner,
            "executed": tried.executed,
            "is_success": int(self._frame == course.frames - 1 and tried.executed != 0),
            "frame": self._frame,
            "solves": effort.solves,
            "progress_m": tried.progress_m,
            "objective": 0.0 if tried.plan is None or outcome is None else float(outcome.objective),
            "residual": 0.0 if tried.plan is None or outcome is None else float(outcome.residual),
            "com_m": np.array(standing.com_m),
            "toes_m": np.array(standing.toes_m),
            "terrain_modes": np.array([modes[k] if k < len(modes) else NO_MODE for k in coming]),
            "reward_progress": weights.progress * tried.progress_m / _path_length_m(course),
            "reward_feasible": weights.feasible * (tried.plan is not None),
            "reward_failure": -weights.failure * tried.failed,
            "reward_effort": -weights.solve * effort.solves - weights.second * seconds,
            "plan_seconds": seconds,
            "compile_seconds": clock * effort.compile_s,
            **margin_info(tried.plan if self._margins else None),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Try:
    """Outcome of planning a window; all fields have their defaults where nothing was tried."""

    outcome: Answer[Plan] | None = None
    plan: Plan | None = None
    refused: bool = False
    executed: int = -1
    planner: int = -1

    @property
    def infeasible(self) -> bool:
        """It is proved that there is no plan."""
        return self.outcome is not None and self.outcome.status is Status.INFEASIBLE

    @property
    def failed(self) -> bool:
        """No plan, or one that did not work."""
        return (
            self.refused or self.executed == 0 or (self.outcome is not None and self.plan is None)
        )

    @property
    def progress_m(self) -> float:
        """Distance that the COM went forward along its nominal path [m]."""
        if self.plan is None:
            return 0.0
        course, steps = self.plan.problem, np.diff(self.plan.com_m, axis=0)
        return float(sum(step @ course.direction(k) for k, step in enumerate(steps, 1)))
