"""The methods that answer postures and courses: a value each, with its settings; their names; what is made of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, get_args, runtime_checkable

from ..arguments import check_argument
from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..files.arrays import check_numbers, checked_choice
from ..files.validation import shown
from ..plugins import Registry, foreign, takes
from ..projection.project import PROJECTIONS, Projection
from .answer import Acceptance, CoursePlanner, Planner

if TYPE_CHECKING:  # what a planner needs is imported when it is asked for: a command waits for nothing else
    from ..relaxation.envelope import EnvelopeSet
    from ..relaxation.modes import Modes

Solver = Literal["highs", "scip", "gurobi"]
EnvelopeUse = Literal["rows", "shrink"]
MOST_INTERVALS = 64
"""A finer grid takes minutes to write down and more memory than most machines have."""
POSTURE_LIMIT_S, COURSE_LIMIT_S = 30.0, 60.0
"""Time limits of one posture problem and of one course where none is given [s]."""
SETTINGS: Mapping[str, Any] = MappingProxyType(
    {
        "envelopes": None,
        "relaxation": None,
        "projection": None,
        "solver": "highs",
        "intervals": 4,
        "envelope_use": "rows",
        "gap": None,
    }
)
"""Settings of methods that a planner from elsewhere can be given, too, and what it reads where it was not."""


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """What every planner is made with beside the settings of its method.

    A planner from elsewhere is called with one, and reads settings as attributes, for example ``options.envelopes``.

    Arguments:
        time_limit_s: of one problem; ``POSTURE_LIMIT_S`` or ``COURSE_LIMIT_S`` where None [s].
        acceptance: when a claim counts.
        programs: compiled models to share; their engine solves the convex programs.
        settings: by name, for a planner from elsewhere, see ``SETTINGS``.
    Raises:
        InvalidInput: for a limit that is negative.
    """

    time_limit_s: float | None = None
    acceptance: Acceptance = field(default_factory=Acceptance)
    programs: Programs | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_numbers(self, least=("time_limit_s",))

    def __getattr__(self, name: str) -> Any:
        if name in SETTINGS:
            return self.settings.get(name, SETTINGS[name])
        raise AttributeError(f"PlannerOptions has no {name!r}")

    def limit(self, default_s: float) -> float:
        """The time limit, or this one where none was given [s]."""
        return default_s if self.time_limit_s is None else self.time_limit_s

    def check_unlimited(self, by: str) -> None:
        """Raise InvalidInput for a time limit. by: the method that has no use for one."""
        if self.time_limit_s is not None:
            raise InvalidInput(
                f"time_limit_s: expected none for {by}, which has no use for it, got {self.time_limit_s:g}"
            )


@runtime_checkable
class Method(Protocol):
    """A way to answer problems, with its settings, for example ``TwoStage(projection="fix-p")``."""

    name: ClassVar[str]

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner of postures. Raises InvalidInput where there is none, or settings do not fit it."""
        ...

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses. Raises InvalidInput likewise."""
        ...


@dataclass(frozen=True, kw_only=True)
class Exact:
    """Branch and bound to a verdict with its evidence; of courses to the best plan, for short ones.

    Arguments:
        gap: of courses, relative: a plan this close to the best counts as best.
        max_solves: convex solves of one answer at most, beside the limit of time; None for no such limit. With
            a ``time_limit_s`` that is never met, 1e6, the answer is the same on a busy computer.
    Raises:
        InvalidInput: for numbers that are negative.
    Source:
        Spatial branch and bound over E1-E11.
    Example:
        >>> import stancekit
        >>> stancekit.solve(stancekit.sample("wall-3", rng=8)[0], stancekit.Exact()).status.value
        'infeasible'
    """

    gap: float = 1e-3
    max_solves: int | None = None
    name: ClassVar[str] = "exact"

    def __post_init__(self) -> None:
        check_argument("gap", self.gap, float)
        check_argument("max_solves", self.max_solves, int | None)
        check_numbers(self, least=("gap", "max_solves"))

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner of postures."""
        from .exact import ExactPlanner

        _check_of_postures(self, "gap")
        return ExactPlanner(
            acceptance=options.acceptance,
            max_solves=self.max_solves,
            time_limit_s=options.limit(POSTURE_LIMIT_S),
            programs=options.programs,
        )

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses."""
        from .exact import ExactCoursePlanner

        return ExactCoursePlanner(
            gap=self.gap,
            max_solves=self.max_solves,
            time_limit_s=options.limit(COURSE_LIMIT_S),
            acceptance=options.acceptance,
            programs=options.programs,
        )


@dataclass(frozen=True, kw_only=True)
class TwoStage:
    """The two stages of paper E: P1, a convex relaxation, then P2, a projection onto the bilinear surface m = p·f.

    Arguments:
        relaxation: P1, a name of ``RELAXATIONS``; where None "p1" with envelopes, and without any the lift.
        envelopes: learned boxes that P1 is over; of courses also ``Modes``, between which stances choose.
        projection: P2, a name of ``PROJECTIONS``; None puts P1's own point to the verifier, of postures.
        reserve: of courses: plan with 80 % of the friction where that has a plan, else with 90 %, else with all.
        max_solves: of courses: convex solves of one search at most, beside the limit of time; None for no such limit.
            With a ``time_limit_s`` that is never met, 1e6, the plan is the same on a busy computer.
    Raises:
        InvalidInput: for an unknown name, envelopes that are missing, and envelopes that the lift has no use for.
    Source:
        Paper E §II, §III.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.TwoStage(projection="fix-p")).status.value
        'feasible'
    """

    relaxation: str | None = None
    envelopes: EnvelopeSet | Modes | None = None
    projection: Projection | None = "scp"
    reserve: bool = True
    max_solves: int | None = None
    name: ClassVar[str] = "two-stage"

    def __post_init__(self) -> None:
        from ..relaxation.envelope import EnvelopeSet
        from ..relaxation.modes import Modes
        from ..relaxation.table import RELAXATIONS

        check_argument("relaxation", self.relaxation, str | None)
        check_argument("envelopes", self.envelopes, EnvelopeSet | Modes | None)
        check_argument("projection", self.projection, str | None)
        check_argument("reserve", self.reserve, bool)
        check_argument("max_solves", self.max_solves, int | None)
        check_numbers(self, least=("max_solves",))
        if self.relaxation == "envelope":  # as plans had it
            object.__setattr__(self, "relaxation", "p1")
        if self.projection is not None:
            PROJECTIONS.get(self.projection)
        if self.relaxation is None:
            return
        over_boxes = RELAXATIONS.get(self.relaxation).over_boxes
        if over_boxes and self.envelopes is None:
            raise InvalidInput(f"envelopes: expected an envelope for the relaxation {self.relaxation}, got none")
        if not over_boxes and self.envelopes is not None:
            raise InvalidInput(f"envelopes: expected none for the {self.relaxation}, which has no use for them")

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner of postures."""
        from .posture import TwoStagePlanner

        options.check_unlimited(self.name)
        _check_of_postures(self, "reserve", "max_solves")
        return TwoStagePlanner(
            envelopes=_boxes(self.envelopes),
            relaxation=self.relaxation or "p1",
            projection=self.projection,
            acceptance=options.acceptance,
            programs=options.programs,
        )

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses."""
        if self.projection is None:
            raise InvalidInput("projection: expected one for courses, got none")
        made: dict[str, Any] = {
            "projection": self.projection,
            "reserve": self.reserve,
            "max_solves": self.max_solves,
            "time_limit_s": options.limit(COURSE_LIMIT_S),
            "acceptance": options.acceptance,
            "programs": options.programs,
        }
        if self.envelopes is None:
            from .two_stage import TwoStageCoursePlanner

            return TwoStageCoursePlanner(**made)
        from ..relaxation.mccormick import McCormick
        from ..relaxation.table import RELAXATIONS
        from .enveloped import EnvelopeCoursePlanner

        relaxation = RELAXATIONS.get(self.relaxation or "p1")
        if not (isinstance(relaxation, type) and issubclass(relaxation, McCormick)):
            raise InvalidInput(
                f"relaxation: expected one for courses, p1 or one derived from it, got {self.relaxation}"
            )
        return EnvelopeCoursePlanner(self.envelopes, relaxation=relaxation, **made)


@dataclass(frozen=True, kw_only=True)
class Micp:
    """A piecewise McCormick grid, mixed-integer; needs the extra exact for other solvers than HiGHS.

    Arguments:
        solver: "highs", "scip" or "gurobi".
        intervals: pieces of each axis of the grid, a power of two.
        envelopes: one learned box that the grid is over.
        envelope_use: of courses: the box as "rows", or to "shrink" the grid.
        gap: of courses, relative; None takes the first point.
        projection: of courses, P2 after the grid.
    Raises:
        InvalidInput: for a solver, a use or a projection that there is not, and for several envelopes.
    Source:
        Paper E §IV; the grid is that of piecewise McCormick envelopes.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Micp(intervals=2)).status.value
        'feasible'
    """

    solver: Solver = "highs"
    intervals: int = 4
    envelopes: EnvelopeSet | None = None
    envelope_use: EnvelopeUse = "rows"
    gap: float | None = None
    projection: Projection = "scp"
    name: ClassVar[str] = "micp"

    def __post_init__(self) -> None:
        from ..relaxation.envelope import EnvelopeSet
        from ..relaxation.modes import Modes

        check_argument("envelopes", self.envelopes, EnvelopeSet | Modes | None)
        check_argument("intervals", self.intervals, int)
        if self.intervals > MOST_INTERVALS:
            raise InvalidInput(f"intervals: expected {MOST_INTERVALS} or less, got {shown(self.intervals)}")
        check_argument("gap", self.gap, float | None)
        check_argument("projection", self.projection, str)
        checked_choice(self.solver, "solver", get_args(Solver))
        checked_choice(self.envelope_use, "envelope_use", get_args(EnvelopeUse))
        check_numbers(self, least=("gap",))
        PROJECTIONS.get(self.projection)
        if isinstance(self.envelopes, Modes):
            raise InvalidInput("envelopes: expected one envelope for micp, got modes")

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner of postures."""
        from ..relaxation.micp import MicpGrid
        from .micp import MicpPlanner

        _check_of_postures(self, "envelope_use", "gap", "projection")
        if self.envelopes is not None and len(self.envelopes.envelopes) > 1:
            raise InvalidInput(f"envelopes: expected one envelope for micp, got {len(self.envelopes.envelopes)}")
        return MicpPlanner(
            solver=self.solver,
            grid=MicpGrid(intervals=self.intervals),
            envelope=self.envelopes,
            time_limit_s=options.limit(POSTURE_LIMIT_S),
            acceptance=options.acceptance,
            programs=options.programs,
        )

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses."""
        from ..relaxation.micp import MicpGrid
        from .micp import MicpPlanner

        return MicpPlanner(
            solver=self.solver,
            grid=MicpGrid(intervals=self.intervals, envelope_use=self.envelope_use),
            envelope=self.envelopes,
            gap=self.gap,
            projection=self.projection,
            time_limit_s=options.limit(COURSE_LIMIT_S),
            acceptance=options.acceptance,
            programs=options.programs,
        )


@dataclass(frozen=True, kw_only=True)
class Nlp:
    """The nonlinear program as it is, solved by IPOPT.

    Source:
        Paper E §IV-A (NLP in Table I).
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Nlp()).status.value
        'feasible'
    """

    name: ClassVar[str] = "nlp"

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner of postures."""
        from .nlp import NlpPlanner

        limit_s = options.limit(POSTURE_LIMIT_S)
        return NlpPlanner(acceptance=options.acceptance, time_limit_s=limit_s, programs=options.programs)

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses."""
        from .nlp import NlpPlanner

        limit_s = options.limit(COURSE_LIMIT_S)
        return NlpPlanner(time_limit_s=limit_s, acceptance=options.acceptance, programs=options.programs)


@dataclass(frozen=True, kw_only=True)
class Decoupled:
    """Positions first and forces after, for courses: a baseline that fails on ice; done long before any time limit.

    Source:
        None: the common order of planners without forces.
    Example:
        >>> import stancekit
        >>> stancekit.plan("stairs", stancekit.Decoupled(), frames=3).status.value
        'feasible'
    """

    name: ClassVar[str] = "decoupled"

    def planner(self, options: PlannerOptions) -> Planner:
        """Raise InvalidInput."""
        raise InvalidInput("method: expected one for postures, got decoupled, which plans courses")

    def course_planner(self, options: PlannerOptions) -> CoursePlanner:
        """Make the planner of courses."""
        from .decoupled import DecoupledPlanner

        return DecoupledPlanner(acceptance=options.acceptance, programs=options.programs)


def _check_of_postures(method: Any, *of_courses: str) -> None:
    """Raise InvalidInput for a setting that postures have no use for, where it is not what it is by default."""
    for name in of_courses:
        came = getattr(method, name)
        if came != getattr(type(method), name):
            raise InvalidInput(
                f"{name}: expected none of {method.name} for postures, which have no use for it, got {came}"
            )


def p1(
    *,
    envelopes: EnvelopeSet | None = None,
    relaxation: str = "p1",
    projection: Projection | None = None,
) -> TwoStage:
    """P1 over envelopes without P2, unless a projection is named; what the text "p1" stands for."""
    return TwoStage(relaxation=relaxation, envelopes=envelopes, projection=projection)


def lift(*, projection: Projection | None = None) -> TwoStage:
    """The lift without P2, unless a projection is named; what the text "lift" stands for."""
    return TwoStage(relaxation="lift", projection=projection)


def _boxes(envelopes: EnvelopeSet | Modes | None) -> EnvelopeSet | None:
    """The envelopes of postures. Raises InvalidInput for modes, between which only courses can switch."""
    from ..relaxation.modes import Modes

    if isinstance(envelopes, Modes):
        raise InvalidInput("envelopes: expected envelopes, got modes, which are for courses")
    return envelopes


Make = Callable[..., Any]
OWN: Mapping[str, Make] = MappingProxyType(
    {
        "exact": Exact,
        "p1": p1,
        "lift": lift,
        "two-stage": TwoStage,
        "nlp": Nlp,
        "micp": Micp,
        "decoupled": Decoupled,
    }
)
METHODS = ("exact", "p1", "lift", "two-stage", "nlp", "micp")
"""The names of the package's own methods for postures."""
COURSE_METHODS = ("two-stage", "micp", "nlp", "decoupled", "exact")
"""The names of those for courses."""
COURSE_ALONE = ("reserve", "envelope_use", "gap")
"""Settings that concern courses alone; of ``Micp`` also its projection, of ``TwoStage`` its limit of solves."""


def _is_own(it: object) -> bool:
    """Whether it is one of the package's methods; what compares in a way of its own is asked nothing."""
    return any(it is one for one in OWN.values())


def _accepted(it: Any) -> bool:
    return _is_own(it) or takes(it, 1)


PLANNERS: Registry[Make] = Registry(
    "method",
    "stancekit.planners",
    {name: OWN[name] for name in METHODS},
    expected="something to call with PlannerOptions",
    accepts=_accepted,
)
"""All planners of postures: called with ``PlannerOptions``, a class or function gives something with ``solve``."""
COURSE_PLANNERS: Registry[Make] = Registry(
    "planner",
    "stancekit.course_planners",
    {name: OWN[name] for name in COURSE_METHODS},
    expected="something to call with PlannerOptions",
    accepts=_accepted,
)
"""All planners of courses, likewise."""


def settings_of(name: str, planners: Registry[Make] = PLANNERS) -> tuple[str, ...]:
    """The names of the settings that a method takes; of one from elsewhere all that there are.

    planners: ``PLANNERS`` or ``COURSE_PLANNERS``.
    """
    make = planners.get(name)
    if not _is_own(make):
        return tuple(SETTINGS)
    taken = tuple(inspect.signature(make).parameters)
    if planners is COURSE_PLANNERS:
        return taken
    more = "projection" if make is Micp else "max_solves" if make is TwoStage else ""
    return tuple(one for one in taken if one not in (*COURSE_ALONE, more))


def make_planner(method: str | Method, options: PlannerOptions = PlannerOptions(), **settings: Any) -> Planner:
    """Make a planner of postures.

    method: a value with its settings; or the text that stands for one, a name of ``PLANNERS`` or "FILE.py:NAME", with
    ``settings``. What is not the package's own answers through the verifier.
    Raises InvalidInput for an unknown method, a setting that it does not take, an envelope that is missing, or a solver
    that is not installed.
    """
    if not isinstance(method, str):
        return _checked(method, settings).planner(options)
    make = PLANNERS.get(method)
    if _is_own(make):
        return _value(make, method, settings, settings_of(method)).planner(options)
    from .verified import VerifiedPlanner

    with foreign(f"method {method}"):
        planner = make(_copied(options, POSTURE_LIMIT_S, settings))
    return VerifiedPlanner(planner, method, options.acceptance, settings.get("envelopes"))


def make_course_planner(
    method: str | Method, options: PlannerOptions = PlannerOptions(), **settings: Any
) -> CoursePlanner:
    """Make a planner of courses, likewise; names are those of ``COURSE_PLANNERS``."""
    if not isinstance(method, str):
        return _checked(method, settings).course_planner(options)
    make = COURSE_PLANNERS.get(method)
    if _is_own(make):
        taken = settings_of(method, COURSE_PLANNERS)
        return _value(make, method, settings, taken).course_planner(options)
    from .verified import VerifiedCoursePlanner

    whole_s = options.limit(COURSE_LIMIT_S)

    def remake(limit_s: float) -> CoursePlanner:
        limited = replace(options, time_limit_s=min(limit_s, whole_s))
        return make(_copied(limited, whole_s, settings))  # type: ignore[no-any-return]

    with foreign(f"planner {method}"):
        planner = remake(whole_s)
    return VerifiedCoursePlanner(planner, method, options.acceptance, remake)


def through_verifier(planner: Planner) -> Planner:
    """A planner of postures, which answers through the verifier unless it is the package's own."""
    if _is_of_the_package(planner):
        _check_answers(planner, "PostureProblem", "postures")
        return planner
    from .verified import VerifiedPlanner

    return VerifiedPlanner(planner, _called(planner), Acceptance())


def course_through_verifier(planner: CoursePlanner) -> CoursePlanner:
    """A planner of courses, likewise."""
    if _is_of_the_package(planner):
        _check_answers(planner, "Course", "courses")
        return planner
    from .verified import VerifiedCoursePlanner

    return VerifiedCoursePlanner(planner, _called(planner), Acceptance())


def _value(make: Make, name: str, settings: Mapping[str, Any], taken: tuple[str, ...]) -> Method:
    """The method of a text. Raises InvalidInput for a setting that it does not take."""
    for setting, value in settings.items():
        if setting not in taken and not (setting in SETTINGS and value == SETTINGS[setting]):
            came = shown(value) if isinstance(value, str | int | float) else type(value).__name__
            raise InvalidInput(f"{setting}: expected none for {name}, which has no use for it, got {came}")
    found: Method = make(**{name: value for name, value in settings.items() if name in taken})
    return found


def _checked(method: Method, settings: Mapping[str, Any]) -> Method:
    """A method that is a value, which has its settings already. Raises InvalidInput for others beside them."""
    if not isinstance(method, Method):
        raise InvalidInput(f"method: expected a name, or a method like TwoStage(), got {shown(method)}")
    if settings:
        raise InvalidInput(f"{next(iter(settings))}: expected none beside {method}, which has its settings")
    return method


def _is_of_the_package(planner: object) -> bool:
    return type(planner).__module__.startswith("stancekit.")


def _check_answers(planner: Any, kind: str, what: str) -> None:
    """Raise InvalidInput for a planner of the package whose ``solve`` says that it answers another kind of question."""
    asked = next(iter(inspect.signature(planner.solve).parameters.values())).annotation
    if isinstance(asked, str) and kind not in asked:
        raise InvalidInput(f"method: expected a planner of {what}, got {_called(planner)}, which answers a {asked}")


def _called(planner: object) -> str:
    return str(getattr(planner, "name", type(planner).__name__))


def _copied(options: PlannerOptions, limit_s: float, settings: Mapping[str, Any]) -> PlannerOptions:
    """Options for a planner from elsewhere, which may write to what it is given; with a time limit always."""
    engine = "rows" if options.programs is None else options.programs.engine
    return replace(
        options,
        programs=Programs(engine=engine),
        acceptance=replace(options.acceptance),
        time_limit_s=options.limit(limit_s),
        settings=dict(settings),
    )
