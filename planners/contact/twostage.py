"""The two-stage planner P1 → P2 (paper E §II): a relaxation, and its answer projected onto the bilinear surface."""

from __future__ import annotations

import time

import numpy as np

from ..outcome import Certificate, InvalidInput, Outcome, Posture
from ..scene import PostureProblem
from .envelope import EnvelopeSet
from .lift import LiftAnswer
from .planner import Acceptance
from .project import Point
from .relax import RelaxationAnswer
from .scaled import ScaledProblem
from .stages import PROJECTIONS, Projection, Stages

LEAF = (0.0, 0.0, 0.0, 0.0, 0.0)


class TwoStagePlanner:
    """P1 over learned envelopes, or over the lift where ``envelopes`` is None; then P2, unless ``projection`` is None.

    A relaxation that is infeasible proves something only where it relaxes the whole problem: the lift's answer comes
    with a certificate, an envelope's is reported as its margin and the problem stays undecided. Without a projection
    the relaxation's own point is put to the verifier.
    """

    def __init__(
        self,
        *,
        envelopes: EnvelopeSet | None = None,
        projection: Projection | None = "scp",
        acceptance: Acceptance = Acceptance(),
        stages: Stages | None = None,
    ) -> None:
        if projection is not None and projection not in PROJECTIONS:
            raise InvalidInput(f"projection: expected one of {', '.join(PROJECTIONS)}, got {projection!r}")
        self.envelopes = envelopes
        self.projection = projection
        self.acceptance = acceptance
        self.name = (
            ("two-stage" if projection else "p1") if envelopes else ("lift+" + projection if projection else "lift")
        )
        self._stages = stages or Stages()

    def solve(self, problem: PostureProblem) -> Outcome:
        """Relax, project, verify. Raises InvalidInput where the envelopes were learned for another class."""
        begin = time.perf_counter()
        if self.envelopes is not None:
            self.envelopes.check_fits(problem)
        scaled = ScaledProblem.of(problem)
        lift = self._stages.lift(scaled) if self.envelopes is None else None
        answer = self._relax(scaled) if lift is None else _as_relaxation(lift)
        if not answer.known:
            return self.acceptance.outcome(
                problem, method=self.name, begin=begin, solves=answer.solves, message="the relaxation was not solved"
            )
        details = {"margin": answer.margin, "gap": answer.gap, "chosen": float(answer.chosen)}
        if not (answer.feasible if lift is None else answer.margin <= self.acceptance.gap) or answer.point is None:
            return self._refuse(problem, scaled, begin, lift, answer.solves, details)
        point = self._stages.project(self.projection, scaled, answer.point) if self.projection else answer.point
        posture = _posture(scaled, point)
        return self.acceptance.outcome(
            problem,
            method=self.name,
            begin=begin,
            posture=posture,
            solves=answer.solves + (point.solves if self.projection else 0),
            claim="feasible",
            message="" if posture is not None else f"{self.projection} found no answer from P1's point",
            details=details,
        )

    def _relax(self, scaled: ScaledProblem) -> RelaxationAnswer:
        assert self.envelopes is not None
        return self._stages.box(scaled).solve_any(scaled, self.envelopes.envelopes)

    def _refuse(
        self,
        problem: PostureProblem,
        scaled: ScaledProblem,
        begin: float,
        lift: LiftAnswer | None,
        solves: int,
        details: dict[str, float],
    ) -> Outcome:
        """The relaxation is infeasible. Where that holds whatever the box, the lift's certificate says so."""
        if lift is None and np.isinf(details["margin"]):
            lift, solves = self._stages.lift(scaled), solves + 1
        proof = lift is not None and lift.solved and lift.bound > self.acceptance.gap
        certificate = Certificate(tree=np.array([LEAF]), multipliers=lift.multipliers[None]) if lift and proof else None
        return self.acceptance.outcome(
            problem,
            method=self.name,
            begin=begin,
            certificate=certificate,
            solves=solves,
            claim="infeasible",
            message="" if certificate else "the relaxation is infeasible; over a learned box that is no proof",
            details=details,
        )


def _as_relaxation(lift: LiftAnswer) -> RelaxationAnswer:
    """The lift in P1's words: its margin is the moment residual."""
    if not lift.solved:
        return RelaxationAnswer(margin=float("nan"))
    if np.isinf(lift.bound):
        return RelaxationAnswer(margin=lift.bound)
    return RelaxationAnswer(margin=lift.bound, point=lift.point)


def _posture(scaled: ScaledProblem, point: Point) -> Posture | None:
    if not np.all(np.isfinite(point.forces)) or np.isinf(point.residual):
        return None
    return scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
