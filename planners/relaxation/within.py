"""Programs over a box that the theorem of Lin et al. (§III) is asked with: P̄ within the box, and P1,
each towards a corner of its own.

A slope over [p, f] is minimised, so that one program gives many points of its set. Postures only,
one candidate per toe, boxes in contact axes.
"""

from __future__ import annotations

import numpy as np

from ..equilibrium.gather import Of
from ..equilibrium.layout import Index, Layout
from ..equilibrium.rows import Reference, Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes
from ..files.arrays import Array
from .boxed import Boxed
from .envelope import Envelope
from .envelope_rows import envelope_rows
from .relaxed import Relaxed


class WithinBox:
    """Points of a posture problem with [p, f] in a box.

    Arguments:
        products: with McCormick's envelope in the place of m = p f, which is P1; without it m is
            free and E9 constrains nothing, which is P̄ within the box.
    """

    def __init__(self, layout: Layout, products: bool) -> None:
        layout.check_point_feet("envelopes")
        self._products = products
        self.rows = rows = Rows[Boxed](keep=True)
        body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=False)
        forces = Forces.of_contacts(rows, layout)
        forces.balance()
        forces.in_cones()
        forces.in_box(implied=False)
        body.reach(toes)
        body.limits()
        stance, _, foothold = layout.contacts
        position = rows.variable("position", len(stance), 3)
        legs = rows.equal("legs", len(stance), 3)  # p of E2
        rows.put(legs, position, 1.0)
        rows.put(legs, body.com[layout.stance_frames[stance]], 1.0)
        toes.put(legs, foothold, -1.0)
        whole = np.concatenate([position, forces.columns], axis=1)
        if products:
            moments = rows.variable("moments", len(stance), 9)
            self._balance(layout, moments.reshape(-1, 3, 3))
            envelope_rows(rows, whole, moments)
        else:
            sides = rows.at_most("sides", 2, len(stance), 6)
            rows.put(sides[0], whole, -1.0)
            rows.put(sides[1], whole, 1.0)
            rows.right(sides, Of("corners.outward"))
        rows.linear(whole, Of("slope"))
        self._forces = (forces.contact, forces.candidate)

    def reference(self, given: Boxed) -> Reference:
        """Formulation of the same program in cvxpy."""
        from ..equilibrium.reference import within_box  # cvxpy takes a second to import

        assert given.slope is not None
        return within_box(given.scaled, given.boxes[0], given.slope, products=self._products)

    def solve(self, scaled: Scaled, box: Envelope, slope: Array) -> tuple[Point | None, bool]:
        """The point that minimises slope · [p, f], None where there is none; and whether that is
        known, which it is not where the solver gave up.

        Arguments:
            box: over the B contacts.
            slope: shape (B, 6).
        """
        solution = self.rows.solve(Boxed(scaled, boxes=(box,), slope=slope))
        if not solution.solved:
            return None, solution.status.name == "INFEASIBLE"
        return Relaxed.of(scaled, solution, self._forces).rounded()[1], True

    def _balance(self, layout: Layout, moments: Index) -> None:
        """Σ m_jk e_j × F_k = 0 (E9), or −M: (p × F)_c = p_a F_b − p_b F_a."""
        rows, first = self.rows, layout.contacts[2]
        every, a, b = rows.equal("moment", len(layout.stances), 3), [1, 2, 0], [2, 0, 1]
        if layout.wrench:
            rows.right(every, -Of("scaled.twisted"))
        net = every[layout.contacts[0]]
        rows.put(net[:, :, None], moments[:, a], Of("scaled.frames", (first[:, None], b)))
        rows.put(net[:, :, None], moments[:, b], -Of("scaled.frames", (first[:, None], a)))
