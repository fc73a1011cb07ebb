"""What every posture planner is, and how a planner's claim becomes an answer: only through the verifier."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ..outcome import Certificate, Outcome, Posture, Status
from ..scene import PostureProblem
from ..verify import check_certificate, check_posture


class Planner(Protocol):
    """Anything that answers posture problems. ``name`` is the method's name on the command line."""

    name: str

    def solve(self, problem: PostureProblem) -> Outcome:
        """Answer one problem. Raises InvalidInput where the planner is not made for it."""
        ...


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """When a claim is accepted.

    tolerance: largest violation of any constraint by a witness, non-dimensional.
    gap: moment residual that a certificate must prove, non-dimensional.
    """

    tolerance: float = 1e-6
    gap: float = 1e-4

    def outcome(
        self,
        problem: PostureProblem,
        *,
        method: str,
        begin: float,
        posture: Posture | None = None,
        certificate: Certificate | None = None,
        solves: int = 0,
        claim: str = "",
        message: str = "",
        details: Mapping[str, float] | None = None,
    ) -> Outcome:
        """Feasible if the posture is verified, infeasible if the certificate is, else undecided.

        begin: ``time.perf_counter()`` when the work on the problem began.
        """
        status, lower_bound = Status.UNDECIDED, 0.0
        residual = residual_nm = float("nan")
        if posture is not None:
            report = check_posture(problem, posture, tolerance=self.tolerance)
            residual, residual_nm = report.worst, report.residual_nm
            if report.accepted:
                status = Status.FEASIBLE
            else:
                message = message or f"witness refused: {report.message}"
        if certificate is not None and status is Status.UNDECIDED:
            proof = check_certificate(problem, certificate, tolerance=self.gap)
            lower_bound = proof.lower_bound
            if proof.accepted:
                status, message = Status.INFEASIBLE, ""
            else:
                message = message or f"certificate refused: {proof.message}"
        return Outcome(
            status=status,
            method=method,
            posture=posture if status is Status.FEASIBLE else None,
            certificate=certificate if status is Status.INFEASIBLE else None,
            residual=residual,
            residual_nm=residual_nm,
            lower_bound=lower_bound,
            solves=solves,
            seconds=time.perf_counter() - begin,
            claim=claim,
            message=message,
            details=dict(details or {}),
        )
