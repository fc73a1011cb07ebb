"""A planner's outcome after its plan became one of the whole body: what its joints cannot do is no plan."""

from __future__ import annotations

from dataclasses import replace

from ..answer.outcome import Status
from ..answer.plan import PlanOutcome
from ..projection.torque_limits import TorqueLimits
from ..projection.whole_body import whole_body
from ..verify import check_plan
from ..verify.joints import joint_report
from .answer import objective_of


def with_whole_body(outcome: PlanOutcome, limits: TorqueLimits = TorqueLimits()) -> PlanOutcome:
    """The outcome with joint angles in its plan, and with torques within the limits where such a plan is found.

    Where the joints cannot do it the course is undecided, with the reason and the plan: nothing is proved of others.
    The outcome as it is where there is no plan. Raises InvalidInput without pinocchio.
    """
    if outcome.plan is None:
        return outcome
    found = whole_body(outcome.plan, limits)
    said = joint_report(found.plan).message
    return replace(
        outcome,
        status=Status.UNDECIDED if said else outcome.status,
        message=said or outcome.message,
        plan=found.plan,
        objective=objective_of(found.plan),
        residual=check_plan(found.plan, between=False).worst,
        details={**outcome.details, **found.details},
    )
