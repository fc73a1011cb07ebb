"""P1 lift: the relaxation that needs no learned box.

With p_w = Σ λ_u v_u (E1) and f_u := λ_u f the moment Σ p_w × f is Σ_u v_u × f_u, linear; Σ_u f_u =
f holds by definition, and each f_u lies in the friction cone and in λ_u times the force box. Only
toe-in-patch times force is relaxed; the centre of mass is not, since Σ f is fixed
(``terms.Moments``). Over several candidate patches r of a toe, λ_{r,u} with z_r = Σ_u λ_{r,u}, and
f_{r,u} in the cone of μ_r: the convex hull of "one of the patches" comes with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs, multipliers
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, Moments, objective
from ..errors import InvalidInput
from ..files.arrays import Array
from .envelope import Boxed, Envelope, RelaxationAnswer, Relaxed, envelope_rows, unit_shares
from .mccormick import margin_gradient


class LeastGap:
    """min Σ g² over the lift, moments being zero; one candidate a foothold.

    Its point is one to project from.
    """

    def __init__(self, layout: Layout) -> None:
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=False)
        forces = Forces.of_vertices(rows, layout, toes)
        forces.balance()
        Moments.of(layout, body, forces).vanish(rows)
        self._forces = (forces.contact, forces.candidate)
        _least_gap(rows, layout, toes, forces)
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


def _least_gap(rows: Rows[Given], layout: Layout, toes: FreeToes, forces: Forces) -> Index:
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
        Moments.of(layout, body, forces).vanish(rows)
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
            _least_gap(rows, layout, toes, forces)

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The signed margin over one box (``envelope.RelaxedProgram``)."""
        return programs.get(cls, scaled.layout, True).solve(scaled, box, gradient=gradient)

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The one box of each problem, all of one layout (``envelope.RelaxedProgram``)."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftAnswer(Relaxed):
    """One solve of the lift.

    Arguments:
        status: INFEASIBLE with multipliers that refute the relaxation, and so the problem.
        bound: on the least moment residual, or on the objective of a course: inf where infeasible,
            and 0 or −inf, which prove nothing, where the solver gave up. Where there is a point its
            forces are f_u, (F, 3).
    """

    status: ConicStatus
    bound: float
    solution: ConicSolution

    @cached_property
    def multipliers(self) -> Array:
        """A certificate's row for the bound."""
        return multipliers(self.scaled.layout, self.solution)

    @property
    def solved(self) -> bool:
        """Tell whether the solver came to an end, one way or the other."""
        return self.status is not ConicStatus.FAILED

    @property
    def by_vertex(self) -> Array:
        """f_u in contact frames, shape (F, 3)."""
        return self.forces


class LiftProgram:
    """The lift of one layout.

    Arguments:
        implied: leave out the rows of the force box that the cones imply (``Scaled.box_implied``).
        least_moment: minimise the moment residual, for which there is an answer nearly always; else
            the course's objective, moments being zero.
    """

    over_boxes: ClassVar[bool] = False
    about_points: ClassVar[bool] = False

    def __init__(self, layout: Layout, implied: bool, least_moment: bool) -> None:
        self.layout, self.rows = layout, Rows[Given](keep=layout.frames == 1)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=not least_moment, implied=implied)
        forces = Forces.of_vertices(rows, layout, toes)
        self._forces = (forces.contact, forces.candidate)
        forces.balance()
        moments = Moments.of(layout, body, forces)
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

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The least moment residual, whatever the box (``envelope.RelaxedProgram``)."""
        return cls.answers(programs, [scaled], [[box]], [])[0]

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The least moment residual of each problem (``envelope.RelaxedProgram``)."""
        return [as_relaxation(solve_lift(programs, one, least_moment=True)) for one in scaled]

    def solve(self, scaled: Scaled) -> LiftAnswer:
        """Solve for a problem of this layout."""
        return self._answer(scaled, self.rows.solve(Given(scaled)))

    def _answer(self, scaled: Scaled, solution: ConicSolution) -> LiftAnswer:
        least = "residual" in solution.columns
        bound = {
            ConicStatus.SOLVED: max(0.0, solution.objective) if least else solution.bound,
            ConicStatus.INFEASIBLE: float("inf"),
            ConicStatus.FAILED: 0.0 if least else float("-inf"),
        }[solution.status]
        return LiftAnswer(
            scaled=scaled,
            status=solution.status,
            bound=bound,
            solution=solution,
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            weights=unit_shares(scaled, solution.value("weights")),
            forces=solution.value("forces"),
            rows=self._forces,
            seconds=solution.seconds,
        )


def solve_lift(programs: Programs, scaled: Scaled, *, least_moment: bool) -> LiftAnswer:
    """Solve the lift, in its small form where that says the same.

    Arguments:
        programs: to share.
        least_moment: minimise the moment residual; else the course's objective, moments being zero.

    Returns:
        An answer whose ``bound`` is proved: of the residual, or of the objective; inf where there
        is none.
    """
    return programs.get(LiftProgram, scaled.layout, scaled.box_implied, least_moment).solve(scaled)


def as_relaxation(lift: LiftAnswer) -> RelaxationAnswer:
    """The lift of a posture in P1's words: its margin is the moment residual."""
    if not lift.solved:
        return RelaxationAnswer(margin=float("nan"))
    return RelaxationAnswer(margin=lift.bound, relaxed=None if np.isinf(lift.bound) else lift)
