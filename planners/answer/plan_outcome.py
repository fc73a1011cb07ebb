"""The outcome of a planner on a course: a plan with its report, a certificate, or what is known when the time ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..problem.course import Course
from .outcome import Certificate, Status
from .plan import Plan
from .report import Report

if TYPE_CHECKING:
    from ..robot.contact_robot import Sets


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanOutcome:
    """What one planner says of one course.

    Arguments:
        status: of the course itself; of a robot with legs of its own, infeasible is proved over their outer sets.
        method: which planner.
        problem: the course that was answered, of which a certificate is a proof: over the outer sets of the legs where
            there are any. None in the outcome of a foreign planner that nobody has verified.
        plan: accepted by the verifier where ``status`` is feasible.
        objective: of the plan.
        bound: proved lower bound on the objective of any plan (inf where none exists, NaN where nothing is proved).
        certificate: of infeasibility.
        residual: largest violation of any constraint, non-dimensional.
        solves: convex problems solved.
        compile_s: time to write the model down [s].
        seconds: everything else [s], of which solver_seconds in the conic solver itself and verifier_seconds in the
            verifier.
        claim: what a method says that cannot prove it.
        message: why it is undecided.
        details: further numbers of the method.
        report: the verifier's report on all of the plan, joints, torque, bodies and motion too; None without a plan,
            and where contacts alone were asked for.
    Source:
        Paper E §IV-B.
    Example:
        >>> import stancekit
        >>> outcome = stancekit.plan("stairs", frames=3, reserve=False)
        >>> outcome.bound <= outcome.objective
        True
    """

    status: Status
    method: str
    problem: Course | None = None
    plan: Plan | None = None
    objective: float = float("nan")
    bound: float = float("nan")
    certificate: Certificate | None = None
    residual: float = float("nan")
    solves: int = 0
    compile_s: float = 0.0
    seconds: float = 0.0
    solver_seconds: float = 0.0
    verifier_seconds: float = 0.0
    claim: str = ""
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)
    report: Report[Plan] | None = None

    @property
    def sets(self) -> Sets | None:
        """The sets of the robot's legs that ``problem`` is over; None for a robot without legs, or with other sets."""
        if self.problem is None:
            return None
        from ..robot.contact_robot import sets_of

        return sets_of(self.problem.robot)
