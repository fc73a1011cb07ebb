"""P1 over the lift and a learned box at once, "joint": each cuts off points that the other lets
through.

Both relax p fᵀ: the lift by Σ_u v_u f_uᵀ (toe in the world), McCormick's envelope by m over a box
of p = p_w − c. Their difference is c fᵀ, bilinear itself, but Σ R f is the weight, so that over a
stance it is linear in c: the two are *linked* in all nine components,

    Σ_i (Σ_u v_u f_uᵀ − m_i) R_iᵀ = c (w e_z − F)ᵀ,    F the force on the body beside its weight,

of which the skew part says that E9 holds of both. The margin t ≥ 0 relaxes the envelope alone;
beside it the gap of the lift, linearised at a learned point (``least_gap``), draws the answer to
the bilinear surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, Moments
from ..errors import InvalidInput
from ..files.arrays import Array
from .boxed import Boxed
from .envelope import Envelope
from .envelope_rows import envelope_rows
from .least_gap import least_gap
from .margin_gradient import margin_gradient
from .relaxed import RelaxationAnswer, Relaxed

MARGIN_PRICE = 10.0
"""Price of the margin, in units of the squared gap: the answer leaves the envelope only where it
has to."""


def near_nominal(scaled: Scaled, at: Array) -> Point:
    """A point with these [p, f], the bodies where they are nominally; it need not be on the
    patches.

    Arguments:
        at: shape (B, 6), non-dimensional. Its residual is inf: it is a place to linearise about, no
            answer.
    """
    stance, _, foothold = scaled.layout.contacts
    toes = np.zeros((scaled.layout.footholds, 3))
    toes[foothold] = at[:, :3] + scaled.com[scaled.layout.stance_frames[stance]]
    still = np.zeros_like(scaled.com)
    return Point(com=scaled.com, rotation=still, toes=toes, forces=at[:, 3:], residual=float("inf"))


class JointRelaxation:
    """The lift and P1 over one box a stance contact, linked; one candidate a foothold, whose feet
    are points.

    Arguments:
        signed: minimise the signed margin alone; else MARGIN_PRICE · t + Σ g², t ≥ 0, with the gap
            linearised at a point.
    """

    over_boxes: ClassVar[bool] = True
    about_points: ClassVar[bool] = True

    def __init__(self, layout: Layout, signed: bool = False) -> None:
        layout.check_point_feet("envelopes")
        self._signed, self.rows = signed, Rows[Given](keep=layout.frames == 1)
        rows = self.rows
        body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=False)
        forces = Forces.of_vertices(rows, layout, toes)
        self._forces = (forces.contact, forces.candidate)
        forces.balance()
        moments = Moments(layout)
        moments.add(forces.stance, forces.columns, Of("scaled.arms"))
        moments.of_weight(body)
        moments.vanish(rows)
        forces.in_cones()
        forces.in_box(implied=False)
        body.reach(toes)
        body.limits()
        body.steps(toes)
        margin = rows.variable("margin", 1)
        self._boxed(layout, body, toes, forces, margin)
        rows.linear(margin, 1.0 if signed else MARGIN_PRICE)
        if not signed:
            rows.put(rows.at_most("margin_positive", 1), margin, -1.0)
            least_gap(rows, layout, toes, forces)

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The signed margin over one box (``table.RelaxedProgram``)."""
        return programs.get(cls, scaled.layout, True).solve(scaled, box, gradient=gradient)

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The one box of each problem, all of one layout (``table.RelaxedProgram``)."""
        if any(len(each) != 1 for each in boxes):
            raise InvalidInput(f"envelopes: expected one for joint, got {max(map(len, boxes))}")
        return programs.get(cls, scaled[0].layout).solve_each(
            scaled, [box for (box,) in boxes], points
        )

    def solve(
        self, scaled: Scaled, box: Envelope, at: Array | None = None, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """P1 over this box.

        Arguments:
            at: [p, f] about which the gap is linearised, shape (B, 6); None, where it is, for the
                middle of the box.
            gradient: of the margin in the box's bounds.
        """
        program_data = self._given(scaled, box, at)
        return self._answer(self.rows.solve(program_data), program_data, gradient=gradient)

    def solve_each(
        self, scaled: Sequence[Scaled], boxes: Sequence[Envelope], at: Sequence[Array]
    ) -> list[RelaxationAnswer]:
        """``solve`` of one box and one point per problem.

        Arguments:
            at: no points stand for the middles of the boxes.
        """
        about: Sequence[Array | None] = at or [None] * len(scaled)
        return [self.solve(*one) for one in zip(scaled, boxes, about, strict=True)]

    def _given(self, scaled: Scaled, box: Envelope, at: Array | None) -> Boxed:
        about = (
            None
            if self._signed
            else near_nominal(scaled, 0.5 * (box.low + box.high) if at is None else at)
        )
        return Boxed(scaled, about, boxes=(box,))

    def _answer(
        self, solution: ConicSolution, given: Boxed, *, gradient: bool = False
    ) -> RelaxationAnswer:
        if not solution.solved:
            infeasible = solution.status is ConicStatus.INFEASIBLE
            return RelaxationAnswer(
                margin=float("inf") if infeasible else float("nan"), seconds=solution.seconds
            )
        position, forces = solution.value("position"), solution.value("box_forces")
        reached = np.concatenate([position, forces], axis=1)
        return RelaxationAnswer(
            margin=float(solution.value("margin")[0]),
            relaxed=Relaxed.of(given.scaled, solution, self._forces),
            at=reached,
            excess=solution.value("moments").reshape(-1, 3, 3)
            - position[:, :, None] * forces[:, None, :],
            objective=solution.objective,
            seconds=solution.seconds,
            gradient=margin_gradient(solution, reached, given.boxes[0]) if gradient else None,
        )

    def _boxed(
        self, layout: Layout, body: BodyVariables, toes: FreeToes, forces: Forces, margin: Index
    ) -> None:
        """p, f and m of every stance contact over its box, and how they hang together with the
        lift.
        """
        rows, (stance, _, foothold) = self.rows, layout.contacts
        count, contact, vertex = len(stance), *layout.contact_vertices
        position, moments = rows.variable("position", count, 3), rows.variable("moments", count, 9)
        legs = rows.equal("legs", count, 3)  # p = p_w − c (E2)
        rows.put(legs, position, 1.0)
        rows.put(legs, body.com[layout.stance_frames[stance]], 1.0)
        toes.put(legs, foothold, -1.0)
        total = rows.variable("box_forces", count, 3)
        turned = rows.equal("turned", count, 3)  # f = Σ_u f_u
        rows.put(turned, total, 1.0)
        rows.put(turned[contact], forces.columns, -1.0)
        linked = rows.equal("linked", len(layout.stances), 3, 3)  # j of p, l of R f
        lifted = linked[stance[contact]][..., None]
        rows.put(
            lifted,
            forces.columns[:, None, None, :],
            lambda d: (
                d.scaled.vertices[vertex][:, :, None, None]
                * d.scaled.frames[forces.candidate][:, None, :, :]
            ),
        )
        box = np.searchsorted(layout.candidate_footholds, foothold)[:, None, None, None]
        axes = np.arange(3)
        rows.put(
            linked[stance][..., None],
            moments.reshape(count, 3, 1, 3),
            -Of("scaled.frames", (box, axes[None, None, :, None], axes)),
        )
        com = body.com[layout.stance_frames]
        if layout.loaded:
            rows.put(linked, com[:, :, None], -Of("scaled.borne", (slice(None), None)))
        else:
            rows.put(linked[:, :, 2], com, -Of("scaled.weight"))
        envelope_rows(rows, np.concatenate([position, total], axis=1), moments, margin=margin)
