"""The posture planners by name, and what each of them needs."""

from __future__ import annotations

from typing import Literal, get_args

from ..equilibrium.programs import Programs
from ..outcome import InvalidInput
from ..projection.project import Projection
from ..relaxation.envelope import EnvelopeSet
from ..search.answer import Acceptance, Planner
from ..search.exact import ExactPlanner
from ..search.posture import TwoStagePlanner

Method = Literal["exact", "p1", "lift", "two-stage", "nlp", "micp"]
METHODS: tuple[Method, ...] = get_args(Method)


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
    """Make a planner. ``two-stage`` uses the envelopes, or the lift where there are none; ``p1`` needs envelopes.

    projection: P2 after ``two-stage`` (SCP where None), ``p1`` or ``lift`` (none where None).
    solver, intervals: of ``micp``. time_limit_s: of one problem, for the methods that search.
    Raises InvalidInput for an unknown method, an envelope that is missing, or a solver that is not installed.
    """
    if method == "exact":
        return ExactPlanner(acceptance=acceptance, time_limit_s=time_limit_s, programs=programs)
    if method == "p1":
        if envelopes is None:
            raise InvalidInput("envelope: expected an envelope file for the method p1, got none")
        return TwoStagePlanner(envelopes=envelopes, projection=projection, acceptance=acceptance, programs=programs)
    if method == "lift":
        return TwoStagePlanner(envelopes=None, projection=projection, acceptance=acceptance, programs=programs)
    if method == "two-stage":
        return TwoStagePlanner(
            envelopes=envelopes, projection=projection or "scp", acceptance=acceptance, programs=programs
        )
    if method == "nlp":
        from ..search import answer, nlp

        limits = answer.Acceptance(tolerance=acceptance.tolerance, gap=acceptance.gap)
        return nlp.NlpPlanner(acceptance=limits, time_limit_s=time_limit_s)
    if method == "micp":
        from ..search import answer, micp

        if envelopes is not None and len(envelopes.envelopes) > 1:
            raise InvalidInput(f"envelope: expected one envelope for micp, got {len(envelopes.envelopes)}")
        return micp.MicpPlanner(
            solver=solver,
            grid=micp.Grid(intervals=intervals),
            envelope=envelopes,
            time_limit_s=time_limit_s,
            acceptance=answer.Acceptance(tolerance=acceptance.tolerance, gap=acceptance.gap),
        )
    raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
