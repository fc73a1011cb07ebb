"""Plans that do not balance on an edge: found on a course in which every foot that carries bears a
part of the weight.

A foot that a plan lets carry next to nothing is one about whose neighbours the robot tips over: its
centre of mass is above the line between them. A plan of such a course is one of the course itself,
as its forces are fewer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..problem import Problem
from ..verify.margins import borne_share
from .force_distribution import ForceDistribution

PUSHES = (0.05, 0.025)
"""Shares of the weight: horizontal pushes at the body that every stance bears, the most cautious
first."""
PRESSES = (0.2, 0.1, 0.05)
"""Shares of the weight that every foot that carries bears at least, the most cautious first."""


def pressing(course: Problem, share: float) -> Problem:
    """The course in which every foot that carries presses with this share of the weight or more.

    Arguments:
        share: of m g, along the contact's normal; f_n,min of E10 is raised to it.
    """
    share *= course.weight_n / course.force_n
    footholds = tuple(
        foothold
        if foothold.force_min is None
        else replace(foothold, force_min=_raised(foothold.force_min, share))
        for foothold in course.footholds
    )
    return replace(course, force_min=_raised(course.force_min, share), footholds=footholds)


def _raised(low: Array, share: float) -> Array:
    """Least forces of which the normal one is at least so much."""
    return np.array([max(float(low[0]), share), *low[1:]])


def pushed(course: Problem, share: float) -> Problem:
    """The course in which every stance bears a push of this share of the weight, or the one it asks
    for already.
    """
    return replace(course, push_n=max(course.push_n, share * course.weight_n))


def push_share(plan: Plan) -> float:
    """The largest of ``PUSHES`` that every stance of a plan bears, as it is; 0 for none."""
    return borne_share(plan, PUSHES)


def steady(plan: Plan, share: float) -> bool:
    """Tell whether there are forces in every stance of a plan with which every foot that carries
    presses this hard.

    True of a plan for soles, whose points are not feet of their own.
    """
    if plan.problem.has_soles:
        return True
    distribution = ForceDistribution(len(plan.problem.robot.limbs))
    return all(
        distribution.solve(plan, index, reserves=(1.0,), least=share) is not None
        for index in range(len(plan.problem.stances))
    )
