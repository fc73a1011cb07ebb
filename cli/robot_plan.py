"""What ``stancekit plan`` says of a robot's file: joint angles of a plan, and of which sets a proof speaks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stancekit.planners.answer.plan import Plan, PlanOutcome
    from stancekit.planners.problem.course import Course
    from stancekit.planners.robot.plan_postures import PlanPostures
    from stancekit.planners.robot.robot_model import RobotModel


def joints_of(model: RobotModel, plan: Plan) -> PlanPostures:
    """Postures of every key frame; what finds them is imported only here."""
    from stancekit.planners.robot.plan_postures import plan_postures

    return plan_postures(model, plan)


def refuted(course: Course, outcome: PlanOutcome, around: Course, second: PlanOutcome) -> tuple[Course, PlanOutcome]:
    """A course and what is proved of it, where there is no plan within what the legs surely reach.

    That says nothing of the robot; that there is none within what the legs might reach does. around, second: the course
    with outer sets, and what is found there.
    """
    from stancekit.planners.answer.outcome import Status

    if second.certificate is not None:
        return around, second
    message = "no plan in the inner sets of the legs, and no proof in the outer ones that there is none"
    return course, replace(
        outcome, status=Status.UNDECIDED, certificate=None, bound=math.nan, message=message, claim=""
    )
