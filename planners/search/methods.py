"""The planners of postures and of courses by name, and what each of them needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, get_args

from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..plugins import Registry, foreign, takes
from ..projection.project import Projection
from .answer import Acceptance, CoursePlanner, Planner

if TYPE_CHECKING:  # what a planner needs is imported when it is asked for: a command waits for nothing else
    from ..relaxation.envelope import EnvelopeSet
    from ..relaxation.modes import Modes

Relaxation = Literal["lift", "envelope"]
RELAXATIONS: tuple[Relaxation, ...] = get_args(Relaxation)


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """What a planner is made with; each uses those options that concern it.

    envelopes: learned boxes; of courses also ``Modes``. relaxation: of courses, P1 of ``two-stage``. projection: P2,
    the planner's own where None. solver, intervals: of ``micp``; envelope_use, too, of courses. gap: relative, of
    ``micp`` and ``exact`` over courses; None takes the first point, or the default. time_limit_s: of one problem.
    acceptance: when a claim counts. programs: to share; their engine solves the convex programs.
    """

    envelopes: EnvelopeSet | Modes | None = None
    relaxation: Relaxation | None = None
    projection: Projection | None = None
    solver: str = "highs"
    intervals: int = 4
    envelope_use: Literal["rows", "shrink"] = "rows"
    gap: float | None = None
    time_limit_s: float = 30.0
    acceptance: Acceptance = field(default_factory=Acceptance)
    programs: Programs | None = None

    @property
    def boxes(self) -> EnvelopeSet | None:
        """The envelopes. Raises InvalidInput for modes, between which only a planner of courses can switch."""
        from ..relaxation.modes import Modes

        if isinstance(self.envelopes, Modes):
            raise InvalidInput("envelopes: expected envelopes, got modes, which are for courses")
        return self.envelopes


def _exact(options: PlannerOptions) -> Planner:
    from .exact import ExactPlanner

    return ExactPlanner(acceptance=options.acceptance, time_limit_s=options.time_limit_s, programs=options.programs)


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

    return NlpPlanner(acceptance=options.acceptance, time_limit_s=options.time_limit_s, programs=options.programs)


def _micp(options: PlannerOptions) -> Planner:
    from ..relaxation.micp import Grid
    from .micp import MicpPlanner

    boxes = options.boxes
    if boxes is not None and len(boxes.envelopes) > 1:
        raise InvalidInput(f"envelope: expected one envelope for micp, got {len(boxes.envelopes)}")
    return MicpPlanner(
        solver=options.solver, grid=Grid(intervals=options.intervals), envelope=boxes,
        time_limit_s=options.time_limit_s, acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


def _course_two_stage(options: PlannerOptions) -> CoursePlanner:
    projection = options.projection or "scp"
    if options.envelopes is not None:
        from .enveloped import EnvelopeCoursePlanner

        return EnvelopeCoursePlanner(
            options.envelopes, projection=projection, time_limit_s=options.time_limit_s,
            acceptance=options.acceptance, programs=options.programs,
        )  # fmt: skip
    from .two_stage import TwoStageCoursePlanner

    return TwoStageCoursePlanner(
        projection=projection, time_limit_s=options.time_limit_s, acceptance=options.acceptance,
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
        time_limit_s=options.time_limit_s, acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


def _course_nlp(options: PlannerOptions) -> CoursePlanner:
    from .nlp import NlpPlanner

    _check_without("nlp", options)
    return NlpPlanner(time_limit_s=options.time_limit_s, acceptance=options.acceptance, programs=options.programs)


def _course_decoupled(options: PlannerOptions) -> CoursePlanner:
    from .decoupled import DecoupledPlanner

    _check_without("decoupled", options)
    return DecoupledPlanner(acceptance=options.acceptance, programs=options.programs)


def _course_exact(options: PlannerOptions) -> CoursePlanner:
    from .exact import ExactCoursePlanner

    _check_without("exact", options)
    return ExactCoursePlanner(
        gap=1e-3 if options.gap is None else options.gap, time_limit_s=options.time_limit_s,
        acceptance=options.acceptance, programs=options.programs,
    )  # fmt: skip


def _check_without(name: str, options: PlannerOptions) -> None:
    if options.envelopes is not None:
        raise InvalidInput(f"envelopes: expected none for {name}, which has no use for them")


METHODS = ("exact", "p1", "lift", "two-stage", "nlp", "micp")
"""The planners of postures that are the package's own."""
COURSE_METHODS = ("two-stage", "micp", "nlp", "decoupled", "exact")
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
    Raises InvalidInput for an unknown method, an envelope that is missing, or a solver that is not installed.
    """
    make = PLANNERS.get(method)
    if _is_own(make):
        return make(options)
    from .verified import VerifiedPlanner

    with foreign(f"method {method}"):
        planner = make(replace(options, acceptance=replace(options.acceptance)))
    return VerifiedPlanner(planner, method, options.acceptance)


def make_course_planner(name: str, options: PlannerOptions = PlannerOptions(time_limit_s=60.0)) -> CoursePlanner:
    """Make a planner of courses.

    name: of ``COURSE_PLANNERS``, or "FILE.py:NAME"; what is not the package's own answers through the verifier.
    options: its relaxation is P1 of ``two-stage``, where None "envelope" with envelopes and "lift" without. envelopes:
    of "envelope" and, one box, of ``micp``; ``Modes`` make ``two-stage`` switch between them.
    Raises InvalidInput for an unknown name, envelopes that are missing or have no use, or a solver that is not
    installed.
    """
    make, relaxation, envelopes = COURSE_PLANNERS.get(name), options.relaxation, options.envelopes
    if relaxation is not None and relaxation not in RELAXATIONS:
        raise InvalidInput(f"relaxation: expected one of {', '.join(RELAXATIONS)}, got {relaxation!r}")
    if relaxation is not None and name in COURSE_METHODS and name != "two-stage":
        raise InvalidInput(f"relaxation: expected none for {name}, got {relaxation!r}")
    if relaxation == "lift" and envelopes is not None:
        raise InvalidInput("envelopes: expected none for the lift, which has no use for them")
    if relaxation == "envelope" and envelopes is None:
        raise InvalidInput("envelopes: expected an envelope or modes for the relaxation envelope, got none")
    if _is_own(make):
        return make(options)
    from .verified import VerifiedCoursePlanner

    def remake(limit_s: float) -> CoursePlanner:
        limited = min(limit_s, options.time_limit_s)
        return make(replace(options, time_limit_s=limited, acceptance=replace(options.acceptance)))

    with foreign(f"planner {name}"):
        planner = remake(options.time_limit_s)
    return VerifiedCoursePlanner(planner, name, options.acceptance, remake)


def through_verifier(planner: CoursePlanner) -> CoursePlanner:
    """The planner, which answers through the verifier unless it is the package's own."""
    if type(planner).__module__.startswith("stancekit."):
        return planner
    from .verified import VerifiedCoursePlanner

    return VerifiedCoursePlanner(planner, str(getattr(planner, "name", type(planner).__name__)), Acceptance())


def _is_own(make: Callable[[PlannerOptions], object]) -> bool:
    """Whether a planner is the package's, whose answers are verified already; a name may have been taken over."""
    return any(make is thing for thing in globals().values())
