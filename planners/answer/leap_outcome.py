"""The outcome of a planner on a leap: a plan with its report, a certificate, or what is known when the budget ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..problem.leap import Leap
from .leap_plan import LeapPlan
from .outcome import Certificate, Status
from .report import Report


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapOutcome:
    """What one planner says of one leap.

    Arguments:
        status: of the leap itself.
        method: which planner.
        problem: the leap that was answered.
        plan: that the verifier accepted, where feasible.
        report: the verifier's, of the plan.
        certificate: that the verifier accepted, where infeasible.
        tries: choices of contacts that were tried; solves: convex problems; seconds: wall clock [s].
        message: why it is undecided.
        details: further numbers of the method.
    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.
    Example:
        >>> import stancekit
        >>> from stancekit.planners.problem.leap_json import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> stancekit.plan(leap).status.value
        'feasible'
    """

    status: Status
    method: str
    problem: Leap
    plan: LeapPlan | None = None
    report: Report[LeapPlan] | None = None
    certificate: Certificate | None = None
    tries: int = 0
    solves: int = 0
    seconds: float = 0.0
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)
