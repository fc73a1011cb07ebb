"""Receding horizon: the coming key frames planned anew from where the robot stands, with nothing
kept from before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ..answer.answer import Answer
from ..answer.plan import Plan
from ..problem import Problem
from ..projection.whole_body import WholeBodyLimits
from .answer import Planner
from .plan_course import ALL_FRICTION, plan_course
from .plan_window import Standing, course_window
from .two_stage import TwoStagePlanner


def replan(
    state: Standing | None,
    course: Problem,
    *,
    frame: int = 0,
    horizon: int | None = None,
    planner: Planner | Callable[[Problem], Planner] | None = None,
    shares: Sequence[float] = ALL_FRICTION,
    presses: Sequence[float] = (),
    limits: WholeBodyLimits | None = None,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """Plan key frames ``frame`` to ``frame + horizon`` of a course from where the robot stands.

    Returns the planner's outcome over the window, whose plan begins at ``state``;
    ``plan_window.joined`` puts windows together. It comes of ``plan_course``, so that a proof is
    one over the outer sets of legs. With limits it is one of the whole body, with its joint angles:
    ``details`` say in how many steps, from what torque to what and from what depth of a collision
    to what (``with_whole_body``), and where that does not do it is undecided with the reason. The
    answer depends on the arguments alone: no program, guess or earlier plan is kept. Raises
    InvalidInput for frames that there are not, and where the planner is not made for the window.

    Arguments:
        state: pose and toes at ``frame``, whose toes stay, and joints, where they are known; None
            at the beginning, where they are free as in the course.
        horizon: how many frames ahead; None for all that are left.
        planner: one, or what chooses one for the window (a policy); by default the two-stage
            planner over the lift.
        shares: of the friction, tried in this order until there is a plan
            (``friction_margin.plan_with_reserve``).
        presses: likewise.
        limits: of joints and bodies, to which the window's plan is bent; None: contacts alone.
        deadline: as for ``plan_course``.
    """
    last = course.frames - 1 if horizon is None else min(frame + horizon, course.frames - 1)
    window = course_window(course, frame, last, state)
    if planner is None:
        planner = TwoStagePlanner()
    chosen: Planner = planner if hasattr(planner, "solve") else planner(window)  # type: ignore[assignment]
    start_rad = None if state is None else state.angles_rad
    return plan_course(
        window,
        chosen,
        shares=shares,
        presses=presses,
        limits=limits,
        start_rad=start_rad,
        deadline=deadline,
    )
