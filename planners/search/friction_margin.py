"""Plans that keep a reserve of friction: found on a course that is made more slippery than it is.

A plan for less friction is one for more, as cones only grow; executed, its feet have something in hand. So have those
of a plan that does not balance on an edge (``support_margin``).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cache

from ..answer.plan import Plan, PlanOutcome
from ..problem.course import Course
from ..projection.support_margin import PRESSES, pressing, steady
from ..terrain.patch import Patch
from .answer import CoursePlanner
from .two_stage import TwoStageCoursePlanner

SHARES = (0.8, 0.9, 1.0)
"""Shares of the friction that are planned with, the most cautious first."""
CAUTION = 0.5
"""Of a planner's time limit, what all shares but the last may use together."""


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


def plan_with_reserve(
    planner: CoursePlanner, course: Course, shares: Sequence[float] = SHARES, presses: Sequence[float] = PRESSES
) -> PlanOutcome:
    """The answer for the most cautious share that has a plan; the plan is one of the course itself.

    Where that plan balances on an edge, one in which every foot that carries presses with such a share of the weight is
    taken, the first of ``presses`` that has one. Where no share has a plan, the answer for the last one, by default the
    course as it is: only that one proves anything of it. ``provenance`` says which shares of friction and of weight it
    was. The planner's time limit is one for all of this: where the more cautious shares take ``CAUTION`` of it, the
    last gets the rest. Raises InvalidInput where the planner is not made for the course.
    """
    begin = time.perf_counter()
    for share in shares:
        limited = _limited(planner, begin, 1.0 if share == shares[-1] else CAUTION)
        if share != shares[-1] and getattr(limited, "time_limit_s", 1.0) <= 0.0:
            continue
        dulled = slippery(course, share)
        outcome = limited.solve(dulled)
        if outcome.plan is not None:
            outcome, press = _firmer(_limited(planner, begin), dulled, outcome, presses)
            assert outcome.plan is not None
            provenance = {**outcome.plan.provenance, "friction_share": share}
            if press > 0.0:
                provenance["press_share"] = press
            plan: Plan = replace(outcome.plan, course=course, provenance=provenance)
            exact = share >= 1.0 and press == 0.0  # a bound of another course bounds nothing here
            return replace(outcome, plan=plan, bound=outcome.bound if exact else float("nan"))
    return outcome


def _limited(planner: CoursePlanner, begin: float, part: float = 1.0) -> CoursePlanner:
    """The planner with what is left of this part of its time limit since ``begin``; itself where it has none."""
    limit_s = getattr(planner, "time_limit_s", None)
    if limit_s is None:
        return planner
    limited = copy(planner)
    limited.time_limit_s = max(part * limit_s - (time.perf_counter() - begin), 0.0)  # type: ignore[attr-defined]
    return limited


def _firmer(
    planner: CoursePlanner, course: Course, outcome: PlanOutcome, presses: Sequence[float]
) -> tuple[PlanOutcome, float]:
    """The same, or where its plan balances on an edge one that does not, and with how much of the weight its feet
    press at least: 0 for no such demand."""
    assert outcome.plan is not None
    if not presses or steady(outcome.plan, min(presses)):
        return outcome, 0.0
    if isinstance(planner, TwoStageCoursePlanner):
        planner = copy(planner)
        planner.cuts = False  # nobody waits half a minute for a plan that is only better to have
    for press in presses:
        firmer = planner.solve(pressing(course, press))
        if firmer.plan is not None:
            return firmer, press
    return outcome, 0.0
