"""The posture planners by name, and what each of them needs."""

from __future__ import annotations

from typing import Literal, get_args

from ..equilibrium.programs import Programs
from ..outcome import InvalidInput
from ..projection.project import PostureProjection
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
    projection: PostureProjection | None = None,
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
        from .nlp import NlpPlanner

        return NlpPlanner(acceptance=acceptance, time_limit_s=time_limit_s)
    if method == "micp":
        from .micp import MicpPlanner

        if envelopes is not None and len(envelopes.envelopes) > 1:
            raise InvalidInput(f"envelope: expected one envelope for micp, got {len(envelopes.envelopes)}")
        return MicpPlanner(
            solver=solver,
            intervals=intervals,
            envelope=None if envelopes is None else envelopes.envelopes[0],
            time_limit_s=time_limit_s,
            acceptance=acceptance,
        )
    raise InvalidInput(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
