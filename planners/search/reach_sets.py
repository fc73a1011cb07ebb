"""Of which sets of a robot's legs an answer speaks: plans are within inner ones, proofs hold for outer ones."""

from __future__ import annotations

import math
from dataclasses import replace

from ..answer.outcome import Status
from ..answer.plan import PlanOutcome
from ..problem.course import Course


def refuted(course: Course, outcome: PlanOutcome, around: Course, second: PlanOutcome) -> tuple[Course, PlanOutcome]:
    """A course and what is proved of it, where there is no plan within what the legs surely reach.

    That says nothing of the robot; that there is none within what the legs might reach does. around, second: the course
    with outer sets, and what is found there.
    """
    if second.certificate is not None:
        return around, second
    message = "no plan in the inner sets of the legs, and no proof in the outer ones that there is none"
    return course, replace(
        outcome, status=Status.UNDECIDED, certificate=None, bound=math.nan, message=message, claim=""
    )
