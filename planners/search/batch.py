"""P exact for batches of posture problems: what they have in common is done at once, and witnesses
are canonical.

A feasible problem is answered with one posture that follows from the problem alone (``canonical``),
whoever else is in the batch and whatever found the problem feasible. The cheapest goes first: a
short iteration, the lift's certificate, a long iteration, branch and bound.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.batch import ScaledBatch
from ..problem import PostureBatch
from ..relaxation.lift import LiftAnswer, solve_lift
from ..verify import check_certificates
from .canonical import LONG, SHORT, Index, gone_on, relaxed, with_toes
from .cuts import LEAF
from .exact import ExactPlanner
from .witness import Iteration


@dataclass(frozen=True, kw_only=True)
class Decided:
    """Every problem's outcome.

    Arguments:
        relaxed: canonical points of P̄ that were found on the way, by the problem's index.
    """

    outcomes: list[Answer[Plan]]
    relaxed: dict[int, Plan]


def solve_all(planner: ExactPlanner, batch: PostureBatch) -> list[Answer[Plan]]:
    """``decide_all`` without what was found on the way."""
    return decide_all(planner, batch).outcomes


def decide_all(planner: ExactPlanner, batch: PostureBatch, *, points: bool = False) -> Decided:
    """Decide every problem as ``planner.solve`` does, with the same verdicts and certificates, and
    with canonical witnesses.

    ``residual_nm`` is NaN but where the search decided; ``seconds`` are a share of what each stage
    took.

    Arguments:
        points: whether the canonical points of P̄ of all that is infeasible, but not trivially, are
            looked for.
    """
    work = _Batch(planner, batch)
    work.find(SHORT)
    work.refute()
    work.find(LONG)
    work.search()
    if points:
        work.relax()
    return Decided(outcomes=[work.answers[k] for k in range(len(batch))], relaxed=work.relaxed)


class _Batch:
    """Problems that are decided together. answers: so far, by index; relaxed: points of P̄."""

    def __init__(self, planner: ExactPlanner, batch: PostureBatch) -> None:
        self._planner, self._accept, self._batch = planner, planner.acceptance, batch
        self._problems = batch.problems  # made once, and shared by what is selected
        self._scaled = ScaledBatch.of(batch)
        self._iteration = Iteration(self._scaled)
        self._lifts: dict[int, LiftAnswer] = {}
        self._seconds = np.zeros(len(batch))
        self.answers: dict[int, Answer[Plan]] = {}
        self.relaxed: dict[int, Plan] = {}

    def find(self, steps: int) -> None:
        """Answer what the iteration finds until it has taken so many steps."""
        begin, left = time.perf_counter(), self._left()
        self._iteration.keep(left)
        points = gone_on(self._iteration, self._batch, steps, tolerance=self._accept.tolerance)
        self._took(begin, left)
        for k, (posture, off) in points.items():
            self._feasible(k, posture, off)

    def refute(self) -> None:
        """Answer what the lift refutes."""
        begin, left, gap = time.perf_counter(), self._left(), self._accept.gap
        for k in left.tolist():
            self._lifts[k] = solve_lift(
                self._planner.programs, self._scaled.problem(k), least_moment=True
            )
        chosen = [k for k in left.tolist() if self._lifts[k].bound > gap]
        certificates = [
            Certificate(
                tree=np.array([LEAF]),
                multipliers=self._lifts[k].multipliers[None],
                problem=self._problems[k],
            )
            for k in chosen
        ]
        bounds = check_certificates(certificates).tolist()
        self._took(begin, left)
        for k, certificate, bound in zip(chosen, certificates, bounds, strict=True):
            if bound > gap:
                self._refuted(k, certificate, bound, trivial=bool(np.isinf(self._lifts[k].bound)))

    def search(self) -> None:
        """Answer what is left by branch and bound, with the middle of what its toes leave."""
        postures = dict[int, Plan]()
        for k in self._left().tolist():
            answer = self._planner.solve(self._problems[k], root=self._lifts[k])
            effort = answer.effort
            self.answers[k] = replace(
                answer, effort=replace(effort, seconds=effort.seconds + float(self._seconds[k]))
            )
            if answer.solution is not None:
                postures[k] = answer.solution
        for k, (posture, off) in with_toes(
            self._batch, postures, tolerance=self._accept.tolerance
        ).items():
            self.answers[k] = replace(self.answers[k], solution=posture, report=None, residual=off)

    def relax(self) -> None:
        """Find points of P̄ for what is infeasible, but not trivially."""
        index = np.array(
            [
                k
                for k, one in self.answers.items()
                if one.certificate is not None and not one.details["trivial"]
            ],
            dtype=np.intp,
        )
        postures = relaxed(self._batch.select(index), tolerance=self._accept.tolerance)
        self.relaxed = {int(index[k]): posture for k, posture in postures.items()}

    def _feasible(self, k: int, posture: Plan, off: float) -> None:
        self.answers[k] = Answer(
            status=Status.FEASIBLE,
            solution=posture,
            bound=0.0,
            residual=off,
            **self._told(k, nodes=0.0),
        )

    def _refuted(self, k: int, certificate: Certificate, bound: float, *, trivial: bool) -> None:
        message = self._told(k, nodes=1.0, trivial=trivial)
        self.answers[k] = Answer(
            status=Status.INFEASIBLE, certificate=certificate, bound=bound, **message
        )

    def _left(self) -> Index:
        left = [k for k in range(len(self._batch)) if k not in self.answers]
        return np.array(left, dtype=np.intp)

    def _told(self, k: int, *, nodes: float, trivial: bool = False) -> dict[str, Any]:
        """Fields of every answer before the search."""
        details = {"nodes": nodes, "trivial": float(trivial)}
        effort = Effort(solves=int(k in self._lifts), seconds=float(self._seconds[k]))
        return {"method": self._planner.name, "effort": effort, "details": details}

    def _took(self, begin: float, chosen: Index) -> None:
        """Share out the time since ``begin`` among those that it was spent on."""
        self._seconds[chosen] += (time.perf_counter() - begin) / max(len(chosen), 1)
