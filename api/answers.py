"""Answers: check them anew, and say why there is none."""

from __future__ import annotations

from typing import overload

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.data.labelling import RecheckReport, recheck
from stancekit.planners.answer.outcome import Certificate, Posture
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.problem import PostureProblem
from stancekit.planners.problem.course import Course
from stancekit.planners.verify import CertificateReport, Report, check_certificate, check_plan, check_posture
from stancekit.planners.verify import explain as _explain
from stancekit.planners.verify.trajectories import GaitReport, check_trajectory

explain = checked(_explain)


@overload
def verify(subject: PostureProblem, answer: Posture, *, tolerance: float = 1e-6) -> Report: ...
@overload
def verify(subject: PostureProblem | Course, answer: Certificate) -> CertificateReport: ...
@overload
def verify(subject: Plan, answer: None = None, *, tolerance: float = 1e-6) -> Report: ...
@overload
def verify(subject: Trajectory, answer: None = None) -> GaitReport: ...
@overload
def verify(subject: Dataset, answer: None = None) -> RecheckReport: ...
@checked
def verify(
    subject: PostureProblem | Course | Plan | Trajectory | Dataset,
    answer: Posture | Certificate | None = None,
    *,
    tolerance: float = 1e-6,
) -> Report | CertificateReport | GaitReport | RecheckReport:
    """Check an answer anew, by code that knows the problem and nothing of how the answer was made, without a solver.

    Arguments:
        subject: a posture problem with its ``answer``, a posture or a certificate; a course with a certificate that it
            has no plan; or alone, what carries its question: a plan of key frames, a gait trajectory, a data set.
        answer: what is claimed of the problem or course.
        tolerance: largest violation of a constraint by an accepted posture or plan, non-dimensional. Certificates and
            walks have limits of their own.
    Returns:
        A report: ``accepted``, and what is violated, where and by how much.
    Raises:
        InvalidInput: for a pair that does not belong together. A bad answer is refused in the report, and not raised.
    Source:
        E1-E11; W2-W7, between the knots, too.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> posture = stancekit.solve(problem).posture
        >>> stancekit.verify(problem, posture).accepted
        True
    """
    match subject, answer:
        case PostureProblem(), Posture():
            return check_posture(subject, answer, tolerance=tolerance)
        case (PostureProblem() | Course()), Certificate():
            return check_certificate(subject, answer)
        case Plan(), None:
            return check_plan(subject, tolerance=tolerance, joints=True)
        case Trajectory(), None:
            return check_trajectory(subject)
        case Dataset(), None:
            return recheck(subject)
    came = " with ".join(type(one).__name__ for one in (subject, answer) if one is not None)
    raise InvalidInput(
        "verify: expected a posture problem with a posture or a certificate, a course with a certificate, or alone a "
        f"plan, a trajectory or a data set; got {came}"
    )
