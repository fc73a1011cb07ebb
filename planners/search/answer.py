"""How a planner's claim becomes an answer: only through the verifier."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contact import planner as postures
from ..equilibrium.layout import Index
from ..equilibrium.scaled import Point, Scaled
from ..keyframes.planner import PlanAcceptance
from ..plan import Plan, PlanOutcome
from ..scene.course import Course
from .clock import Clock


@dataclass(frozen=True, kw_only=True)
class Acceptance(postures.Acceptance):
    """When a claim is accepted, of postures and of plans."""

    def plan_outcome(self, course: Course, *, method: str, clock: Clock, **claimed: Any) -> PlanOutcome:
        """Feasible if the plan is verified, infeasible if the certificate is, else undecided."""
        return PlanAcceptance(tolerance=self.tolerance).outcome(course, method=method, clock=clock, **claimed)


def plan_of(course: Course, scaled: Scaled, choice: Index, point: Point, *, provenance: Mapping[str, Any]) -> Plan:
    """Give a point on one choice of candidates its units back. scaled: as asked for, or chosen; choice: shape (P,)."""
    chosen = scaled.chosen(choice)
    stance, limb, _ = chosen.layout.contacts
    forces = np.zeros((len(chosen.layout.stances), chosen.layout.limbs, 3))
    forces[stance, limb] = chosen.in_world(point.forces) * scaled.force_n
    return Plan(
        course=course,
        com_m=point.com * scaled.length_m,
        rotation_rad=point.rotation,
        toes_m=point.toes * scaled.length_m,
        choice=choice,
        forces_n=forces,
        provenance=provenance,
    )
