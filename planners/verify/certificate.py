"""Independent check of infeasibility certificates of posture problems and courses: matrix-vector work, no solver.

A certificate is a tree that covers all choices of patches, toes and forces, and multipliers a leaf
(``outcome.Certificate``). The tree is replayed from the problem's own patches and force boxes (``tree``), and every
leaf's bound is worked out anew (``lagrangian``), so nothing in a certificate has to be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..answer.outcome import Certificate
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import PostureProblem
from ..problem.course import Course
from .half_spaces import row_counts
from .lagrangian import leaf_bounds
from .soles import counts_of
from .tree import Forest, Replayed

GAP = 1e-4
"""The moment residual that the certificate of a posture has to prove unless another is asked for, non-dimensional."""


@dataclass(frozen=True, kw_only=True)
class CertificateReport:
    """Whether a certificate refutes a posture problem or a course.

    Arguments:
        accepted: every leaf of its tree is refuted.
        lower_bound: proved least moment residual (largest component over force scale times length scale), the worst
            leaf's; inf where the leaf needs no moment balance.
        leaves: how many were checked.
        weakest: the leaf of the least bound, −1 without one.
        message: the verdict in one line.
    Source:
        Lagrangian bounds of E1-E11 at every leaf.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("wall-3", rng=8)[0]
        >>> stancekit.verify(problem, stancekit.solve(problem).certificate).accepted
        True
    """

    accepted: bool
    lower_bound: float
    leaves: int
    weakest: int
    message: str

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; an infinite bound becomes null."""
        bound = self.lower_bound if math.isfinite(self.lower_bound) else None
        return {**vars(self), "lower_bound": bound}


def check_certificate(
    subject: PostureProblem | Course, certificate: Certificate, *, tolerance: float | None = None
) -> CertificateReport:
    """Replay the certificate's tree and bound the moment residual at every leaf; never raises for a bad certificate.

    Accepted when every leaf's bound exceeds ``tolerance`` (non-dimensional moment, not below 0); unless told, that is
    ``GAP`` for a posture problem and 0 for a course. ``explain`` says what the proof gives as its reason.
    """
    of_course = isinstance(subject, Course)
    if tolerance is None:
        tolerance = 0.0 if of_course else GAP
    forest = forest_of(subject)
    try:
        replayed = forest.replay(0, certificate)
    except InvalidInput as error:
        return CertificateReport(accepted=False, lower_bound=0.0, leaves=0, weakest=-1, message=f"rejected: {error}")
    bounds = leaf_bounds(forest.numbers, forest.leaves({0: replayed}))
    weakest, leaves = int(np.argmin(bounds)), len(bounds)
    bound = float(bounds[weakest])
    accepted = bound > max(tolerance, 0.0)
    if not accepted:
        message = f"rejected: leaf {weakest} of {leaves} proves a residual of {bound:.3g}, expected above {tolerance:g}"
    elif math.isinf(bound):
        message = f"refuted at all leaves ({leaves}), even without the balance of moments"
    else:
        scale = subject.weight_n * subject.length_scale_m if isinstance(subject, Course) else subject.moment_scale_nm
        message = f"refuted at all leaves ({leaves}): {bound * scale:.3g} Nm of moment or more are left over"
    return CertificateReport(accepted=accepted, lower_bound=bound, leaves=leaves, weakest=weakest, message=message)


def check_certificates(problems: Sequence[PostureProblem], certificates: Sequence[Certificate]) -> Array:
    """The ``lower_bound`` of ``check_certificate`` for many posture problems at once, shape (B,); 0 for a bad tree.

    A problem is refuted where this exceeds the tolerance, not below 0. Problems may have any number of contacts.
    """
    bounds = np.zeros(len(problems))
    kinds = [(row_counts(problem.contacts), counts_of(problem.contacts)) for problem in problems]
    for kind in set(kinds):
        rows = [row for row, its in enumerate(kinds) if its == kind]
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


def forest_of(subject: PostureProblem | Course) -> Forest:
    """The numbers and patches of a posture problem or a course."""
    return Forest.of_course(subject) if isinstance(subject, Course) else Forest.of_postures((subject,))
