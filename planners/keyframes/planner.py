"""What every planner of courses is, and how its claim becomes an answer: only through the verifier."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..outcome import Certificate, Status
from ..plan import Plan, PlanOutcome
from ..scene.course import Course
from ..verify import check_certificate, check_plan
from .clock import Clock
from .layout import Index
from .project import PlanPoint
from .scaled import ScaledCourse


class CoursePlanner(Protocol):
    """Anything that answers courses. ``name`` is its name on the command line."""

    name: str

    def solve(self, course: Course) -> PlanOutcome:
        """Answer one course. Raises InvalidInput where the planner is not made for it."""
        ...


def plan_of(
    scaled: ScaledCourse, choice: Index, point: PlanPoint, *, provenance: Mapping[str, Any], modes: Index | None = None
) -> Plan:
    """Give a point its units back. scaled: as asked for, with all its regions; choice: shape (P,)."""
    course, (stance, limb, placement) = scaled.course, scaled.layout.bearing
    frames = scaled.chosen(choice).frames[placement]
    forces = np.zeros((len(scaled.layout.stances), scaled.layout.limbs, 3))
    forces[stance, limb] = np.matmul(frames, point.forces[..., None])[..., 0] * course.weight_n
    return Plan(
        course=course,
        com_m=point.com * course.length_scale_m,
        rotation_rad=point.rotation,
        toes_m=point.toes * course.length_scale_m,
        choice=choice,
        forces_n=forces,
        modes=modes,
        provenance=provenance,
    )


def objective_of(plan: Plan) -> float:
    """The objective of ``Weights`` at a plan, SI: recomputed, whatever a solver said."""
    course, weights = plan.course, plan.course.weights
    cost = weights.goal * float(np.sum((plan.com_m[-1] - course.goal_m) ** 2))
    cost += weights.tilt * float(np.sum(plan.rotation_rad**2))
    cost += weights.com_step * float(np.sum(np.diff(plan.com_m, axis=0) ** 2))
    steps = np.array([plan.toes_at(k) - plan.toes_at(k - 1) for k in range(1, course.frames)])
    return cost + weights.toe_step * float(np.sum(steps**2))


@dataclass(frozen=True, kw_only=True)
class PlanAcceptance:
    """When a claim is accepted. tolerance: largest violation of any constraint by a plan, non-dimensional."""

    tolerance: float = 1e-6

    def outcome(
        self,
        course: Course,
        *,
        method: str,
        clock: Clock,
        plan: Plan | None = None,
        certificate: Certificate | None = None,
        bound: float = float("nan"),
        claim: str = "",
        message: str = "",
        details: Mapping[str, float] | None = None,
    ) -> PlanOutcome:
        """Feasible if the plan is verified, infeasible if the certificate is, else undecided."""
        status, residual, kept, begin = Status.UNDECIDED, float("nan"), None, clock.elapsed()
        if plan is not None:
            report = check_plan(plan, tolerance=self.tolerance, between=False)  # convexity proves the way between
            residual = report.worst
            if report.accepted:
                status, kept = Status.FEASIBLE, plan
            else:
                message = message or f"plan refused: {report.message}"
        if certificate is not None and kept is None:
            proof = check_certificate(course, certificate)
            if proof.accepted:
                status, bound, message = Status.INFEASIBLE, float("inf"), proof.message
            else:
                message = message or f"certificate refused: {proof.message}"
        seconds = clock.elapsed()
        verifier_seconds = seconds - begin
        return PlanOutcome(
            status=status,
            method=method,
            plan=kept,
            objective=objective_of(kept) if kept is not None else float("nan"),
            bound=bound,
            certificate=certificate if status is Status.INFEASIBLE else None,
            residual=residual,
            solves=clock.solves,
            compile_s=clock.compile_s,
            seconds=seconds - clock.compile_s,
            solver_seconds=clock.solver_s,
            verifier_seconds=verifier_seconds,
            claim=claim,
            message=message,
            details=dict(details or {}),
        )
