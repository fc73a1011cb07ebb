"""The planners of postures and of courses by name, and what each of them needs."""

from __future__ import annotations

from typing import Literal, get_args

from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..projection.project import Projection
from ..relaxation.envelope import EnvelopeSet
from ..relaxation.modes import Modes
from .answer import Acceptance, CoursePlanner, Planner
from .exact import ExactCoursePlanner, ExactPlanner
from .posture import TwoStagePlanner
from .two_stage import TwoStageCoursePlanner

Method = Literal["exact", "p1", "lift", "two-stage", "nlp", "micp"]
METHODS: tuple[Method, ...] = get_args(Method)
CourseMethod = Literal["two-stage", "micp", "nlp", "decoupled", "exact"]
COURSE_METHODS: tuple[CourseMethod, ...] = get_args(CourseMethod)
Relaxation = Literal["lift", "envelope"]
RELAXATIONS: tuple[Relaxation, ...] = get_args(Relaxation)


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
    if method == "exact":
        return ExactPlanner(acceptance=acceptance, time_limit_s=time_limit_s, programs=programs)
    if method == "p1" and envelopes is None:
        raise InvalidInput("envelope: expected an envelope file for the method p1, got none")
    if method in ("p1", "lift", "two-stage"):
        return TwoStagePlanner(
            envelopes=None if method == "lift" else envelopes,
            projection=projection or ("scp" if method == "two-stage" else None),
            acceptance=acceptance, programs=programs,
        )  # fmt: skip
    if method == "nlp":
        from .nlp import NlpPlanner

        return NlpPlanner(acceptance=acceptance, time_limit_s=time_limit_s, programs=programs)
    if method == "micp":
        from .micp import Grid, MicpPlanner

        if envelopes is not None and len(envelopes.envelopes) > 1:
            raise InvalidInput(f"envelope: expected one envelope for micp, got {len(envelopes.envelopes)}")
        return MicpPlanner(
            solver=solver, grid=Grid(intervals=intervals), envelope=envelopes, time_limit_s=time_limit_s,
            acceptance=acceptance, programs=programs,
        )  # fmt: skip
    raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")


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
    if name == "two-stage" and envelopes is not None:
        from .enveloped import EnvelopeCoursePlanner

        return EnvelopeCoursePlanner(
            envelopes, projection=projection, time_limit_s=time_limit_s, acceptance=acceptance, programs=programs
        )
    if name == "micp":
        from .micp import Grid, MicpPlanner

        if isinstance(envelopes, Modes):
            raise InvalidInput("envelopes: expected one envelope for micp, got modes")
        return MicpPlanner(
            solver=solver, grid=Grid(intervals=intervals, envelope_use=envelope_use), envelope=envelopes, gap=gap,
            projection=projection, time_limit_s=time_limit_s, acceptance=acceptance, programs=programs,
        )  # fmt: skip
    if envelopes is not None:
        raise InvalidInput(f"envelopes: expected none for {name}, which has no use for them")
    if name == "two-stage":
        return TwoStageCoursePlanner(
            projection=projection, time_limit_s=time_limit_s, acceptance=acceptance, programs=programs
        )
    if name == "nlp":
        from .nlp import NlpPlanner

        return NlpPlanner(time_limit_s=time_limit_s, acceptance=acceptance, programs=programs)
    if name == "exact":
        return ExactCoursePlanner(
            gap=gap or 1e-3, time_limit_s=time_limit_s, acceptance=acceptance, programs=programs
        )
    from .decoupled import DecoupledPlanner

    return DecoupledPlanner(acceptance=acceptance, programs=programs)
