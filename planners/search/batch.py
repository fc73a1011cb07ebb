"""P exact for batches of posture problems: what they have in common is done at once, and witnesses are canonical.

A feasible problem is answered with one posture that follows from the problem alone: the toes that a fixed iteration
comes to (``witness``), and with them held the middle of what is left (``centre``), whoever else is in the batch and
whatever found the problem feasible. Only where the iteration comes to no end the toes are those that the search has
found. The cheapest goes first: a short iteration, the lift's certificate, a long iteration, branch and bound.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.outcome import Certificate, Outcome, Posture, Status
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.programs import Programs
from ..problem import PostureBatch
from ..projection.centre import centred
from ..relaxation.lift import LiftAnswer, solve_lift
from ..relaxation.mccormick import WithoutMoment
from ..verify import check_certificates, check_postures
from .exact import ExactPlanner
from .witness import witnesses

Index = NDArray[np.intp]
SHORT, LONG = 96, 320
"""Steps of the iteration before the lift is asked, and after: most feasible problems need fewer than the first."""


def solve_all(planner: ExactPlanner, batch: PostureBatch) -> list[Outcome]:
    """Decide every problem as ``planner.solve`` does, with the same certificates and with canonical witnesses.

    ``residual_nm`` is NaN but where the search decided; ``seconds`` are a share of what each stage took.
    """
    work = _Batch(planner, batch)
    work.find(SHORT)
    work.refute()
    work.find(LONG)
    work.search()
    return [work.answers[k] for k in range(len(batch))]


def canonical(batch: PostureBatch, steps: int = LONG, *, tolerance: float = 1e-6) -> dict[int, tuple[Posture, float]]:
    """Canonical postures of the problems that the iteration finds one for, by index, each with its largest violation.

    tolerance: as in ``Acceptance``. Problems that are not in it may be feasible all the same.
    """
    scaled = ScaledBatch.of(batch)
    return _accepted(batch, *_centres(scaled, witnesses(scaled, steps)), tolerance)


def without_moments(programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Posture]:
    """Canonical points of P̄, which violate nothing but the balance of moments, by index; none where P̄ has none.

    Where the iteration comes to no end, it is the point that the solver ends at.
    """
    scaled = ScaledBatch.of(batch)
    found = _accepted(batch, *_centres(scaled, witnesses(scaled, LONG, moments=False), moments=False), tolerance, False)
    layout = scaled.like.layout
    postures = {k: posture for k, (posture, _) in found.items()}
    for k in set(range(len(batch))) - set(postures):
        point = programs.get(WithoutMoment, layout, bool(layout.reach_rows)).solve(scaled.problem(k))
        if point is not None:
            posture = scaled.problem(k).posture(point)
            worst = check_postures([batch.problems[k]], [posture], without=("moment_balance",))
            postures |= {k: posture} if worst[0] <= tolerance else {}
    return postures


def _centres(
    scaled: ScaledBatch, claims: tuple[Index, PointBatch], *, moments: bool = True
) -> tuple[Index, list[Posture]]:
    index, points = claims
    some = scaled.select(index)
    return index, some.postures(centred(some, points, moments=moments))


def _accepted(
    batch: PostureBatch, index: Index, postures: list[Posture], tolerance: float, moments: bool = True
) -> dict[int, tuple[Posture, float]]:
    """Those that the verifier accepts."""
    without = () if moments else ("moment_balance",)
    worst = check_postures([batch.problems[k] for k in index.tolist()], postures, without=without).tolist()
    return {
        k: (posture, off) for k, posture, off in zip(index.tolist(), postures, worst, strict=True) if off <= tolerance
    }


class _Batch:
    """Problems that are decided together. answers: so far, by index."""

    def __init__(self, planner: ExactPlanner, batch: PostureBatch) -> None:
        self._planner, self._accept, self._batch = planner, planner.acceptance, batch
        self._scaled = ScaledBatch.of(batch)
        self._lifts: dict[int, LiftAnswer] = {}
        self._seconds = np.zeros(len(batch))
        self.answers: dict[int, Outcome] = {}

    def find(self, steps: int) -> None:
        """Answer what so many steps of the iteration find."""
        begin, left = time.perf_counter(), self._left()
        found = canonical(self._batch.select(left), steps, tolerance=self._accept.tolerance)
        self._took(begin, left)
        for k, (posture, off) in found.items():
            message = self._told(int(left[k]), nodes=0.0)
            self.answers[int(left[k])] = Outcome(status=Status.FEASIBLE, posture=posture, residual=off, **message)

    def refute(self) -> None:
        """Answer what the lift refutes."""
        begin, left, gap = time.perf_counter(), self._left(), self._accept.gap
        for k in left.tolist():
            self._lifts[k] = solve_lift(self._planner.programs, self._scaled.problem(k), least_moment=True)
        chosen, leaf = [k for k in left.tolist() if self._lifts[k].bound > gap], np.zeros((1, 5))
        certificates = [Certificate(tree=leaf, multipliers=self._lifts[k].multipliers[None]) for k in chosen]
        bounds = check_certificates([self._batch.problems[k] for k in chosen], certificates).tolist()
        self._took(begin, left)
        for k, certificate, bound in zip(chosen, certificates, bounds, strict=True):
            if bound > gap:
                message = self._told(k, nodes=1.0)
                self.answers[k] = Outcome(
                    status=Status.INFEASIBLE, certificate=certificate, lower_bound=bound, **message
                )  # fmt: skip

    def search(self) -> None:
        """Answer what is left by branch and bound, with the middle of what its toes leave."""
        found = dict[int, Posture]()
        for k in self._left().tolist():
            answer = self._planner.solve(self._batch.problems[k], root=self._lifts[k])
            self.answers[k] = replace(answer, seconds=answer.seconds + float(self._seconds[k]))
            if answer.posture is not None:
                found[k] = answer.posture
        index = np.array(list(found), dtype=np.intp)
        toes = np.array([posture.toes_m for posture in found.values()]).reshape(-1, *self._scaled.friction.shape[1:], 3)
        held = self._scaled.select(index).held(toes / self._scaled.like.length_m)
        claims = _centres(held, witnesses(held, LONG))
        for k, (posture, off) in _accepted(self._batch.select(index), *claims, self._accept.tolerance).items():
            self.answers[int(index[k])] = replace(self.answers[int(index[k])], posture=posture, residual=off)

    def _left(self) -> Index:
        return np.array([k for k in range(len(self._batch)) if k not in self.answers], dtype=np.intp)

    def _told(self, k: int, *, nodes: float) -> dict[str, Any]:
        """What is said of every answer before the search."""
        lift = self._lifts.get(k)
        details = {"nodes": nodes, "trivial": float(lift is not None and np.isinf(lift.bound))}
        solves, seconds = int(lift is not None), float(self._seconds[k])
        return {"method": self._planner.name, "solves": solves, "seconds": seconds, "details": details}

    def _took(self, begin: float, chosen: Index) -> None:
        """Share out the time since ``begin`` among those that it was spent on."""
        self._seconds[chosen] += (time.perf_counter() - begin) / max(len(chosen), 1)
