"""P exact for batches of posture problems: ``ExactPlanner``'s answers, what they have in common done at once.

Solvers run problem by problem, so an answer depends on its own problem alone; scaling, data, certificates and witnesses
are handled for the whole batch. Most problems are decided at the root, by the lift's certificate or at the lift's toes;
the others go through the branch and bound one by one.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.outcome import Certificate, Outcome, Posture, Status
from ..equilibrium.batch import ScaledBatch
from ..problem import PostureBatch
from ..projection.project import SURFACE, project
from ..relaxation.lift import solve_lift
from ..verify import check_certificates, check_postures
from .exact import ExactPlanner
from .witness import witnesses

Index = NDArray[np.intp]


def solve_all(planner: ExactPlanner, batch: PostureBatch) -> list[Outcome]:
    """What ``planner.solve`` answers to every problem, but for ``residual_nm`` (NaN) of those decided at the root.

    ``seconds`` are a share of what each stage took.
    """
    root = _Root(planner, batch)
    answers = root.refuted() | root.projected()
    for k in range(len(batch)):
        if k not in answers:
            answer = planner.solve(batch.problems[k], root=root.lifts[k])
            answers[k] = replace(answer, seconds=answer.seconds + root.seconds[k])
    return [answers[k] for k in range(len(batch))]


def easily_feasible(batch: PostureBatch, tolerance: float) -> dict[int, tuple[Posture, float]]:
    """Problems of a batch that Douglas–Rachford has a posture for, by index: the posture and its largest violation.

    tolerance: as in ``Acceptance``. Problems that are not in it may be feasible all the same.
    """
    claims = witnesses(ScaledBatch.of(batch))
    worst = check_postures([batch.problem(k) for k in claims], list(claims.values()))
    return {k: (claims[k], float(off)) for k, off in zip(claims, worst, strict=True) if off <= tolerance}


class _Root:
    """The roots of the trees of a batch. lifts: of every problem; seconds: spent on every problem, shape (B,)."""

    def __init__(self, planner: ExactPlanner, batch: PostureBatch) -> None:
        begin = time.perf_counter()
        self._planner, self._accept = planner, planner.acceptance
        self._scaled = ScaledBatch.of(batch).problems
        self._problems = batch.problems
        self.lifts = [solve_lift(planner.programs, scaled, least_moment=True) for scaled in self._scaled]
        self.seconds = np.zeros(len(batch))
        self._took(begin, np.arange(len(batch)))

    def refuted(self) -> dict[int, Outcome]:
        """Answers to the problems that the lift refutes, by their index."""
        begin, chosen = time.perf_counter(), _where(lift.bound > self._accept.gap for lift in self.lifts)
        leaf = np.zeros((1, 5))
        certificates = [Certificate(tree=leaf, multipliers=self.lifts[k].multipliers[None]) for k in chosen]
        bounds = check_certificates([self._problems[k] for k in chosen], certificates)
        self._took(begin, chosen)
        return {
            k: Outcome(status=Status.INFEASIBLE, certificate=certificate, lower_bound=bound, **self._told(k, solves=1))
            for k, certificate, bound in zip(chosen.tolist(), certificates, bounds.tolist(), strict=True)
            if bound > self._accept.gap
        }

    def projected(self) -> dict[int, Outcome]:
        """Answers to the problems that have a posture at the lift's toes, by their index."""
        begin = time.perf_counter()
        chosen = _where(lift.solved and lift.bound <= self._accept.gap for lift in self.lifts)
        points = {
            k: project(self._planner.programs, "fix-toes", self._scaled[k], self.lifts[k].rounded()[1])
            for k in chosen.tolist()
        }
        postures = {
            k: self._scaled[k].posture(point)
            for k, point in points.items()
            if point.residual <= max(SURFACE, 0.5 * self._accept.tolerance)
        }
        worst = check_postures([self._problems[k] for k in postures], list(postures.values()))
        self._took(begin, chosen)
        return {
            k: Outcome(status=Status.FEASIBLE, posture=posture, residual=off, **self._told(k, solves=2))
            for (k, posture), off in zip(postures.items(), worst.tolist(), strict=True)
            if off <= self._accept.tolerance
        }

    def _told(self, k: int, *, solves: int) -> dict[str, Any]:
        """What is said of every answer from a root."""
        details = {"nodes": 1.0, "trivial": float(np.isinf(self.lifts[k].bound))}
        seconds = float(self.seconds[k])
        return {"method": self._planner.name, "solves": solves, "seconds": seconds, "details": details}

    def _took(self, begin: float, chosen: Index) -> None:
        """Share out the time since ``begin`` among those that it was spent on."""
        self.seconds[chosen] += (time.perf_counter() - begin) / max(len(chosen), 1)


def _where(chosen: Iterable[bool]) -> Index:
    return np.flatnonzero(np.fromiter(chosen, dtype=bool))
