"""A planner's outcome after its plan became one of the whole body: what its joints cannot do is no
plan.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..answer.report import LATE, MARGIN
from ..errors import InvalidInput, TimeEnded, check_time
from ..files.arrays import Array
from ..projection.whole_body import WholeBodyLimits, whole_body
from ..robot.kinematics import Kinematics
from ..verify import Report, check_plan
from ..verify.margins import margin_group
from ..verify.tipping import LEAST_PUSH, tipping
from .answer import objective_of

LOG = logging.getLogger(__name__)


def with_whole_body(
    outcome: Answer[Plan],
    limits: WholeBodyLimits = WholeBodyLimits(),
    start_rad: Array | None = None,
    *,
    margins: bool = True,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """The outcome with joint angles in its plan, with torques within the limits where such a plan
    is found, and with the verifier's report on all of it.

    Where the joints cannot do it, or bodies collide, the course is undecided, with the reason and
    the plan: nothing is proved of others. So it is where the time ended before all was judged. The
    outcome as it is where there is no plan; no joints, where no torque is asked for, for a robot
    without a file whose legs are not known, or without pinocchio.

    Arguments:
        start_rad: those of a robot that stands already where the plan begins, as for
            ``plan_angles``, shape (J,).
        margins: as of ``judged``.
        deadline: when it is wanted (``time.perf_counter()``).

    Raises:
        InvalidInput: where these are needed.
    """
    if outcome.solution is None:
        return outcome
    plan, details, course, bent = (
        outcome.solution,
        dict(outcome.details),
        outcome.solution.problem,
        True,
    )
    report: Report[Plan] | None = None
    try:
        check_time(deadline)
        solver = Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
        result = whole_body(plan, limits, solver, start_rad, deadline=deadline)
        plan, report, details, bent = (
            result.plan,
            result.report,
            details | result.details,
            not result.late,
        )
    except TimeEnded:
        bent = False
    except InvalidInput:
        if limits.concern(course.robot):
            raise
    LOG.info("plan: bent in %g steps", details.get("torque_steps", 0.0))
    return judged(
        replace(outcome, solution=plan, details=details),
        report,
        bent=bent,
        margins=margins,
        deadline=deadline,
    )


def judged(
    outcome: Answer[Plan],
    report: Report[Plan] | None = None,
    *,
    bent: bool = True,
    margins: bool = True,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """The outcome with the verifier's report on all of its plan, which decides its status.

    Arguments:
        report: what the verifier said of the plan already, if it was asked.
        bent: whether there was time to bend the plan.
        margins: measure how far stances are from tipping; else it is only made sure that the plan
            does not tip.
    """
    plan = outcome.solution
    assert plan is not None
    report = report or check_plan(
        plan, joints=True, deadline=deadline
    )  # which nothing was asked of yet
    known = any(group.name == MARGIN for group in report.groups)
    if margins and not known and not report.defect and not report.late:
        report = replace(report, groups=(*report.groups, margin_group(plan)))
    LOG.info("plan: %s", report.message)
    undecided = not report.accepted or report.late
    group = next((group for group in report.groups if group.name == MARGIN), None)
    tips = "" if undecided or _on_a_line(plan) else tipping(plan, LEAST_PUSH, group)
    return replace(
        outcome,
        status=Status.UNDECIDED if undecided or tips else outcome.status,
        message=tips or (_reason(report, bent=bent) if undecided else outcome.message),
        objective=objective_of(plan),
        residual=report.worst,
        report=report,
    )


def _on_a_line(plan: Plan) -> bool:
    """Tell whether a robot has one or two point feet, on which no stance bears a push: its plan is
    one of balance alone, its margin says so, and ``run`` refuses it.
    """
    return len(plan.problem.robot.limbs) < 3 and not plan.problem.has_soles


def _reason(report: Report[Plan], *, bent: bool) -> str:
    """Why a plan is not accepted, or not yet.

    Arguments:
        bent: whether there was time for that.
    """
    if not report.contacts:
        return report.message
    late = ""
    if report.late:
        late = f"{LATE} before {', '.join(report.unchecked)} could be judged, contacts hold"
    elif not bent:
        late = f"{LATE} before the plan could be bent any further"
    return "; ".join(filter(None, (report.failures, late)))
