"""The planners of courses by name, and what each of them needs."""

from __future__ import annotations

from typing import Literal, get_args

from ..outcome import InvalidInput
from ..relaxation.envelope import EnvelopeSet
from ..relaxation.modes import Modes
from .planner import CoursePlanner, PlanAcceptance
from .project import Projection
from .twostage import CourseModels, TwoStageCoursePlanner

Method = Literal["two-stage", "micp", "nlp", "decoupled", "exact"]
METHODS: tuple[Method, ...] = get_args(Method)
Relaxation = Literal["lift", "envelope"]
RELAXATIONS: tuple[Relaxation, ...] = get_args(Relaxation)


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
    acceptance: PlanAcceptance = PlanAcceptance(),
    models: CourseModels | None = None,
) -> CoursePlanner:
    """Make a planner.

    relaxation: P1 of ``two-stage``; where None, "envelope" with envelopes and "lift" without. envelopes: of "envelope"
    and, one box, of ``micp``; ``Modes`` make ``two-stage`` switch between them. solver, intervals, envelope_use: of
    ``micp``. gap: relative, of ``micp`` and ``exact``; None takes the first point, or the default. time_limit_s: of one
    course. models: compiled ones, to share. Raises InvalidInput for an unknown name, envelopes that are missing or have
    no use, or a solver that is not installed.
    """
    if name not in METHODS:
        raise InvalidInput(f"planner: expected one of {', '.join(METHODS)}, got {name!r}")
    if relaxation is not None and relaxation not in RELAXATIONS:
        raise InvalidInput(f"relaxation: expected one of {', '.join(RELAXATIONS)}, got {relaxation!r}")
    if relaxation is not None and name != "two-stage":
        raise InvalidInput(f"relaxation: expected none for {name}, got {relaxation!r}")
    if name == "two-stage":
        return _two_stage(relaxation, envelopes, projection, time_limit_s, acceptance, models)
    if name == "micp":
        from ..search import answer, micp

        if isinstance(envelopes, Modes):
            raise InvalidInput("envelopes: expected one envelope for micp, got modes")
        return micp.MicpPlanner(
            solver=solver, grid=micp.Grid(intervals=intervals, envelope_use=envelope_use), envelope=envelopes, gap=gap,
            projection=projection, time_limit_s=time_limit_s,
            acceptance=answer.Acceptance(tolerance=acceptance.tolerance),
        )  # fmt: skip
    if envelopes is not None:
        raise InvalidInput(f"envelopes: expected none for {name}, which has no use for them")
    if name == "nlp":
        from ..search import answer, nlp

        return nlp.NlpPlanner(time_limit_s=time_limit_s, acceptance=answer.Acceptance(tolerance=acceptance.tolerance))
    if name == "exact":
        from .exact import ExactCoursePlanner

        return ExactCoursePlanner(gap=gap or 1e-3, time_limit_s=time_limit_s, acceptance=acceptance, models=models)
    from .decoupled import DecoupledPlanner

    return DecoupledPlanner(acceptance=acceptance, models=models)


def _two_stage(
    relaxation: Relaxation | None,
    envelopes: EnvelopeSet | Modes | None,
    projection: Projection,
    time_limit_s: float,
    acceptance: PlanAcceptance,
    models: CourseModels | None,
) -> CoursePlanner:
    if relaxation == "lift" and envelopes is not None:
        raise InvalidInput("envelopes: expected none for the lift, which has no use for them")
    if relaxation == "envelope" and envelopes is None:
        raise InvalidInput("envelopes: expected an envelope or modes for the relaxation envelope, got none")
    if envelopes is None:
        return TwoStageCoursePlanner(
            projection=projection, time_limit_s=time_limit_s, acceptance=acceptance, models=models
        )
    from ..search.answer import Acceptance
    from ..search.enveloped import EnvelopeCoursePlanner

    accept = Acceptance(tolerance=acceptance.tolerance)
    return EnvelopeCoursePlanner(envelopes, projection=projection, time_limit_s=time_limit_s, acceptance=accept)
