"""The planners of postures and of courses by name, and what each of them needs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, get_args

from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..projection.project import Projection
from .answer import Acceptance, CoursePlanner, Planner

if TYPE_CHECKING:
    from ..relaxation.envelope import EnvelopeSet
    from ..relaxation.modes import Modes

Method = Literal["exact", "p1", "lift", "two-stage", "nlp", "micp"]
METHODS: tuple[Method, ...] = get_args(Method)
CourseMethod = Literal["two-stage", "micp", "nlp", "decoupled", "exact"]
COURSE_METHODS: tuple[CourseMethod, ...] = get_args(CourseMethod)
Relaxation = Literal["lift", "envelope"]
RELAXATIONS: tuple[Relaxation, ...] = get_args(Relaxation)


_PLANNERS: dict[str, tuple[str, str, tuple[str, ...]]] = {  # module, class, the options that it takes
    "exact": ("exact", "ExactPlanner", ("time_limit_s",)),
    "p1": ("posture", "TwoStagePlanner", ("envelopes", "projection")),
    "lift": ("posture", "TwoStagePlanner", ("projection",)),
    "two-stage": ("posture", "TwoStagePlanner", ("envelopes", "projection")),
    "nlp": ("nlp", "NlpPlanner", ("time_limit_s",)),
    "micp": ("micp", "MicpPlanner", ("solver", "grid", "envelope", "time_limit_s")),
}
_COURSE_PLANNERS: dict[tuple[str, str], tuple[str, str, tuple[str, ...]]] = {  # by name and relaxation
    ("two-stage", "lift"): ("two_stage", "TwoStageCoursePlanner", ("projection", "time_limit_s")),
    ("two-stage", "envelope"): ("enveloped", "EnvelopeCoursePlanner", ("envelopes", "projection", "time_limit_s")),
    ("micp", ""): ("micp", "MicpPlanner", ("solver", "grid", "envelope", "gap", "projection", "time_limit_s")),
    ("nlp", ""): ("nlp", "NlpPlanner", ("time_limit_s",)),
    ("decoupled", ""): ("decoupled", "DecoupledPlanner", ()),
    ("exact", ""): ("exact", "ExactCoursePlanner", ("gap", "time_limit_s")),
}


def make_planner(
    method: Method,
    *,
    envelopes: EnvelopeSet | None = None,
    projection: Projection | None = None,
    solver: str = "highs",
    intervals: int = 4,
    time_limit_s: float = 30.0,
    acceptance: Acceptance = Acceptance(),
    programs: Programs | None = None,
) -> Planner:
    """Make a planner of postures. ``two-stage`` uses the envelopes, or the lift without; ``p1`` needs envelopes.

    projection: P2 after ``two-stage`` (SCP where None), ``p1`` or ``lift`` (none where None).
    solver, intervals: of ``micp``. time_limit_s: of one problem, for the methods that search. programs: to share; their
    engine solves the convex programs.
    Raises InvalidInput for an unknown method, an envelope that is missing, or a solver that is not installed.
    """
    if method not in _PLANNERS:
        raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if method == "p1" and envelopes is None:
        raise InvalidInput("envelope: expected an envelope file for the method p1, got none")
    if method == "micp" and envelopes is not None and len(envelopes.envelopes) > 1:
        raise InvalidInput(f"envelope: expected one envelope for micp, got {len(envelopes.envelopes)}")
    options: dict[str, Any] = {
        "envelopes": envelopes, "envelope": envelopes, "solver": solver, "time_limit_s": time_limit_s,
        "projection": projection or ("scp" if method == "two-stage" else None),
    }  # fmt: skip
    if method == "micp":
        options["grid"] = _grid(intervals=intervals)
    planner: Planner = _made(_PLANNERS[method], options, acceptance, programs)
    return planner


def make_course_planner(
    name: str,
    relaxation: Relaxation | None = None,
    envelopes: EnvelopeSet | Modes | None = None,
    projection: Projection = "scp",
    *,
    solver: str = "highs",
    intervals: int = 4,
    envelope_use: Literal["rows", "shrink"] = "rows",
    gap: float | None = None,
    time_limit_s: float = 60.0,
    acceptance: Acceptance = Acceptance(),
    programs: Programs | None = None,
) -> CoursePlanner:
    """Make a planner of courses.

    relaxation: P1 of ``two-stage``; where None, "envelope" with envelopes and "lift" without. envelopes: of "envelope"
    and, one box, of ``micp``; ``Modes`` make ``two-stage`` switch between them. solver, intervals, envelope_use: of
    ``micp``. gap: relative, of ``micp`` and ``exact``; None takes the first point, or the default. time_limit_s: of one
    course. programs: to share. Raises InvalidInput for an unknown name, envelopes that are missing or have no use, or a
    solver that is not installed.
    """
    if name not in COURSE_METHODS:
        raise InvalidInput(f"planner: expected one of {', '.join(COURSE_METHODS)}, got {name!r}")
    if relaxation is not None and relaxation not in RELAXATIONS:
        raise InvalidInput(f"relaxation: expected one of {', '.join(RELAXATIONS)}, got {relaxation!r}")
    if relaxation is not None and name != "two-stage":
        raise InvalidInput(f"relaxation: expected none for {name}, got {relaxation!r}")
    if relaxation == "lift" and envelopes is not None:
        raise InvalidInput("envelopes: expected none for the lift, which has no use for them")
    if relaxation == "envelope" and envelopes is None:
        raise InvalidInput("envelopes: expected an envelope or modes for the relaxation envelope, got none")
    if envelopes is not None and name not in ("two-stage", "micp"):
        raise InvalidInput(f"envelopes: expected none for {name}, which has no use for them")
    options: dict[str, Any] = {
        "envelopes": envelopes, "envelope": envelopes, "projection": projection, "solver": solver,
        "time_limit_s": time_limit_s,
    }  # fmt: skip
    if gap is not None:
        options["gap"] = gap
    if name == "micp":
        from ..relaxation.modes import Modes

        if isinstance(envelopes, Modes):
            raise InvalidInput("envelopes: expected one envelope for micp, got modes")
        options["grid"] = _grid(intervals=intervals, envelope_use=envelope_use)
    p1 = ("lift" if envelopes is None else "envelope") if name == "two-stage" else ""
    planner: CoursePlanner = _made(_COURSE_PLANNERS[name, p1], options, acceptance, programs)
    return planner


def _made(
    entry: tuple[str, str, tuple[str, ...]], options: dict[str, Any], acceptance: Acceptance, programs: Programs | None
) -> Any:
    """A planner of one of the tables; its module is imported now."""
    module, name, takes = entry
    kind = getattr(import_module(f".{module}", __package__), name)
    return kind(**{each: options[each] for each in takes if each in options}, acceptance=acceptance, programs=programs)


def _grid(**options: Any) -> Any:
    from ..relaxation.micp import Grid  # cvxpy takes a second to import

    return Grid(**options)
