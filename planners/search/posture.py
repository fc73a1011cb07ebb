"""The two-stage planner P1 → P2 of postures (Lin et al. §II): a relaxation, and its answer put on
the bilinear surface.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Scaled
from ..problem import Problem
from ..projection.project import PROJECTIONS, Projection, project
from ..relaxation.envelope import EnvelopeSet
from ..relaxation.lift import LiftAnswer, as_relaxation, solve_lift
from ..relaxation.relaxed import RelaxationAnswer
from ..relaxation.table import RELAXATIONS
from .answer import Acceptance, Claim, plan_of
from .clock import Clock
from .cuts import LEAF
from .either import Kind


class TwoStagePlanner:
    """P1 over learned envelopes, or the lift where ``envelopes`` is None; then P2, unless
    ``projection`` is None.

    A relaxation that is infeasible proves something only where it relaxes the whole problem: the
    lift's answer comes with a certificate, an envelope's is reported as its margin and the problem
    stays undecided. Without a projection the relaxation's own point is put to the verifier.

    Arguments:
        relaxation: which P1 over envelopes, a name of ``RELAXATIONS``.
    """

    answers: ClassVar[Kind] = "postures"

    def __init__(
        self,
        *,
        envelopes: EnvelopeSet | None = None,
        relaxation: str = "p1",
        projection: Projection | None = "scp",
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        if projection is not None:
            PROJECTIONS.get(projection)
        self._relaxation = RELAXATIONS.get(relaxation)
        self.envelopes = envelopes
        self.projection = projection
        self.acceptance = acceptance
        self.name = (
            ("two-stage" if projection else "p1")
            if envelopes
            else ("lift+" + projection if projection else "lift")
        )
        self._programs = programs or Programs()

    def solve(self, problem: Problem) -> Answer[Plan]:
        """Relax, project, verify.

        Raises InvalidInput where the envelopes were learned for another class.
        """
        clock = Clock.start()
        if self.envelopes is not None:
            self.envelopes.check_fits(problem)
        scaled = Scaled.of(problem)
        lift = (
            solve_lift(self._programs, scaled, least_moment=True)
            if self.envelopes is None
            else None
        )
        answer = self._relax(scaled) if lift is None else as_relaxation(lift)
        clock.count(answer.solves, 0.0)
        if not answer.known:
            claim = Claim(message="the relaxation was not solved")
            return self.acceptance.answer(problem, claim, method=self.name, clock=clock)
        details = {"margin": answer.margin, "gap": answer.gap, "chosen": float(answer.chosen)}
        if (
            not (answer.feasible if lift is None else answer.margin <= self.acceptance.gap)
            or answer.point is None
        ):
            return self._refuse(problem, scaled, clock, lift, details)
        point = answer.point
        if self.projection:
            point = project(self._programs, self.projection, scaled, answer.point)
            clock.count(point.solves, 0.0)
        plan: Plan | None = None
        if not (self.projection and np.isinf(point.residual)) and np.all(np.isfinite(point.forces)):
            plan = plan_of(problem, scaled, scaled.numbers, point)
        message = "" if plan is not None else f"{self.projection} found no answer from P1's point"
        claim = Claim(found=plan, word="feasible", message=message, details=details)
        return self.acceptance.answer(problem, claim, method=self.name, clock=clock)

    def _relax(self, scaled: Scaled) -> RelaxationAnswer:
        assert self.envelopes is not None
        return self._relaxation.answers(self._programs, [scaled], [self.envelopes.envelopes], [])[0]

    def _refuse(
        self,
        problem: Problem,
        scaled: Scaled,
        clock: Clock,
        lift: LiftAnswer | None,
        details: dict[str, float],
    ) -> Answer[Plan]:
        """The relaxation is infeasible.

        Where that holds whatever the box, the lift's certificate says so.
        """
        if lift is None and np.isinf(details["margin"]):
            lift = solve_lift(self._programs, scaled, least_moment=True)
            clock.count(1, 0.0)
        proof = lift is not None and lift.solved and lift.bound > self.acceptance.gap
        certificate = (
            Certificate(tree=np.array([LEAF]), multipliers=lift.multipliers[None])
            if lift and proof
            else None
        )
        message = (
            ""
            if certificate
            else "the relaxation is infeasible; over a learned box that is no proof"
        )
        claim = Claim(certificate=certificate, word="infeasible", message=message, details=details)
        return self.acceptance.answer(problem, claim, method=self.name, clock=clock)
