"""Planners from elsewhere: what they answer counts only as far as the verifier accepts it."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from ..answer.outcome import Certificate, Outcome, Posture
from ..answer.plan import Plan, PlanOutcome
from ..errors import InvalidInput
from ..files.refusals import shown
from ..problem import PostureProblem
from ..problem.course import Course
from .answer import Acceptance
from .clock import Clock


class VerifiedPlanner:
    """A planner of postures from elsewhere; its ``solve`` gives an ``Outcome``, or a posture or certificate alone.

    None, and an outcome without evidence, is undecided, whatever it claims.
    """

    def __init__(self, planner: Any, name: str, acceptance: Acceptance) -> None:
        self._planner, self.name, self._acceptance = planner, name, acceptance

    def solve(self, problem: PostureProblem) -> Outcome:
        """Ask, and have the evidence verified. Raises InvalidInput for an answer of another kind."""
        begin = time.perf_counter()
        found = self._planner.solve(problem)
        if found is None or isinstance(found, Posture | Certificate):
            return self._acceptance.outcome(
                problem, method=self.name, begin=begin, posture=found if isinstance(found, Posture) else None,
                certificate=found if isinstance(found, Certificate) else None,
            )  # fmt: skip
        if not isinstance(found, Outcome):
            kinds = "an Outcome, a Posture, a Certificate or None"
            raise InvalidInput(f"method {self.name}: expected {kinds}, got {_a(found)}")
        return self._acceptance.outcome(
            problem, method=self.name, begin=begin, posture=found.posture, certificate=found.certificate,
            solves=found.solves, claim=found.claim or found.status.value, message=found.message, details=found.details,
        )  # fmt: skip


class VerifiedCoursePlanner:
    """A planner of courses from elsewhere; its ``solve`` gives a ``PlanOutcome``, or a plan or certificate alone.

    A plan is taken for one of the course that was asked for; bounds on its objective come without proof, and are left.
    """

    def __init__(self, planner: Any, name: str, acceptance: Acceptance) -> None:
        self._planner, self.name, self._acceptance = planner, name, acceptance

    def solve(self, course: Course) -> PlanOutcome:
        """Ask, and have the evidence verified. Raises InvalidInput for an answer of another kind."""
        clock = Clock.start()
        found = self._planner.solve(course)
        plan, certificate, claim, message = None, None, "", ""
        if isinstance(found, PlanOutcome):
            plan, certificate, message = found.plan, found.certificate, found.message
            claim = found.claim or found.status.value
        elif isinstance(found, Plan):
            plan = found
        elif isinstance(found, Certificate):
            certificate = found
        elif found is not None:
            kinds = "a PlanOutcome, a Plan, a Certificate or None"
            raise InvalidInput(f"planner {self.name}: expected {kinds}, got {_a(found)}")
        return self._acceptance.plan_outcome(
            course, method=self.name, clock=clock, plan=None if plan is None else replace(plan, course=course),
            certificate=certificate, claim=claim, message=message,
        )  # fmt: skip


def _a(found: object) -> str:
    return f"a {type(found).__name__}, {shown(found, 80)}"
