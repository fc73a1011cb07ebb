"""The convex programs of a leap: one step of SCP for given contacts, and the relaxation over open
candidates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equilibrium.layout import Layout
from ..equilibrium.programs import ConicSolution
from ..equilibrium.rows import Rows
from ..equilibrium.terms import BodyVariables, Forces, FreeToes
from .numbers import LeapGiven, LeapPoint
from .terms import SLACKS, Dynamics, Legs, Turning, still_moments, trust

LITTLE = 1e-5
"""Price of Σ f², which picks one of many equal answers."""
EVEN = 1e-3
"""That price for robots whose legs are known, which then push alike on both sides."""


@dataclass(frozen=True, eq=False)
class Step:
    """An answer of ``LeapProgram``: the conic solution, its point, and what its slack costs (NaN
    without a point).
    """

    solution: ConicSolution
    point: LeapPoint | None
    cost: float


UPRIGHT, QUIET = 2e-2, 10.0
"""Price of squares of Θ [1/rad²] and of L [s²/m⁴] at every frame, for robots whose legs are known:
with nothing to hold them a body rolls as far as it may, and legs that swing make more of it."""


class LeapProgram:
    """A leap with given contacts, bilinear rows linearised about a point with slack; one candidate
    per foothold.

    Arguments:
        still: whether the first and the last interval are in equilibrium.
        joints: how many per leg have rows; 0 where legs were not judged.
        quiet: share of the prices of turning and of pushing unevenly; 0 for none.
    """

    def __init__(
        self, layout: Layout, still: tuple[bool, bool], joints: int = 0, quiet: float = 0.0
    ) -> None:
        self.layout, self.rows = layout, Rows[LeapGiven](keep=False)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=True)
        forces = Forces.of_contacts(rows, layout)
        dynamics = Dynamics(rows, layout, body, still)
        dynamics.linear(forces)
        turning = Turning(rows, layout, body, dynamics)
        turning.ends()
        turning.limits()
        turning.go_on(forces, toes)
        legs = Legs(rows, layout, body, dynamics, toes)
        legs.height()
        legs.fold()
        legs.speed(turning.momentum)
        legs.power(forces, turning.momentum)
        if joints:
            legs.joints(forces, turning.momentum, joints)
        if quiet:
            rows.square(body.rotation, None, quiet * UPRIGHT)
            rows.square(turning.momentum, None, quiet * QUIET)
        if layout.reach_rows:
            legs.inside()
        forces.in_cones()
        forces.in_box(implied=True)
        body.reach(toes)
        body.limits()
        trust(rows, layout, toes)
        rows.square(forces.columns, None, max(quiet * EVEN, LITTLE))

    def solve(self, given: LeapGiven) -> Step:
        """One step from the point of ``given``."""
        solution = self.rows.solve(given)
        if not solution.solved:
            return Step(solution, None, float("nan"))
        names = ("com", "rotation", "velocity", "momentum", "toes")
        point = LeapPoint(
            **{name: solution.value(name) for name in names},
            forces=given.scaled.in_world(solution.value("forces")),
        )
        return Step(solution, point, _slack_cost(solution))


class LeapLift:
    """The relaxation over every open candidate: linear dynamics, forces per vertex, and moments
    where the body rests.

    What it says is true of every leap: c × F is left out, and with it L, Θ′ and what limits legs
    beside their reach.
    """

    def __init__(self, layout: Layout, still: tuple[bool, bool]) -> None:
        self.layout, self.rows = layout, Rows[LeapGiven](keep=False)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=True)
        forces = Forces.of_vertices(rows, layout, toes)
        dynamics = Dynamics(rows, layout, body, still)
        dynamics.linear(forces)
        still_moments(rows, layout, body, forces, dynamics)
        Legs(rows, layout, body, dynamics, toes).height()
        forces.in_cones()
        forces.in_box(implied=True)
        body.reach(toes)
        body.limits()

    def solve(self, given: LeapGiven) -> ConicSolution:
        """Look for a point of the relaxation.

        Where there is none, ``dual`` of the answer is a ray that proves it.
        """
        return self.rows.solve(given)


def _slack_cost(solution: ConicSolution) -> float:
    """Cost of an answer's slack."""
    from .terms import PRICES

    total = 0.0
    for name in SLACKS:
        for end in ("over", "under"):
            if f"{name}_{end}" in solution.columns:
                total += PRICES[name] * float(
                    np.maximum(solution.value(f"{name}_{end}"), 0.0).sum()
                )
    return total
