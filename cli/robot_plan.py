"""What ``stancekit plan`` says of a robot's file: joint angles of a plan, and of which sets a proof speaks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stancekit.planners.answer.plan import PlanOutcome
    from stancekit.planners.problem.course import Course


def bent_lines(details: Mapping[str, float]) -> Iterator[str]:
    """What planning with the whole body did to the largest torque and the deepest collision; nothing where it had
    nothing to do."""
    steps = int(details.get("torque_steps", 0.0))
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    before, after = (details.get(name, math.nan) for name in ("torque_nm_before", "torque_nm"))
    if math.isfinite(after) and before != after:
        yield f"torque: {before:.1f} → {after:.1f} Nm {how}"
    before, after = (1e3 * details.get(name, math.nan) for name in ("depth_m_before", "depth_m"))
    if math.isfinite(after) and before != after:
        yield f"deepest collision: {before:.1f} → {after:.1f} mm {how}"


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
