"""The planners of postures and of courses by name, and what each of them needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, get_args

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

Relaxation = Literal["lift", "envelope"]
RELAXATIONS: tuple[Relaxation, ...] = get_args(Relaxation)
Solver = Literal["highs", "scip", "gurobi"]
EnvelopeUse = Literal["rows", "shrink"]
COMMON = ("acceptance", "programs")
"""Options that every method takes."""
POSTURE_LIMIT_S, COURSE_LIMIT_S = 30.0, 60.0
"""Time limits of one posture problem and of one course where none is given [s]."""


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """The options that a planner is made with; ``METHODS`` and ``COURSE_METHODS`` say which of them each method takes.

    Arguments:
        envelopes: learned boxes; of courses also ``Modes``.
        relaxation: of courses, P1 of ``two-stage``.
        projection: P2; the method's own where None.
        solver, intervals: of ``micp``.
        envelope_use: of ``micp`` over courses.
        gap: relative, of ``micp`` and ``exact`` over courses; None takes the first point, or the default.
        time_limit_s: of one problem; ``POSTURE_LIMIT_S`` or ``COURSE_LIMIT_S`` where None [s].
        acceptance: when a claim counts.
        programs: to share; their engine solves the convex programs.
    Raises:
        InvalidInput: for a name that there is not, and a number out of range.
    """

    envelopes: EnvelopeSet | Modes | None = None
    relaxation: Relaxation | None = None
    projection: Projection | None = None
    solver: str = "highs"
    intervals: int = 4
    envelope_use: EnvelopeUse = "rows"
    gap: float | None = None
    time_limit_s: float | None = None
    acceptance: Acceptance = field(default_factory=Acceptance)
    programs: Programs | None = None

    def __post_init__(self) -> None:
        checked_choice(self.solver, "solver", get_args(Solver))
        checked_choice(self.envelope_use, "envelope_use", get_args(EnvelopeUse))
        check_numbers(self, least=("time_limit_s", "gap"))
        if self.relaxation is not None:
            checked_choice(self.relaxation, "relaxation", RELAXATIONS)
        if self.projection is not None:
            PROJECTIONS.get(self.projection)

    def limit(self, default_s: float) -> float:
        """The time limit, or this one where none was given [s]."""
        return default_s if self.time_limit_s is None else self.time_limit_s

    def check_used(self, by: str, taken: tuple[str, ...]) -> None:
        """Raise InvalidInput for an option that was given and that a method does not take.

        by: the method, for the message. taken: names of the options that it takes, beside ``COMMON``.
        """
        for option in fields(self):
            value = getattr(self, option.name)
            if option.name not in (*taken, *COMMON) and value is not option.default and value != option.default:
                came = shown(value) if isinstance(value, str | int | float) else type(value).__name__
                raise InvalidInput(f"{option.name}: expected none for {by}, which has no use for it, got {came}")

    @property
    def boxes(self) -> EnvelopeSet | None:
        """The envelopes. Raises InvalidInput for modes, between which only a planner of courses can switch."""
        from ..relaxation.modes import Modes

        if isinstance(self.envelopes, Modes):
            raise InvalidInput("envelopes: expected envelopes, got modes, which are for courses")
        return self.envelopes


def _exact(options: PlannerOptions) -> Planner:
    from .exact import ExactPlanner

    return ExactPlanner(
        acceptance=options.acceptance, time_limit_s=options.limit(POSTURE_LIMIT_S), programs=options.programs
    )


def _p1(options: PlannerOptions) -> Planner:
    if options.envelopes is None:
        raise InvalidInput("envelope: expected an envelope file for the method p1, got none")
    return _staged(options, options.boxes, options.projection)


def _lift(options: PlannerOptions) -> Planner:
    return _staged(options, None, options.projection)


def _two_stage(options: PlannerOptions) -> Planner:
    return _staged(options, options.boxes, options.projection or "scp")


def _staged(options: PlannerOptions, envelopes: EnvelopeSet | None, projection: Projection | None) -> Planner:
    from .posture import TwoStagePlanner

    return TwoStagePlanner(
        envelopes=envelopes, projection=projection, acceptance=options.acceptance, programs=options.programs
    )


def _nlp(options: PlannerOptions) -> Planner:
    from .nlp import NlpPlanner

    limit_s = options.limit(POSTURE_LIMIT_S)
    return NlpPlanner(acceptance=options.acceptance, time_limit_s=limit_s, programs=options.programs)


def _micp(options: PlannerOptions) -> Planner:
    from ..relaxation.micp import Grid
    from .micp import MicpPlanner

    boxes = options.boxes
    if boxes is not None and len(boxes.envelopes) > 1:
        raise InvalidInput(f"envelope: expected one envelope for micp, got {len(boxes.envelopes)}")
    return MicpPlanner(
        solver=options.solver, grid=Grid(intervals=options.intervals), envelope=boxes,
        time_limit_s=options.limit(POSTURE_LIMIT_S), acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


def _course_two_stage(options: PlannerOptions) -> CoursePlanner:
    projection = options.projection or "scp"
    if options.envelopes is not None:
        from .enveloped import EnvelopeCoursePlanner

        return EnvelopeCoursePlanner(
            options.envelopes, projection=projection, time_limit_s=options.limit(COURSE_LIMIT_S),
            acceptance=options.acceptance, programs=options.programs,
        )  # fmt: skip
    from .two_stage import TwoStageCoursePlanner

    return TwoStageCoursePlanner(
        projection=projection, time_limit_s=options.limit(COURSE_LIMIT_S), acceptance=options.acceptance,
        programs=options.programs,
    )  # fmt: skip


def _course_micp(options: PlannerOptions) -> CoursePlanner:
    from ..relaxation.micp import Grid
    from ..relaxation.modes import Modes
    from .micp import MicpPlanner

    if isinstance(options.envelopes, Modes):
        raise InvalidInput("envelopes: expected one envelope for micp, got modes")
    return MicpPlanner(
        solver=options.solver, grid=Grid(intervals=options.intervals, envelope_use=options.envelope_use),
        envelope=options.envelopes, gap=options.gap, projection=options.projection or "scp",
        time_limit_s=options.limit(COURSE_LIMIT_S), acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


def _course_nlp(options: PlannerOptions) -> CoursePlanner:
    from .nlp import NlpPlanner

    limit_s = options.limit(COURSE_LIMIT_S)
    return NlpPlanner(time_limit_s=limit_s, acceptance=options.acceptance, programs=options.programs)


def _course_decoupled(options: PlannerOptions) -> CoursePlanner:
    from .decoupled import DecoupledPlanner

    return DecoupledPlanner(acceptance=options.acceptance, programs=options.programs)


def _course_exact(options: PlannerOptions) -> CoursePlanner:
    from .exact import ExactCoursePlanner

    return ExactCoursePlanner(
        gap=1e-3 if options.gap is None else options.gap, time_limit_s=options.limit(COURSE_LIMIT_S),
        acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


EVERY_OPTION = tuple(option.name for option in fields(PlannerOptions))
METHODS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "exact": ("time_limit_s",),
        "p1": ("envelopes", "projection"),
        "lift": ("projection",),
        "two-stage": ("envelopes", "projection"),
        "nlp": ("time_limit_s",),
        "micp": ("envelopes", "solver", "intervals", "time_limit_s"),
    }
)
"""The planners of postures that are the package's own, and the options that each takes beside ``COMMON``."""
COURSE_METHODS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "two-stage": ("envelopes", "relaxation", "projection", "time_limit_s"),
        "micp": ("envelopes", "projection", "solver", "intervals", "envelope_use", "gap", "time_limit_s"),
        "nlp": ("time_limit_s",),
        "decoupled": ("time_limit_s",),  # ends long before any: a handful of convex programs
        "exact": ("gap", "time_limit_s"),
    }
)
"""And those of courses."""
PLANNERS: Registry[Callable[[PlannerOptions], Planner]] = Registry(
    "method", "stancekit.planners", {name: f"{__name__}:_{name.replace('-', '_')}" for name in METHODS},
    expected="something to call with PlannerOptions", accepts=lambda it: takes(it, 1),
)  # fmt: skip
"""All planners of postures: called with ``PlannerOptions``, a class or function gives something with ``solve``."""
COURSE_PLANNERS: Registry[Callable[[PlannerOptions], CoursePlanner]] = Registry(
    "planner", "stancekit.course_planners",
    {name: f"{__name__}:_course_{name.replace('-', '_')}" for name in COURSE_METHODS},
    expected="something to call with PlannerOptions", accepts=lambda it: takes(it, 1),
)  # fmt: skip
"""All planners of courses, likewise."""


def make_planner(method: str, options: PlannerOptions = PlannerOptions()) -> Planner:
    """Make a planner of postures. ``two-stage`` uses the envelopes, or the lift without; ``p1`` needs envelopes.

    method: a name of ``PLANNERS``, or "FILE.py:NAME"; what is not the package's own answers through the verifier.
    options: its projection is P2 after ``two-stage`` (SCP where None), ``p1`` or ``lift`` (none where None).
    Raises InvalidInput for an unknown method, an option that it does not take, an envelope that is missing, or a solver
    that is not installed.
    """
    make = PLANNERS.get(method)
    if _is_own(make):
        options.check_used(method, METHODS.get(method, EVERY_OPTION))
        return make(options)
    from .verified import VerifiedPlanner

    with foreign(f"method {method}"):
        planner = make(_copied(options, POSTURE_LIMIT_S))
    return VerifiedPlanner(planner, method, options.acceptance)


def make_course_planner(name: str, options: PlannerOptions = PlannerOptions()) -> CoursePlanner:
    """Make a planner of courses.

    name: of ``COURSE_PLANNERS``, or "FILE.py:NAME"; what is not the package's own answers through the verifier.
    options: its relaxation is P1 of ``two-stage``, where None "envelope" with envelopes and "lift" without. envelopes:
    of "envelope" and, one box, of ``micp``; ``Modes`` make ``two-stage`` switch between them.
    Raises InvalidInput for an unknown name, envelopes that are missing or have no use, or a solver that is not
    installed.
    """
    make, relaxation, envelopes = COURSE_PLANNERS.get(name), options.relaxation, options.envelopes
    if _is_own(make):
        options.check_used(name, COURSE_METHODS.get(name, EVERY_OPTION))
    if relaxation == "lift" and envelopes is not None:
        raise InvalidInput("envelopes: expected none for the lift, which has no use for them")
    if relaxation == "envelope" and envelopes is None:
        raise InvalidInput("envelopes: expected an envelope or modes for the relaxation envelope, got none")
    if _is_own(make):
        return make(options)
    from .verified import VerifiedCoursePlanner

    whole_s = options.limit(COURSE_LIMIT_S)

    def remake(limit_s: float) -> CoursePlanner:
        return make(_copied(replace(options, time_limit_s=min(limit_s, whole_s)), whole_s))

    with foreign(f"planner {name}"):
        planner = remake(whole_s)
    return VerifiedCoursePlanner(planner, name, options.acceptance, remake)


def through_verifier(planner: Planner) -> Planner:
    """A planner of postures, which answers through the verifier unless it is the package's own."""
    if _is_of_the_package(planner):
        return planner
    from .verified import VerifiedPlanner

    return VerifiedPlanner(planner, _called(planner), Acceptance())


def course_through_verifier(planner: CoursePlanner) -> CoursePlanner:
    """A planner of courses, likewise."""
    if _is_of_the_package(planner):
        return planner
    from .verified import VerifiedCoursePlanner

    return VerifiedCoursePlanner(planner, _called(planner), Acceptance())


def _is_of_the_package(planner: object) -> bool:
    return type(planner).__module__.startswith("stancekit.")


def _called(planner: object) -> str:
    return str(getattr(planner, "name", type(planner).__name__))


def _copied(options: PlannerOptions, limit_s: float) -> PlannerOptions:
    """Options for a planner from elsewhere, which may write to what it is given; with a time limit always."""
    return replace(options, acceptance=replace(options.acceptance), time_limit_s=options.limit(limit_s))


def _is_own(make: Callable[[PlannerOptions], object]) -> bool:
    """Whether a planner is the package's, whose answers are verified already; a name may have been taken over."""
    return any(make is thing for thing in globals().values())
