"""The lift once more, for the least gap from the bilinear surface as it is linearised at a point.

The lift's products Σ_u v_u f_uᵀ stand for p fᵀ, from which they differ by a gap that vanishes where
one vertex, or one force direction, has it all. Linearised at a point (p̂, f̂), p fᵀ ≈ p̂ fᵀ + p f̂ᵀ
− p̂ f̂ᵀ, the gap of a contact is

    g = Σ_u (v_u − p̂)(f_u − λ_u f̂)ᵀ,

linear in (λ, f_u). Where the point is that of the lift itself nothing is learned; a policy may
guess a better one.
"""

from __future__ import annotations

from dataclasses import replace

from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, Moments
from ..files.arrays import Array
from .relaxed import Relaxed


class LeastGap:
    """min Σ g² over the lift, moments being zero; one candidate a foothold.

    Its point is one to project from.
    """

    def __init__(self, layout: Layout) -> None:
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=False)
        forces = Forces.of_vertices(rows, layout, toes)
        forces.balance()
        moments = Moments(layout)
        moments.add(forces.stance, forces.columns, Of("scaled.arms"))
        moments.of_weight(body)
        moments.vanish(rows)
        self._forces = (forces.contact, forces.candidate)
        least_gap(rows, layout, toes, forces)
        forces.in_cones()
        forces.in_box(implied=False)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(toes)

    def solve(self, scaled: Scaled, about: Point) -> Point:
        """The point of least gap as linearised about another, rounded onto patches and friction
        cones.

        Returns the rounded point with residual 0.0, which says that there is one: its own moments
        are near zero, not zero. The residual is inf where the lift has no answer.

        Arguments:
            about: [p̂, f̂]; one candidate a foothold.
        """
        solution = self.rows.solve(Given(scaled, about))
        if not solution.solved:
            return replace(about, residual=float("inf"), seconds=solution.seconds)
        return replace(Relaxed.of(scaled, solution, self._forces).rounded()[1], residual=0.0)


def least_gap(rows: Rows[Given], layout: Layout, toes: FreeToes, forces: Forces) -> Index:
    """Add Σ g² to the objective, g a variable of its own, (B, 9), g_jk in the column 3j + k.

    Arguments:
        forces: of vertices.
    """
    contact, vertex = layout.contact_vertices
    gap = rows.variable("gap", len(layout.contacts[0]), 9)
    is_gap = rows.equal("gap", len(gap), 3, 3)
    rows.put(is_gap.reshape(gap.shape), gap, -1.0)

    def arms(given: Given) -> Array:
        """v_u − p̂, shape (F, 3)."""
        return given.scaled.vertices[vertex] - given.held.toes[layout.contacts[2][contact]]

    rows.put(is_gap[contact], forces.columns[:, None, :], lambda d: arms(d)[:, :, None])
    rows.put(
        is_gap[contact],
        toes.weights[vertex][:, None, None],
        lambda d: -arms(d)[:, :, None] * d.held.forces[contact][:, None, :],
    )
    rows.square(gap, None, 1.0)
    return gap
