"""The one door of the verifier: a motion or a proof in, its report out."""

from __future__ import annotations

from typing import Any

from ..answer.certificate import Certificate, Crossing
from ..answer.motion import Evidence
from ..answer.plan import LeapPlan, Plan
from ..answer.report import Report
from ..answer.trajectory import Trajectory
from .certificate import check_certificate
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
    """Check a motion or a proof anew, whoever made it.

    Arguments:
        tolerance: largest violation of a plan; the rest have limits of their own.
        joints: judge a plan's whole body, too.
        margins: measure what a plan's stances bear.
    """
    match evidence:
        case Plan():
            return check_plan(
                evidence,
                tolerance=TOLERANCE if tolerance is None else tolerance,
                joints=joints,
                margins=margins,
            )
        case Certificate():
            return check_certificate(evidence)
        case LeapPlan():
            from .leaps import check_leap  # of leaps alone

            return check_leap(evidence, body=True)
        case Crossing():
            from .crossings import check_crossing

            return check_crossing(evidence)
        case Trajectory():
            from .trajectories import check_trajectory  # splines are slow to import

            return check_trajectory(evidence)
    raise TypeError(f"expected a motion or a proof, got a {type(evidence).__name__}")
