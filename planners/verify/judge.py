"""The one door of the verifier: a motion or a proof in, its report out."""

from __future__ import annotations

from typing import Any

from ..answer.motion import Evidence
from ..answer.report import Report
from .plans import check_plan

TOLERANCE = 1e-6
"""Largest violation of an accepted posture or plan where no other is given."""


def judge(
    evidence: Evidence,
    *,
    tolerance: float | None = None,
    joints: bool = True,
    margins: bool = False,
) -> Report[Any]:
    """Check a motion or a proof anew, whoever made it: by the groups whose columns it has.

    Arguments:
        tolerance: largest violation of a plan; the rest have limits of their own.
        joints: judge a plan's whole body, too.
        margins: measure what a plan's stances bear.
    """
    subject: Any = evidence
    if subject.has("multipliers"):
        from .certificate import check_certificate  # of proofs alone

        return check_certificate(subject)
    if subject.has("parts"):
        from .crossings import check_crossing

        return check_crossing(subject)
    if subject.has("times_s"):
        from .trajectories import check_trajectory  # splines are slow to import

        return check_trajectory(subject)
    if subject.has("timing"):
        from .leaps import check_leap  # of leaps alone

        return check_leap(subject, body=True)
    limit = TOLERANCE if tolerance is None else tolerance
    return check_plan(subject, tolerance=limit, joints=joints, margins=margins)
