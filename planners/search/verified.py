"""Planners from elsewhere: what they answer counts only as far as the verifier accepts it.

They are given copies, and of what they answer the numbers are taken, once: what they change of
either, then or later, changes nothing here. Whatever they raise is one InvalidInput. They run in
this process, for as long as they like: who trusts one less than that has `stancekit verify` judge
what was written.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from ..answer.answer import Answer, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.documents import shown
from ..plugins import foreign
from ..problem import Problem
from .answer import Acceptance, Claim, Kind, kind_of
from .clock import Clock

if TYPE_CHECKING:
    from ..relaxation.envelope import EnvelopeSet

Taken = TypeVar("Taken", Plan, Certificate)
NUMBERS = {
    Certificate: ("tree", "multipliers"),
    Plan: (
        "com_m",
        "rotation_rad",
        "toes_m",
        "choice",
        "forces_n",
        "points_m",
        "point_forces_n",
        "modes",
    ),
}
"""Numbers that are taken over of each kind of evidence."""


class VerifiedPlanner:
    """A planner from elsewhere; its ``solve`` gives an ``Answer``, or a plan or a certificate
    alone.

    None, and an answer without evidence, is undecided, whatever it claims. A plan is taken for one
    of the problem that was asked for; bounds on its objective come without proof, and are left.

    Arguments:
        called: what messages call it.
        envelopes: that it was made with.
        remake: a function that makes the planner anew with another time limit [s]; None where there
            is no such function.
    """

    def __init__(
        self,
        planner: Any,
        name: str,
        acceptance: Acceptance,
        *,
        called: str = "method",
        envelopes: EnvelopeSet | None = None,
        remake: Callable[[float], Any] | None = None,
    ) -> None:
        self.name, self._acceptance, self._where = name, acceptance, f"{called} {name}"
        self._planner, self._called = _solving(planner, self._where), called
        self._envelopes, self._remake = envelopes, remake

    def with_limit(self, limit_s: float) -> VerifiedPlanner:
        """The planner made anew with this time limit [s]; itself where nobody can limit it."""
        if self._remake is None and not hasattr(self._planner, "with_limit"):
            return self
        with foreign(self._where):
            planner = (
                self._planner.with_limit(limit_s) if self._remake is None else self._remake(limit_s)
            )
        return VerifiedPlanner(
            planner,
            self.name,
            self._acceptance,
            called=self._called,
            envelopes=self._envelopes,
            remake=self._remake,
        )

    def solve(self, problem: Problem) -> Answer[Plan]:
        """Ask, and have the evidence verified.

        Raises InvalidInput for an answer of another kind, a planner that raises or answers another
        kind of question alone, and envelopes that were learned for other problems.
        """
        check_answers(self._planner, kind_of(problem), self._where)
        if self._envelopes is not None and problem.is_posture:
            self._envelopes.check_fits(problem)
        clock = Clock.start()
        claim, solves = _asked(self._planner, problem, self._where)
        clock.count(solves, 0.0)
        return self._acceptance.answer(problem, claim, method=self.name, clock=clock)


def check_answers(planner: Any, kind: Kind, where: str) -> None:
    """Raise InvalidInput for a planner that says, by its attribute ``answers``, that it answers
    another kind of question alone.

    Arguments:
        where: what the message begins with.
    """
    answered = getattr(planner, "answers", None)
    if answered in get_args(Kind) and answered != kind:
        raise InvalidInput(
            f"{where}: expected a planner of {kind}, got one that answers {answered} alone"
        )


def _asked(planner: Any, problem: Problem, where: str) -> tuple[Claim, int]:
    """Claim of a planner, and the number of solves that it reports.

    Raises InvalidInput.
    """
    with foreign(where):
        claim, rest, solves = planner.solve(deepcopy(problem)), dict[str, Any](), 0
        if claim is not None and not isinstance(claim, Answer | Plan | Certificate):
            raise InvalidInput(
                f"{where}: expected an Answer, a Plan, a Certificate or None, got {_a(claim)}"
            )
        evidence: Any
        certificate: Any
        evidence, certificate = (None, claim) if isinstance(claim, Certificate) else (claim, None)
        if isinstance(claim, Answer):
            evidence, certificate, solves = (
                claim.solution,
                claim.certificate,
                int(claim.effort.solves),
            )
            rest["word"] = _text(claim.claim, where) or Status(claim.status).value
            rest["message"] = _text(claim.message, where)
            rest["details"] = {
                _text(key, where): float(value) for key, value in claim.details.items()
            }
        solution = _taken(Plan, evidence, where, problem=problem)
        return Claim(
            plan=solution, certificate=_taken(Certificate, certificate, where), **rest
        ), solves


def _solving(planner: Any, where: str) -> Any:
    """A planner.

    Raises InvalidInput for what is none.
    """
    if not callable(getattr(planner, "solve", None)):
        raise InvalidInput(f"{where}: expected something with solve, got {_a(planner)}")
    return planner


def _taken(kind: type[Taken], found: Any, where: str, **given: Any) -> Taken | None:
    """The numbers of evidence, in an object of our own; None where there is none.

    Raises InvalidInput, ValueError.
    """
    if found is None:
        return None
    if not isinstance(found, kind):
        raise InvalidInput(f"{where}: expected a {kind.__name__} as evidence, got {_a(found)}")
    if isinstance(found, Plan):
        given["provenance"] = {
            "planner": where.partition(" ")[2],
            "said": _plain(dict(found.provenance)),
        }
    return kind(**{name: getattr(found, name) for name in NUMBERS[kind]}, **given)


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput(f"{where}: expected text in its outcome, got {_a(value)}")
    return str(value)


def _plain(content: dict[str, Any]) -> Any:
    """JSON-ready values, and nothing that is theirs.

    Raises TypeError, ValueError.
    """
    return json.loads(json.dumps(content, allow_nan=False))


def _a(found: object) -> str:
    return f"a {type(found).__name__}, {shown(found, 80)}"
