"""What ``stancekit plan`` says of a robot's file: joint angles of a plan, and of which sets a proof speaks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stancekit.planners.answer.plan import Plan, PlanOutcome
    from stancekit.planners.problem.course import Course
    from stancekit.planners.robot.bodies import WholeBody
    from stancekit.planners.robot.kinematics import Kinematics


def torque_line(details: Mapping[str, float]) -> str:
    """What planning with the whole body did to the largest torque; empty where it had nothing to do."""
    if details.get("torque_nm", math.nan) == details.get("torque_nm_before", math.nan) or "torque_nm" not in details:
        return ""
    steps = int(details["torque_steps"])
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    return f"torque: {details['torque_nm_before']:.1f} → {details['torque_nm']:.1f} Nm {how}"


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


def along(plan: Plan, kinematics: Kinematics) -> Iterator[tuple[float, WholeBody]]:
    """The runner's motion; what makes it is slow to import."""
    from stancekit.runner.motion import bodies

    return bodies.along(plan, kinematics)
