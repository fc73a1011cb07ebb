"""Least steps (E11), branched over directions: around any planner of courses.

The planner is asked for the course without them first; where a step of its plan is too short, for
the course on which all steps go on as they go there, each beyond a half-space (``projection.
least_steps``), which is inside the paper's set. Where that gives no plan, the directions of the
shortest step are parted into sides (``problem.sides``), each with the half-space that is its hull,
outside the paper's set. A proof is made of the proofs for all sides that are met; where one of
them has none, the course is undecided.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..files.arrays import Array
from ..problem import Problem
from ..problem.contact import OPEN, half_space, parts, too_small
from ..projection.force_distribution import along, lengths_of
from .answer import Acceptance, Claim, TimeLimited, kind_of
from .clock import Clock

TRIES = 3
"""Plans that go on as the last one goes, before a side is parted."""
SHARE = 0.5
"""Share of the time that is left which one question may take: a planner that seeks the best plan takes
all that it gets."""
MOST_ASKED = 100
"""Questions to a planner that has no limit of time."""
SHORT = 1e-6
"""A step that is shorter than δ by less than this is long enough [m or rad]."""
Sides = tuple[Array | None, ...]
Proof = tuple[list[list[float]], list[Array]]
"""Nodes of a tree, and the multipliers of its leaves."""


def over_sides(solve: Callable[[Any, Problem], Answer[Plan]]) -> Callable[..., Answer[Plan]]:
    """Decorate ``solve`` of a planner: courses with least steps are branched over directions."""

    @functools.wraps(solve)
    def branched(planner: Any, course: Problem, /, **more: Any) -> Answer[Plan]:
        if course.sides is not None or not len(course.least_steps):
            return solve(planner, course, **more)
        return _Search(planner, solve, course).answer()

    return branched


class _Search:
    """One course: depth first, each part by the part in which the parent's plan goes first."""

    def __init__(
        self, planner: Any, solve: Callable[[Any, Problem], Answer[Plan]], course: Problem
    ) -> None:
        self._planner, self._solve, self._course = planner, solve, course
        limited = isinstance(planner, TimeLimited)
        self._clock = Clock.start(planner.limit_s(kind_of(course)) if limited else math.inf)
        self._plan: Plan | None = None
        self._message, self._parts, self._asked = "", 0, 0
        self._bound = math.nan
        self._room = _most(course) / course.least_steps

    def answer(self) -> Answer[Plan]:
        """Search to the end, or to the time limit, and put what was found to the verifier."""
        acceptance: Acceptance = self._planner.acceptance
        proof = self._proof((None,) * len(self._course.least_steps), 0)
        certificate = None
        if proof is not None and proof[1]:
            tree, rows = np.array(proof[0], dtype=np.float64), np.concatenate(proof[1])
            certificate = Certificate(tree=tree, multipliers=rows)
        if self._plan is None and certificate is None and not self._message:
            self._message = "no plan was found in the directions of least steps that were tried"
        details = {"asked": float(self._asked), "parted": float(self._parts)}
        claim = Claim(
            plan=self._plan, certificate=certificate, message=self._message, details=details
        )
        return acceptance.answer(
            self._course, claim, method=self._planner.name, clock=self._clock, bound=self._bound
        )

    def _proof(self, sides: Sides, depth: int) -> Proof | None:
        """A proof that no plan goes by these sides; None with a plan, or without either."""
        outcome = self._ask(replace(self._course, sides=self._rows(sides)))
        if outcome is None:
            return None
        if depth == 0:
            self._bound = outcome.bound
        if outcome.certificate is not None:
            tree = outcome.certificate.tree.tolist()
            return tree, [outcome.certificate.multipliers]
        plan = outcome.solution
        if plan is None:
            self._message = self._message or outcome.message
            return None
        for _ in range(TRIES):
            if self._kept(plan):
                return None
            further = self._ask(along(self._course, plan))
            if further is None:
                return None
            if further.solution is None:
                break
            plan = further.solution
        if self._kept(plan):
            return None
        return self._parted(sides, outcome.solution, depth)

    def _parted(self, sides: Sides, plan: Plan | None, depth: int) -> Proof | None:
        """The proof over the parts of one step's side, in their order: of the steps that are too
        short the one whose side is the smallest, then the one that has the least room.
        """
        assert plan is not None
        steps, lengths = lengths_of(plan, self._course)
        short = np.flatnonzero(lengths < self._course.least_steps - SHORT)
        open_ = [e for e in short.tolist() if not too_small(sides[e])]
        if not open_:
            self._message = self._message or "the directions of least steps are parted no further"
            return None
        e = min(open_, key=lambda e: (_breadth(sides[e]), self._room[e], lengths[e]))
        self._parts += 1
        pieces = parts(sides[e])
        order = np.argsort([-float((piece @ steps[e]).min()) for piece in pieces], kind="stable")
        proofs: dict[int, Proof] = {}
        for index in order.tolist():
            child = (*sides[:e], pieces[index], *sides[e + 1 :])
            proof = self._proof(child, depth + 1)
            if self._plan is not None or self._clock.ended():
                return None
            if proof is not None:
                proofs[index] = proof
        if len(proofs) < len(pieces):
            return None
        tree: list[list[float]] = [[4.0, float(e), 0.0, 0.0, 0.0]]
        rows: list[Array] = []
        for index in range(len(pieces)):
            tree += proofs[index][0]
            rows += proofs[index][1]
        return tree, rows

    def _ask(self, course: Problem) -> Answer[Plan] | None:
        """The planner's answer in the time that is left; None where none is."""
        left_s = self._clock.left()[0]
        if self._asked >= MOST_ASKED and left_s == math.inf:
            self._message = (
                f"the search over directions of least steps met its limit of {MOST_ASKED} questions"
            )
            return None
        if left_s <= 0.0:
            self._message = "the search over directions of least steps met its time limit"
            return None
        planner = self._planner
        if hasattr(planner, "with_limit"):
            planner = planner.with_limit(max(SHARE * left_s, 1e-3))
        outcome = self._solve(planner, course)
        self._asked += 1
        self._clock.count(outcome.effort.solves, outcome.effort.solver_s)
        self._clock.compile_s += outcome.effort.compile_s
        return outcome

    def _kept(self, plan: Plan) -> bool:
        """Keep the plan where no step of it is too short."""
        lengths = lengths_of(plan, self._course)[1]
        if not (lengths >= self._course.least_steps - SHORT).all():
            return False
        self._plan = replace(plan, problem=self._course)
        return True

    def _rows(self, sides: Sides) -> Array:
        least = self._course.least_steps
        rows = [
            np.array(OPEN) if side is None else half_space(side, float(least[e]))
            for e, side in enumerate(sides)
        ]
        return np.array(rows)


def _breadth(side: Array | None) -> float:
    return math.inf if side is None else float(np.linalg.norm(side[0] - side[1]))


def _most(course: Problem) -> Array:
    """Greatest length of each least step by its patches, or by the tilt limit, alone, shape (E,)."""
    toes = [
        max(
            float(np.linalg.norm(one[:, None] - other, axis=2).max())
            for one in _places(course, before)
            for other in _places(course, after)
        )
        for before, after in course.moves.tolist()
    ]
    turn = min(2.0 * math.sqrt(3.0) * course.tilt_limit_rad, course.steps.rotation_rad)
    count = len(course.least_steps)
    lengths = toes if course.steps.least_toe_m > 0.0 else []
    return np.array([*lengths, *[turn] * (count - len(lengths))])


def _places(course: Problem, foothold: int) -> list[Array]:
    """Corners of what a toe may stand on, candidate by candidate, shapes (·, 3) [m]."""
    toe = course.footholds[foothold].toe_m
    return [region.vertices_m if toe is None else toe[None] for region in course.regions[foothold]]
