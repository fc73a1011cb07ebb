"""Plans that keep a reserve of friction: found on a course that is made more slippery than it is.

A plan for less friction is one for more, as cones only grow; executed, its feet have something in hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from ..answer.plan import Plan, PlanOutcome
from ..problem.course import Course
from ..terrain.patch import Patch
from .answer import CoursePlanner

SHARES = (0.8, 0.9, 1.0)
"""Shares of the friction that are planned with, the most cautious first."""


def slippery(course: Course, share: float) -> Course:
    """The course with this share of its friction everywhere."""
    if share == 1.0:
        return course

    @cache
    def dulled(patch: Patch) -> Patch:
        return patch.with_friction(share * patch.friction)

    footholds = tuple(
        replace(foothold, candidates=tuple(dulled(patch) for patch in foothold.candidates))
        for foothold in course.footholds
    )
    return replace(course, terrain=tuple(dulled(patch) for patch in course.terrain), footholds=footholds)


def plan_with_reserve(planner: CoursePlanner, course: Course, shares: Sequence[float] = SHARES) -> PlanOutcome:
    """The answer for the most cautious share that has a plan; the plan is one of the course itself.

    Where none has, the answer for the last share, by default the course as it is: only that one proves anything of it.
    ``provenance`` says which share it was. Raises InvalidInput where the planner is not made for the course.
    """
    for share in shares:
        outcome = planner.solve(slippery(course, share))
        if outcome.plan is not None:
            provenance = {**outcome.plan.provenance, "friction_share": share}
            plan: Plan = replace(outcome.plan, course=course, provenance=provenance)
            bound = outcome.bound if share >= 1.0 else float("nan")  # of the slippery course, it bounds nothing here
            return replace(outcome, plan=plan, bound=bound)
    return outcome
