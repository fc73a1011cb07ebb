"""Motions of body and feet, for whoever knows no joints."""

from __future__ import annotations

from ..answer.certificate import Crossing
from ..answer.plan import LeapPlan, Plan
from ..answer.trajectory import Trajectory
from .crossing_motion import CrossingMotion
from .gait_motion import GaitMotion
from .leap_motion import LeapMotion
from .plan_motion import PlanMotion


def feet_motion(
    subject: Plan | Trajectory | LeapPlan | Crossing,
) -> PlanMotion | GaitMotion | LeapMotion | CrossingMotion:
    """The motion of a plan, a walk, a leap or a crossing, timed as ``run`` times it where no joint asks for
    more time.

    A plan may also lift all limbs at once; the runner refuses such a plan.
    """
    match subject:
        case Plan():
            return PlanMotion(subject, uncarried=True)
        case Trajectory():
            return GaitMotion(subject, subject.robot.source.foot_radii_m)
        case LeapPlan():
            return LeapMotion(subject)
        case Crossing():
            return CrossingMotion(subject)
