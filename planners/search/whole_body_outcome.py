"""A planner's outcome after its plan became one of the whole body: what its joints cannot do is no plan."""

from __future__ import annotations

from dataclasses import replace

from ..answer.outcome import Status
from ..answer.plan import PlanOutcome
from ..errors import InvalidInput
from ..files.arrays import Array
from ..projection.whole_body import whole_body
from ..projection.whole_body_limits import WholeBodyLimits
from ..robot.kinematics import Kinematics
from ..verify import Report, check_plan
from .answer import objective_of


def with_whole_body(
    outcome: PlanOutcome, limits: WholeBodyLimits = WholeBodyLimits(), start_rad: Array | None = None
) -> PlanOutcome:
    """The outcome with joint angles in its plan, with torques within the limits where such a plan is found.

    start_rad: those of a robot that stands already where the plan begins, as for ``plan_angles``, shape (J,).
    Where the joints cannot do it, or bodies collide, the course is undecided, with the reason and the plan: nothing is
    proved of others. The outcome as it is where there is no plan, and, where no torque is asked for, for a robot
    without a file whose legs are not known, or without pinocchio. Raises InvalidInput where these are needed.
    """
    return _with_joints(outcome, limits, start_rad, between=False)[0]


def judged_whole_body(
    outcome: PlanOutcome, limits: WholeBodyLimits = WholeBodyLimits()
) -> tuple[PlanOutcome, Report | None]:
    """``with_whole_body``, and all that the verifier says of its plan, as it is to be written; None without a plan.

    Raises InvalidInput as ``with_whole_body`` does.
    """
    outcome, report = _with_joints(outcome, limits, None, between=True)
    if outcome.plan is None:
        return outcome, None
    return outcome, report or check_plan(outcome.plan, joints=True)


def _with_joints(
    outcome: PlanOutcome, limits: WholeBodyLimits, start_rad: Array | None, *, between: bool
) -> tuple[PlanOutcome, Report | None]:
    """The outcome, and what the verifier says of a plan that joints were found for. between: as for ``check_plan``."""
    if outcome.plan is None:
        return outcome, None
    course = outcome.plan.course
    try:
        solver = Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    except InvalidInput:
        if limits.concern(course.robot):
            raise
        return outcome, None
    found = whole_body(outcome.plan, limits, solver, start_rad)
    report = check_plan(found.plan, joints=True, between=between)
    outcome = replace(
        outcome,
        status=Status.UNDECIDED if report.failures else outcome.status,
        message=report.failures or outcome.message,
        plan=found.plan,
        objective=objective_of(found.plan),
        residual=report.worst,
        details={**outcome.details, **found.details},
    )
    return outcome, report
