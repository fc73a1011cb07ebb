"""The reason why no runner executes an answer that is accepted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput

if TYPE_CHECKING:
    from .plan import Plan
    from .trajectory import Trajectory

NOBODY_CARRIES = "nobody carries between frames"
WALK_BODY = ("joints", "joint_speed", "torque", "legs_moment", "bodies")
"""The groups of a walk that ask for a model of the robot's legs."""
LEAP_BODY = ("joints", "joint_speed", "torque", "legs_turn", "take_off", "landing", "bodies")
"""Those of a leap."""


def plan_hindrance(plan: Plan) -> str:
    """The reason why no runner executes a plan, whatever the world; empty where one may."""
    course = plan.problem
    if course.uncarried:
        return NOBODY_CARRIES
    if course.has_soles:
        return "its feet are soles, and only point feet are executed"
    return course.robot.source.hindrance


def walk_hindrance(walk: Trajectory, unchecked: Sequence[str]) -> str:
    """The reason why no runner executes a walk, whatever the world; empty where one may.

    Arguments:
        walk: the trajectory.
        unchecked: names of the groups that could not be checked. Of a robot without a model the
            groups of ``WALK_BODY`` are no hindrance: the runner asks the servos of the world.
    """
    from ..robot.legged import walking_robot  # slow to import

    left = [name for name in unchecked if walk.robot.source.own or name not in WALK_BODY]
    if left:
        return f"{', '.join(left)} {'is' if len(left) == 1 else 'are'} not checked"
    if walk.adhesive.any():
        names = np.array(walk.robot.limb_names)[walk.adhesive]
        return f"no world has feet that stick, as {', '.join(names)} do"
    try:
        walking_robot(walk.robot)
    except InvalidInput as error:
        return str(error)
    return ""
