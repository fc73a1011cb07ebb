"""P1 lift: the relaxation that needs no learned box.

With p_w = Σ λ_u v_u (E1) and f_u := λ_u f the moment Σ p_w × f is Σ_u v_u × f_u, linear; Σ_u f_u = f holds by
definition, and each f_u lies in the friction cone and in λ_u times the force box. Only toe-in-patch times force is
relaxed; the centre of mass is not, since Σ f is fixed (``terms.Moments``). Over several candidate patches r of a toe,
λ_{r,u} with z_r = Σ_u λ_{r,u}, and f_{r,u} in the cone of μ_r: the convex hull of "one of the patches" comes with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..equilibrium.layout import Index, Layout
from ..equilibrium.multipliers import multipliers
from ..equilibrium.programs import Programs
from ..equilibrium.rows import ConicSolution, ConicStatus, Reference, Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import Body, Forces, FreeToes, Given, Moments, objective


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftAnswer:
    """One solve of the lift.

    status: INFEASIBLE with multipliers that refute the relaxation, and so the problem. bound: on the least moment
    residual, or on the objective of a course: inf where infeasible, and 0 or −inf, which prove nothing, where the
    solver gave up. multipliers: a certificate's row for it. Where there is a point: weights: λ, shape (V,);
    by_vertex: f_u in contact frames, (F, 3); shares: z of every candidate, (K,); toes: by candidate, where its share
    of the toe stands, (K, 3).
    """

    scaled: Scaled
    status: ConicStatus
    bound: float
    multipliers: Array
    com: Array
    rotation: Array
    weights: Array
    by_vertex: Array
    seconds: float = 0.0

    @property
    def solved(self) -> bool:
        """Whether the solver came to an end, one way or the other."""
        return self.status is not ConicStatus.FAILED

    @property
    def shares(self) -> Array:
        """z of every candidate, shape (K,)."""
        layout = self.scaled.layout
        shares = np.bincount(layout.vertex_candidates, self.weights, minlength=len(layout.candidate_footholds))
        return np.asarray(shares, dtype=np.float64)

    @property
    def toes(self) -> Array:
        """By candidate, shape (K, 3)."""
        layout = self.scaled.layout
        sums = np.zeros((len(layout.candidate_footholds), 3))
        np.add.at(sums, layout.vertex_candidates, self.weights[:, None] * self.scaled.vertices)
        return sums / np.maximum(self.shares, 1e-12)[:, None]

    def rounded(self) -> tuple[Index, Point]:
        """The candidate of the largest share of every foothold, by number, (P,), and a point whose toes are on them."""
        scaled, layout = self.scaled, self.scaled.layout
        ends = np.cumsum([len(counts) for counts in layout.corners])
        parts = np.split(self.shares, ends[:-1])
        chosen = np.array([end - len(part) + int(part.argmax()) for end, part in zip(ends, parts, strict=True)])
        contact, vertex = layout.contact_vertices
        world = np.matmul(scaled.frames[layout.vertex_candidates[vertex]], self.by_vertex[..., None])[..., 0]
        total = np.zeros((len(layout.contacts[0]), 3))
        np.add.at(total, contact, world)
        frames = scaled.frames[chosen][layout.contacts[2]]
        forces = np.matmul(frames.transpose(0, 2, 1), total[..., None])[..., 0]
        point = Point(
            com=self.com, rotation=self.rotation, toes=self.toes[chosen], forces=forces, residual=float("inf"),
            seconds=self.seconds,
        )  # fmt: skip
        return np.concatenate(scaled.which)[chosen], point


class LiftProgram:
    """The lift of one layout.

    implied: leave out the rows of the force box that the cones imply (``Scaled.box_implied``). least_moment: minimise
    the moment residual, for which there is an answer nearly always; else the course's objective, moments being zero.
    """

    def __init__(self, layout: Layout, implied: bool, least_moment: bool) -> None:
        self.layout, self.rows, self._least = layout, Rows[Given](keep=layout.frames == 1), least_moment
        rows = self.rows
        body = Body(rows, layout)
        toes = FreeToes(rows, layout, explicit=not least_moment, implied=implied)
        forces = Forces.of_vertices(rows, layout, toes)
        forces.balance()
        moments = Moments(layout)
        moments.add(forces.stance, forces.columns, lambda d: d.scaled.arms)
        moments.of_weight(body)
        if least_moment:
            rows.linear(moments.within(rows), 1.0)
        else:
            moments.vanish(rows)
            objective(rows, layout, body, toes)
        forces.in_cones()
        forces.in_box(implied=implied)
        body.reach(toes)
        body.limits()
        body.steps(toes)

    def solve(self, scaled: Scaled) -> LiftAnswer:
        """Solve for a problem of this layout."""
        solution = self.rows.solve(Given(scaled))
        return self._answer(scaled, solution)

    def reference(self, given: Given) -> Reference:
        """The same in cvxpy."""
        from ..equilibrium.reference import lift  # cvxpy takes a second to import

        return lift(given.scaled, least_moment=self._least)

    def _answer(self, scaled: Scaled, solution: ConicSolution) -> LiftAnswer:
        least = "residual" in solution.columns
        bound = {
            ConicStatus.SOLVED: max(0.0, solution.objective) if least else solution.bound,
            ConicStatus.INFEASIBLE: float("inf"),
            ConicStatus.FAILED: 0.0 if least else float("-inf"),
        }[solution.status]
        weights = np.maximum(solution.value("weights"), 0.0)
        totals = np.bincount(self.layout.vertex_footholds, weights, minlength=self.layout.footholds)
        return LiftAnswer(
            scaled=scaled,
            status=solution.status,
            bound=bound,
            multipliers=multipliers(self.layout, solution),
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            weights=weights / np.maximum(totals, 1e-300)[self.layout.vertex_footholds],
            by_vertex=solution.value("forces"),
            seconds=solution.seconds,
        )


def solve_lift(programs: Programs, scaled: Scaled, *, least_moment: bool) -> LiftAnswer:
    """Solve the lift, in its small form where that says the same."""
    return programs.get(LiftProgram, scaled.layout, scaled.box_implied, least_moment).solve(scaled)
