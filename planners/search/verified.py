"""Planners from elsewhere: what they answer counts only as far as the verifier accepts it.

They are given copies, and of what they answer the numbers are taken, once: what they change of either, then or later,
changes nothing here. Whatever they raise is one InvalidInput. They run in this process, for as long as they like: who
trusts one less than that has `stancekit verify` judge what was written.
"""

from __future__ import annotations

import json
import time
from copy import deepcopy
from typing import Any, TypeVar

from ..answer.outcome import Certificate, Outcome, Posture, Status
from ..answer.plan import Plan, PlanOutcome
from ..errors import InvalidInput
from ..files.validation import shown
from ..plugins import foreign
from ..problem import PostureProblem
from ..problem.course import Course
from .answer import Acceptance
from .clock import Clock

Evidence = TypeVar("Evidence", Posture, Certificate, Plan)
NUMBERS = {
    Posture: ("com_m", "rotation_rad", "toes_m", "forces_n", "points_m", "point_forces_n"),
    Certificate: ("tree", "multipliers"),
    Plan: ("com_m", "rotation_rad", "toes_m", "choice", "forces_n", "points_m", "point_forces_n", "modes"),
}
"""What is taken over of each kind of evidence."""


class VerifiedPlanner:
    """A planner of postures from elsewhere; its ``solve`` gives an ``Outcome``, or a posture or certificate alone.

    None, and an outcome without evidence, is undecided, whatever it claims.
    """

    def __init__(self, planner: Any, name: str, acceptance: Acceptance) -> None:
        self._planner, self.name, self._acceptance = _solving(planner, f"method {name}"), name, acceptance

    def solve(self, problem: PostureProblem) -> Outcome:
        """Ask, and have the evidence verified. Raises InvalidInput for an answer of another kind, and a planner that
        raises."""
        begin, where = time.perf_counter(), f"method {self.name}"
        with foreign(where):
            found = self._planner.solve(deepcopy(problem))
            if found is not None and not isinstance(found, Outcome | Posture | Certificate):
                kinds = "an Outcome, a Posture, a Certificate or None"
                raise InvalidInput(f"{where}: expected {kinds}, got {_a(found)}")
            posture, certificate, rest = found, found, dict[str, Any]()
            if isinstance(found, Outcome):
                posture, certificate = found.posture, found.certificate
                rest = {**_told(found, where), "solves": int(found.solves)}
                rest["details"] = {_text(key, where): float(value) for key, value in found.details.items()}
            elif found is not None:
                posture, certificate = (found, None) if isinstance(found, Posture) else (None, found)
            posture, certificate = _taken(Posture, posture, where), _taken(Certificate, certificate, where)
        return self._acceptance.outcome(
            problem, method=self.name, begin=begin, posture=posture, certificate=certificate, **rest
        )


class VerifiedCoursePlanner:
    """A planner of courses from elsewhere; its ``solve`` gives a ``PlanOutcome``, or a plan or certificate alone.

    A plan is taken for one of the course that was asked for; bounds on its objective come without proof, and are left.
    """

    def __init__(self, planner: Any, name: str, acceptance: Acceptance) -> None:
        self._planner, self.name, self._acceptance = _solving(planner, f"planner {name}"), name, acceptance

    def solve(self, course: Course) -> PlanOutcome:
        """Ask, and have the evidence verified. Raises InvalidInput for an answer of another kind, and a planner that
        raises."""
        clock, where = Clock.start(), f"planner {self.name}"
        with foreign(where):
            found = self._planner.solve(deepcopy(course))
            if found is not None and not isinstance(found, PlanOutcome | Plan | Certificate):
                kinds = "a PlanOutcome, a Plan, a Certificate or None"
                raise InvalidInput(f"{where}: expected {kinds}, got {_a(found)}")
            plan, certificate, rest = found, found, dict[str, Any]()
            if isinstance(found, PlanOutcome):
                plan, certificate, rest = found.plan, found.certificate, _told(found, where)
            elif found is not None:
                plan, certificate = (found, None) if isinstance(found, Plan) else (None, found)
            plan, certificate = _taken(Plan, plan, where, course=course), _taken(Certificate, certificate, where)
        return self._acceptance.plan_outcome(
            course, method=self.name, clock=clock, plan=plan, certificate=certificate, **rest
        )


def _solving(planner: Any, where: str) -> Any:
    """A planner. Raises InvalidInput for what is none."""
    if not callable(getattr(planner, "solve", None)):
        raise InvalidInput(f"{where}: expected something with solve, got {_a(planner)}")
    return planner


def _taken(kind: type[Evidence], found: Any, where: str, **given: Any) -> Evidence | None:
    """The numbers of evidence, in an object of our own; None where there is none. Raises InvalidInput, ValueError."""
    if found is None:
        return None
    if not isinstance(found, kind):
        raise InvalidInput(f"{where}: expected a {kind.__name__} as evidence, got {_a(found)}")
    if isinstance(found, Plan):
        given["provenance"] = {"planner": where.partition(" ")[2], "said": _plain(dict(found.provenance))}
    return kind(**{name: getattr(found, name) for name in NUMBERS[kind]}, **given)


def _told(found: Outcome | PlanOutcome, where: str) -> dict[str, str]:
    """What an outcome says of itself, as text. Raises InvalidInput, ValueError."""
    claim = _text(found.claim, where) or Status(found.status).value
    return {"claim": claim, "message": _text(found.message, where)}


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput(f"{where}: expected text in its outcome, got {_a(value)}")
    return str(value)


def _plain(content: dict[str, Any]) -> Any:
    """JSON-ready values, and nothing that is theirs. Raises TypeError, ValueError."""
    return json.loads(json.dumps(content, allow_nan=False))


def _a(found: object) -> str:
    return f"a {type(found).__name__}, {shown(found, 80)}"
