"""Independent check of infeasibility certificates of posture problems and courses: matrix-vector
work, no solver.

A certificate is a tree that covers all choices of patches, toes and forces, and multipliers a leaf
(``outcome.Certificate``). The tree is replayed from the problem's own patches and force boxes
(``tree``), and every leaf's bound is worked out anew (``lagrangian``), so nothing in a certificate
has to be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..answer.certificate import Certificate
from ..answer.report import Report
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..problem.leap import Leap
from ..problem.passage import Passage
from .half_spaces import row_counts
from .lagrangian import leaf_bounds
from .proof import proof_report
from .soles import counts_of
from .tree import Forest, Replayed

GAP = 1e-4
"""The moment residual that the certificate of a posture has to prove unless another is asked for,
non-dimensional."""


def check_certificate(
    certificate: Certificate, *, tolerance: float | None = None, any_sets: bool = False
) -> Report[Certificate]:
    """Replay the certificate's tree and bound the moment residual at every leaf; never raises for a
    bad certificate.

    Accepted when every leaf's bound exceeds ``tolerance`` (non-dimensional moment, not below 0);
    unless told, that is ``GAP`` for a posture problem and 0 for a course. ``explain`` says what the
    proof gives as its reason. Proofs about leaps have limits of their own (``leap_proof``). Raises
    InvalidInput for a certificate that does not know its problem.

    Arguments:
        any_sets: whether a course may be over sets of the robot's legs that are neither its inner
            ones nor hold all that they reach, as planners ask on the way to an answer.
    """
    subject = certificate.refuted
    if isinstance(subject, Leap):
        from .leap_proof import check_leap_certificate  # of leaps alone

        return check_leap_certificate(certificate)
    if isinstance(subject, Passage):
        from .flood import check_flood  # of passages alone

        return check_flood(certificate)
    of_course = not subject.is_posture
    if tolerance is None:
        tolerance = 0.0 if of_course else GAP
    if of_course and not any_sets and (short := _short_sets(subject)):
        return proof_report(certificate, tolerance, 0.0, 0, -1, f"rejected: {short}")
    forest = forest_of(subject)
    try:
        replayed = forest.replay(0, certificate)
    except InvalidInput as error:
        return proof_report(certificate, tolerance, 0.0, 0, -1, f"rejected: {error}")
    bounds = leaf_bounds(forest.numbers, forest.leaves({0: replayed}))
    weakest, leaves = int(np.argmin(bounds)), len(bounds)
    bound = float(bounds[weakest])
    accepted = bound > max(tolerance, 0.0)
    if not accepted:
        message = f"rejected: leaf {weakest} of {leaves} proves a residual of {bound:.3g}, expected above {tolerance:g}"
    elif math.isinf(bound):
        message = f"refuted at all leaves ({leaves}), even without the balance of moments"
    else:
        moment_nm = bound * subject.moment_scale_nm
        message = (
            f"refuted at all leaves ({leaves}): {moment_nm:.3g} Nm of moment or more are left over"
        )
    return proof_report(certificate, tolerance, bound, leaves, weakest, message)


def check_certificates(certificates: Sequence[Certificate]) -> Array:
    """The ``lower_bound`` of ``check_certificate`` for many posture problems at once, shape (B,); 0
    for a bad tree.

    A problem is refuted where this exceeds the tolerance, not below 0. Problems may have any number
    of contacts.
    """
    problems = [_posture_problem(certificate) for certificate in certificates]
    bounds = np.zeros(len(problems))
    kinds = [(row_counts(problem.contacts), counts_of(problem.contacts)) for problem in problems]
    for kind in set(kinds):
        rows = [row for row, of_kind in enumerate(kinds) if of_kind == kind]
        forest = Forest.of_postures([problems[row] for row in rows])
        replayed: dict[int, Replayed] = {}
        for q, row in enumerate(rows):
            try:
                replayed[q] = forest.replay(q, certificates[row])
            except InvalidInput:
                continue
        if replayed:
            begins = np.cumsum([0, *(len(leaves) for leaves, _ in replayed.values())])[:-1]
            each = leaf_bounds(forest.numbers, forest.leaves(replayed))
            bounds[[rows[q] for q in replayed]] = np.minimum.reduceat(each, begins)
    return bounds


def _short_sets(course: Problem) -> str:
    """Why a proof over a course's sets of legs says nothing of anything; empty where they hold all
    that the legs of the robot's file reach, or are the inner ones, of which it then is.
    """
    if not course.robot.source.own:
        return ""
    from ..robot.reach_sets import contains_all
    from ..robot.walker import sets_of

    try:
        if contains_all(course.robot) or sets_of(course.robot) == "inner":
            return ""
    except InvalidInput as error:
        return str(error)
    return (
        f"robot {course.robot.name}: expected sets that hold all that its legs reach wherever its "
        "centre of mass is, got smaller ones"
    )


def _posture_problem(certificate: Certificate) -> Problem:
    """The posture problem that a certificate is of.

    Raises InvalidInput for one of anything else.
    """
    problem = certificate.refuted
    if not (isinstance(problem, Problem) and problem.is_posture):
        raise InvalidInput(
            f"certificate: expected one of a posture problem, got one of a {type(problem).__name__}"
        )
    return problem


def forest_of(subject: Problem) -> Forest:
    """The numbers and patches of a posture problem or a course."""
    return Forest.of_postures((subject,)) if subject.is_posture else Forest.of_course(subject)
