"""Planners from elsewhere: what they answer counts only as far as the verifier accepts it.

They are given copies, and of what they answer the numbers are taken, once: what they change of either, then or later,
changes nothing here. Whatever they raise is one InvalidInput. They run in this process, for as long as they like: who
trusts one less than that has `stancekit verify` judge what was written.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from typing import TYPE_CHECKING, Any, TypeVar

from ..answer.answer import Answer, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..answer.posture import Posture
from ..errors import InvalidInput
from ..files.validation import shown
from ..plugins import foreign
from ..problem import PostureProblem
from ..problem.course import Course
from .answer import Acceptance, Claim, Limitable
from .clock import Clock

if TYPE_CHECKING:
    from ..relaxation.envelope import EnvelopeSet

Evidence = TypeVar("Evidence", Posture, Plan)
Taken = TypeVar("Taken", Posture, Plan, Certificate)
NUMBERS = {
    Posture: ("com_m", "rotation_rad", "toes_m", "forces_n", "points_m", "point_forces_n"),
    Certificate: ("tree", "multipliers"),
    Plan: ("com_m", "rotation_rad", "toes_m", "choice", "forces_n", "points_m", "point_forces_n", "modes"),
}
"""What is taken over of each kind of evidence."""


class VerifiedPlanner:
    """A planner of postures from elsewhere; its ``solve`` gives an ``Answer``, or a posture or certificate alone.

    None, and an answer without evidence, is undecided, whatever it claims. envelopes: that it was made with.
    """

    def __init__(
        self, planner: Any, name: str, acceptance: Acceptance, envelopes: EnvelopeSet | None = None
    ) -> None:
        self._planner, self.name, self._acceptance = _solving(planner, f"method {name}"), name, acceptance
        self._envelopes = envelopes

    def solve(self, problem: PostureProblem) -> Answer[Posture]:
        """Ask, and have the evidence verified. Raises InvalidInput for an answer of another kind, a planner that
        raises, and envelopes that were learned for other problems."""
        if self._envelopes is not None:
            self._envelopes.check_fits(problem)
        clock = Clock.start()
        claim, solves = _asked(self._planner, problem, f"method {self.name}", Posture)
        clock.count(solves, 0.0)
        return self._acceptance.answer(problem, claim, method=self.name, clock=clock)


class VerifiedCoursePlanner:
    """A planner of courses from elsewhere; its ``solve`` gives an ``Answer``, or a plan or certificate alone.

    A plan is taken for one of the course that was asked for; bounds on its objective come without proof, and are left.
    remake: a function that makes the planner anew with another time limit [s]; None where there is no such function.
    """

    def __init__(
        self, planner: Any, name: str, acceptance: Acceptance, remake: Callable[[float], Any] | None = None
    ) -> None:
        self._planner, self.name, self._acceptance = _solving(planner, f"planner {name}"), name, acceptance
        self._remake = remake

    def with_limit(self, limit_s: float) -> VerifiedCoursePlanner:
        """The planner made anew with this time limit [s]; itself where nobody can limit it."""
        if self._remake is None and not isinstance(self._planner, Limitable):
            return self
        with foreign(f"planner {self.name}"):
            planner = self._planner.with_limit(limit_s) if self._remake is None else self._remake(limit_s)
        return VerifiedCoursePlanner(planner, self.name, self._acceptance, self._remake)

    def solve(self, course: Course) -> Answer[Plan]:
        """As ``VerifiedPlanner.solve``."""
        clock = Clock.start()
        claim, solves = _asked(self._planner, course, f"planner {self.name}", Plan, course=course)
        clock.count(solves, 0.0)
        return self._acceptance.answer(course, claim, method=self.name, clock=clock)


def _asked(
    planner: Any, subject: Any, where: str, kind: type[Evidence], **given: Any
) -> tuple[Claim[Evidence], int]:
    """What a planner claims, and how many solves it says that it took.

    kind: of the evidence. given: what the evidence is made with. Raises InvalidInput.
    """
    with foreign(where):
        found, rest, solves = planner.solve(deepcopy(subject)), dict[str, Any](), 0
        if found is not None and not isinstance(found, Answer | kind | Certificate):
            names = f"an Answer, a {kind.__name__}, a Certificate or None"
            raise InvalidInput(f"{where}: expected {names}, got {_a(found)}")
        evidence: Any
        certificate: Any
        evidence, certificate = (None, found) if isinstance(found, Certificate) else (found, None)
        if isinstance(found, Answer):
            evidence, certificate, solves = found.solution, found.certificate, int(found.effort.solves)
            rest["word"] = _text(found.claim, where) or Status(found.status).value
            rest["message"] = _text(found.message, where)
            rest["details"] = {_text(key, where): float(value) for key, value in found.details.items()}
        taken = _taken(kind, evidence, where, **given)
        return Claim(found=taken, certificate=_taken(Certificate, certificate, where), **rest), solves


def _solving(planner: Any, where: str) -> Any:
    """A planner. Raises InvalidInput for what is none."""
    if not callable(getattr(planner, "solve", None)):
        raise InvalidInput(f"{where}: expected something with solve, got {_a(planner)}")
    return planner


def _taken(kind: type[Taken], found: Any, where: str, **given: Any) -> Taken | None:
    """The numbers of evidence, in an object of our own; None where there is none. Raises InvalidInput, ValueError."""
    if found is None:
        return None
    if not isinstance(found, kind):
        raise InvalidInput(f"{where}: expected a {kind.__name__} as evidence, got {_a(found)}")
    if isinstance(found, Plan):
        given["provenance"] = {"planner": where.partition(" ")[2], "said": _plain(dict(found.provenance))}
    return kind(**{name: getattr(found, name) for name in NUMBERS[kind]}, **given)


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput(f"{where}: expected text in its outcome, got {_a(value)}")
    return str(value)


def _plain(content: dict[str, Any]) -> Any:
    """JSON-ready values, and nothing that is theirs. Raises TypeError, ValueError."""
    return json.loads(json.dumps(content, allow_nan=False))


def _a(found: object) -> str:
    return f"a {type(found).__name__}, {shown(found, 80)}"
