"""Base of every planner, and the one way from its claim to an answer: only through the verifier."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol, Self

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..problem import Problem
from ..verify import check_certificate, check_plan
from .clock import Clock

Kind = Literal["postures", "courses"]
"""The two kinds of question that planners are asked."""
POSTURE_LIMIT_S, COURSE_LIMIT_S = 30.0, 60.0
"""Time limits of one posture problem and of one course where none is given [s]."""
GIVEN = "with the reach that the problem gives the legs of {}, whatever else they reach"
"""Reason of an infeasible posture of a robot's file: problems are drawn over the inner sets of its
legs."""


class Planner(Protocol):
    """Anything that answers problems: posture problems, courses, or both.

    ``name`` is its name on the command line. One whose time can be limited from outside has
    ``with_limit``, see ``TimeLimited``.
    """

    name: str

    def solve(self, problem: Problem, /) -> Answer[Plan]:
        """Answer one problem.

        Raises InvalidInput where the planner is not made for it.
        """
        ...


class TimeLimited:
    """Mixin of the planners that have a time limit ``time_limit_s`` [s]; None for the usual one."""

    time_limit_s: float | None
    _most_s: float = math.inf

    def limit_s(self, kind: Kind) -> float:
        """Time limit of one problem of a kind [s]."""
        usual_s = POSTURE_LIMIT_S if kind == "postures" else COURSE_LIMIT_S
        return min(usual_s if self.time_limit_s is None else self.time_limit_s, self._most_s)

    def with_limit(self, limit_s: float) -> Self:
        """A copy that takes no longer than this [s], nor longer than its own limit."""
        limited = copy(self)
        limited._most_s = max(min(limit_s, self._most_s), 0.0)
        if self.time_limit_s is not None:
            limited.time_limit_s = min(self.time_limit_s, limited._most_s)
        return limited


def kind_of(problem: Problem) -> Kind:
    """Kind of question that a problem is."""
    return "postures" if problem.is_posture else "courses"


def check_unused(planner: Planner, **usual: Any) -> None:
    """Raise InvalidInput for a setting that postures have no use for.

    Arguments:
        usual: by name, what the settings of courses alone are by default.
    """
    for name, value in usual.items():
        came = getattr(planner, name)
        if came != value:
            raise InvalidInput(
                f"{name}: expected no such argument with {planner.name} for postures, which have "
                f"no use for it, got {came}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Claim:
    """Claim of a planner about a problem, before anybody believes it.

    Arguments:
        plan: a plan.
        certificate: a proof that there is none.
        word: its verdict in its own word, e.g. a solver's "optimal".
        message: why it has neither, or what else is to be known.
        details: its figures, by name.
    """

    plan: Plan | None = None
    certificate: Certificate | None = None
    word: str = ""
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """When a claim is accepted.

    Arguments:
        tolerance: largest violation of any constraint by a posture or a plan, non-dimensional.
        gap: moment residual that a certificate of a posture problem must prove, non-dimensional.
    """

    tolerance: float = 1e-6
    gap: float = 1e-4

    def answer(
        self,
        problem: Problem,
        claim: Claim,
        *,
        method: str,
        clock: Clock,
        bound: float = float("nan"),
    ) -> Answer[Plan]:
        """Feasible if the plan is verified, infeasible if the certificate is, else undecided.

        Arguments:
            bound: on the objective of any plan, proved.
        """
        status, report, begin, message = Status.UNDECIDED, None, clock.elapsed(), claim.message
        certificate: Certificate | None = None
        plan = claim.plan
        if plan is not None:
            plan = plan if plan.problem is problem else replace(plan, problem=problem)
            report = check_plan(
                plan, tolerance=self.tolerance, between=False
            )  # convexity proves the way
            if report.accepted:
                status = Status.FEASIBLE
            else:
                kind = "witness" if problem.is_posture else "plan"
                message = message or f"{kind} refused: {report.message}"
        posed = problem.is_posture
        bound = 0.0 if posed else bound
        if claim.certificate is not None and status is Status.UNDECIDED:
            certificate = claim.certificate.of(problem)
            gap = self.gap if posed else 0.0
            proof = check_certificate(certificate, tolerance=gap, any_sets=True)
            bound = proof.figures["lower_bound"] if posed else bound
            if proof.accepted:
                status = Status.INFEASIBLE
                bound, message = (
                    (bound, _given(problem)) if posed else (float("inf"), proof.message)
                )
            else:
                message = message or f"certificate refused: {proof.message}"
        solution, seconds = plan if status is Status.FEASIBLE else None, clock.elapsed()
        return Answer(
            status=status,
            method=method,
            problem=problem,
            solution=solution,
            certificate=certificate if status is Status.INFEASIBLE else None,
            report=report
            if posed or solution is None
            else None,  # a course's comes with its whole body
            objective=float("nan") if posed or solution is None else objective_of(solution),
            bound=bound,
            residual=float("nan") if report is None else report.worst,
            effort=Effort(
                solves=clock.solves,
                compile_s=clock.compile_s,
                seconds=seconds - clock.compile_s,
                solver_s=clock.solver_s,
                verifier_s=seconds - begin,
            ),
            claim=claim.word,
            message=message,
            details=dict(claim.details),
        )


def _given(problem: Problem) -> str:
    """Set that a proof of a posture problem is over, where its robot may reach further."""
    return (
        GIVEN.format(problem.robot.identity)
        if problem.is_posture and problem.robot.identity
        else ""
    )


def plan_of(
    problem: Problem,
    scaled: Scaled,
    choice: Index,
    point: Point,
    *,
    provenance: Mapping[str, Any] | None = None,
    modes: Index | None = None,
) -> Plan:
    """Give a point on one choice of candidates its units back.

    Arguments:
        scaled: as asked for, or chosen.
        choice: shape (P,), of a posture ``scaled.numbers``.
    """
    chosen = scaled.chosen(choice)
    forces, soles = chosen.forces_si(point)
    return Plan(
        problem=problem,
        com_m=point.com * scaled.length_m,
        rotation_rad=point.rotation,
        toes_m=point.toes * scaled.length_m,
        choice=choice,
        forces_n=forces,
        **soles,
        modes=modes,
        provenance=provenance or {},
    )


def objective_of(plan: Plan) -> float:
    """The objective of ``Weights`` at a plan, SI: recomputed, whatever a solver said."""
    course, weights = plan.problem, plan.problem.aim
    cost = weights.goal * float(np.sum((plan.com_m[-1] - course.goal_m) ** 2))
    cost += weights.com_path * float(np.sum((plan.com_m - course.com_nominal_m) ** 2))
    cost += weights.tilt * float(np.sum(plan.rotation_rad**2))
    cost += weights.com_step * float(np.sum(np.diff(plan.com_m, axis=0) ** 2))
    if course.standing_m is not None:
        away = plan.toes_m[course.holds] - plan.com_m[:, None] - course.standing_m
        cost += weights.stance * float(np.sum(away**2))
    steps = np.array([plan.toes_at(k) - plan.toes_at(k - 1) for k in range(1, course.frames)])
    return cost + weights.toe_step * float(np.sum(steps**2))
