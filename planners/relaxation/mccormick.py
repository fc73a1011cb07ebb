"""P̄ and P1: a problem without its bilinear constraint, and with McCormick envelopes in its place
(Lin et al. §III, §IV-B).

The soft form of P1 minimises the signed margin t by which every envelope row is relaxed. It is
defined wherever P̄ has an answer; t ≤ 0 says that P1 is feasible and t > 0 that it is not, and by
how much. Its multipliers give the exact derivative of t in every bound of the box. The hard form
minimises a course's objective. Several boxes a stance make a choice, one z a stance and box by hull
disjunction: each stance has z_e ≥ 0, Σ z = 1, and its (p, f, m) is a sum of copies, the e-th in z_e
times the envelope of box e.

The forces of m = p f are measured in the axes of their *box*: the contact frame where all
candidates of a toe share one, which is what envelopes are learned in, or world axes, in which
candidates of different slopes can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled, cones_met, skew
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, objective
from ..errors import InvalidInput
from ..files.arrays import Array
from .envelope import (
    HIGH_HIGH,
    HIGH_LOW,
    LOW_HIGH,
    LOW_LOW,
    SIGNS,
    Boxed as Boxed,
    DualBound,
    Envelope,
    RelaxationAnswer,
    Relaxed,
    envelope_rows,
)


def margin_gradient(solution: ConicSolution, at: Array, box: Envelope) -> tuple[Array, Array]:
    """∂t/∂low and ∂t/∂high of P1's signed margin, shape (B, 6) each: the envelope theorem, row by
    row of the envelope.

    Arguments:
        solution: of the program with a margin.
        at: its [p, f], shape (B, 6).
        box: that it was solved over.
    """
    signed = solution.dual("envelope") * SIGNS
    p_ends, f_ends = box.corners.p, box.corners.f
    by_p = (signed * (at[:, None, 3:] - SIGNS * f_ends)).sum(
        axis=3
    )  # of p_end: Σ_k u_jk (f_k − f_end)
    by_f = (signed * (at[:, :3, None] - SIGNS * p_ends)).sum(axis=2)
    below, above = solution.dual("sides")
    low = (
        np.concatenate([by_p[LOW_LOW] + by_p[LOW_HIGH], by_f[LOW_LOW] + by_f[HIGH_LOW]], axis=1)
        + below
    )
    high = (
        np.concatenate([by_p[HIGH_HIGH] + by_p[HIGH_LOW], by_f[HIGH_HIGH] + by_f[LOW_HIGH]], axis=1)
        - above
    )
    return low, high


Axes = Literal["contact", "world"]


class WithoutMoment:
    """P̄ (Lin et al. §III) of a posture: all constraints but the bilinear one.

    With m free, E9 constrains nothing.

    Arguments:
        inner: of half-spaces of reach the inner set, so that its point is one of the problem's.
    """

    def __init__(self, layout: Layout, inner: bool = False) -> None:
        self.rows = Rows[Given](keep=layout.frames == 1)
        self._forces = _terms(self.rows, layout, explicit=False, inner=inner)[2]

    def solve(self, scaled: Scaled) -> Point | None:
        """A point of P̄ in the middle of its feasible set, or None where there is none or the
        solver gave up.
        """
        solution = self.rows.solve(Given(scaled))
        return _relaxed(solution, scaled, self._forces).rounded()[1] if solution.solved else None


class McCormick:
    """P1 over boxes, for one layout.

    Arguments:
        axes: of the forces in the boxes.
        soft: minimise the margin, over one box; else the course's objective.
        boxes: how many a stance chooses among.
    """

    over_boxes: ClassVar[bool] = True
    about_points: ClassVar[bool] = False
    own_rows: ClassVar[tuple[str, ...]] = ()
    """Groups of rows beside the envelope's in which the box's bounds stand."""

    def __init__(
        self, layout: Layout, axes: Axes = "contact", soft: bool = True, boxes: int = 1
    ) -> None:
        if soft and boxes > 1:
            raise InvalidInput(f"boxes: expected 1 for the signed margin, got {boxes}")
        layout.check_point_feet("envelopes")
        self.layout = layout
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        self._body, self._toes, self._forces = _terms(rows, layout, explicit=not soft)
        margin = rows.variable("margin", 1) if soft else None
        first = None  # of the candidates under a contact, whose frame is that of its box
        if axes == "contact":
            first = np.searchsorted(layout.candidate_footholds, layout.contacts[2])
        stance, _, foothold = layout.contacts
        self._position = rows.variable("position", len(stance), 3)
        self._moments = rows.variable("moments", len(stance), 9)
        self._box_forces = self._forces.columns
        if axes == "world" or len(layout.candidate_footholds) > layout.footholds:
            self._box_forces = self._turned(first)
        legs = rows.equal("legs", len(stance), 3)  # p of E2
        rows.put(legs, self._position, 1.0)
        rows.put(legs, self._body.com[layout.stance_frames[stance]], 1.0)
        self._toes.put(legs, foothold, -1.0)
        self._balance(first)
        if boxes == 1:
            self._over_box(margin)
        else:
            self._hull(boxes)
        if margin is not None:
            rows.linear(margin, 1.0)
        else:
            objective(rows, layout, self._body, self._toes)

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The signed margin over one box (``envelope.RelaxedProgram``)."""
        return programs.get(cls, scaled.layout).solve(scaled, box, gradient=gradient)

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The best box of each problem, all of one layout (``envelope.RelaxedProgram``)."""
        return programs.get(cls, scaled[0].layout).solve_any_of_each(scaled, boxes)

    def solve(self, scaled: Scaled, box: Envelope, *, gradient: bool = False) -> RelaxationAnswer:
        """P1 over one box (Lin et al. §III): m = p f replaced by McCormick's envelope over it.

        Arguments:
            box: over the B stance contacts, [p, f] non-dimensional.
            gradient: also that of the signed margin in the box's bounds, from the multipliers.
                Where the rows are hard the margin of the answer is 0 or inf.
        """
        solution = self.rows.solve(Boxed(scaled, boxes=(box,)))
        answer = self._answer(solution, scaled)
        if gradient and answer.at is not None:
            return replace(answer, gradient=margin_gradient(solution, answer.at, box))
        return answer

    def solve_hull(
        self, scaled: Scaled, boxes: Sequence[Envelope], allowed: Array
    ) -> RelaxationAnswer:
        """P1 over the convex hull of a choice among boxes in every stance (Lin et al. §IV-A, mode
        switching).

        Arguments:
            boxes: E of them, each over all stance contacts.
            allowed: 1 where a stance may use a box, 0 where not, shape (S, E).

        Returns:
            An answer with ``modes``, the shares of the boxes, shape (S, E); a stance is decided
            where one of them is 1.
        """
        solution = self.rows.solve(Boxed(scaled, boxes=boxes, allowed=allowed))
        return replace(
            self._answer(solution, scaled), modes=np.clip(solution.value("modes"), 0.0, 1.0)
        )

    def solve_any(self, scaled: Scaled, envelopes: Sequence[Envelope]) -> RelaxationAnswer:
        """P1 with one binary an envelope: the box of least margin, ``chosen``; each is tried, a
        posture has few.

        The margin is NaN where none is feasible and some solve failed. Raises InvalidInput for no
        envelopes.
        """
        return self.solve_any_of_each((scaled,), (envelopes,))[0]

    def solve_any_of_each(
        self, scaled: Sequence[Scaled], envelopes: Sequence[Sequence[Envelope]]
    ) -> list[RelaxationAnswer]:
        """``solve_any`` of every problem."""
        if not all(envelopes):
            raise InvalidInput("envelopes: expected one or more, got none")
        return [
            _best([self.solve(one, box) for box in boxes])
            for one, boxes in zip(scaled, envelopes, strict=True)
        ]

    def dual_bound(self, scaled: Scaled, box: Envelope) -> DualBound:
        """The signed margin over this box, and what its solution and multipliers prove about other
        boxes; of a posture.

        Returns a lower bound that is linear in [p, f] (``DualBound``), the solver's dual residual
        taken at its worst.
        """
        program_data = Boxed(scaled, boxes=(box,))
        solution = self.rows.solve(program_data)
        answer = self._answer(solution, scaled)
        if answer.at is None:
            return DualBound(margin=answer.margin)
        # The rows of the box are left out: they are linear in its bounds, and come back at another
        # box.
        constant, slope = self.rows.lagrangian(
            program_data, solution, without=("envelope", "sides", *self.own_rows)
        )
        com, turn, weights, moments = (
            slope[solution.columns[n]] for n in ("com", "rotation", "weights", "moments")
        )
        # What is left of the other columns, the solver's dual residual, at its worst over their
        # ranges.
        com, radius = com[0], scaled.com_radius[0]
        if "leg" in solution.columns:  # p_w − c, of half-spaces of reach
            constant -= float(
                np.linalg.norm(slope[solution.columns["leg"]], axis=1) @ scaled.farthest
            )
        constant += float(
            com @ scaled.com[0] - radius * np.linalg.norm(com) - scaled.tilt * np.abs(turn).sum()
        )
        constant += float(np.minimum(weights, 0.0).sum())
        rows = solution.dual("envelope")
        left = moments.reshape(-1, 3, 3) - rows[0] - rows[1] + rows[2] + rows[3]
        # of m: made up for by the rows low-low (−m) and low-high (+m)
        rows = np.maximum(rows, 0.0) + np.stack(
            [np.maximum(left, 0), 0 * left, np.maximum(-left, 0), 0 * left]
        )
        return DualBound(
            margin=answer.margin,
            point=answer.at,
            excess=answer.excess,
            rows=rows,
            slope=slope[np.concatenate([self._position, self._box_forces], axis=1)],
            constant=constant,
        )

    def _answer(self, solution: ConicSolution, scaled: Scaled) -> RelaxationAnswer:
        if not solution.solved:
            infeasible = solution.status is ConicStatus.INFEASIBLE
            return RelaxationAnswer(
                margin=float("inf") if infeasible else float("nan"), seconds=solution.seconds
            )
        position = solution.value("position")
        forces = solution.value("box_forces" if "box_forces" in solution.columns else "forces")
        return RelaxationAnswer(
            margin=float(solution.value("margin")[0]) if "margin" in solution.columns else 0.0,
            relaxed=_relaxed(solution, scaled, self._forces),
            at=np.concatenate([position, forces], axis=1),
            excess=solution.value("moments").reshape(-1, 3, 3)
            - position[:, :, None] * forces[:, None, :],
            objective=solution.objective,
            seconds=solution.seconds,
        )

    def _turned(self, first: Index | None) -> Index:
        """The forces of a contact, those of its candidates added up in the axes of its box."""
        rows, contact, candidate = self.rows, self._forces.contact, self._forces.candidate
        count = len(self.layout.contacts[0])
        columns, turned = rows.variable("box_forces", count, 3), rows.equal("turned", count, 3)
        rows.put(turned, columns, 1.0)

        at, by = turned[contact][:, :, None], self._forces.columns[:, None, :]
        if first is None:
            rows.put(at, by, -Of("scaled.frames", candidate))
            return columns
        box = first[contact]
        rows.put(
            at,
            by,
            lambda d: (
                -np.matmul(d.scaled.frames[box].transpose(0, 2, 1), d.scaled.frames[candidate])
            ),
        )
        return columns

    def _balance(self, first: Index | None) -> None:
        """Σ m_jk e_j × F_k = 0 in every stance (E9), or −M; F the axes of the box: (p × F)_c = p_a
        F_b − p_b F_a.
        """
        rows, stance, moments = self.rows, self.layout.contacts[0], self._moments.reshape(-1, 3, 3)
        every, a, b = rows.equal("moment", len(self.layout.stances), 3), [1, 2, 0], [2, 0, 1]
        net = every[stance]
        if self.layout.wrench:
            rows.right(every, -Of("scaled.twisted"))
        if first is None:
            rows.put(net, moments[:, a, b], 1.0)
            rows.put(net, moments[:, b, a], -1.0)
        else:
            rows.put(net[:, :, None], moments[:, a], Of("scaled.frames", (first[:, None], b)))
            rows.put(net[:, :, None], moments[:, b], -Of("scaled.frames", (first[:, None], a)))

    def _over_box(self, margin: Index | None) -> None:
        """Bound (p, f, m) by the envelope of one box; a relaxation of its own adds rows here."""
        whole = np.concatenate([self._position, self._box_forces], axis=1)
        envelope_rows(self.rows, whole, self._moments, margin=margin)

    def _hull(self, boxes: int) -> None:
        """(p, f, m) is a sum of copies, one a box, in as many shares z as it is chosen."""
        rows, (stance, _, _), stances = self.rows, self.layout.contacts, len(self.layout.stances)
        modes = rows.variable("modes", stances, boxes)
        whole = np.concatenate([self._position, self._box_forces, self._moments], axis=1)
        added = rows.equal("added", *whole.shape)
        rows.put(added, whole, -1.0)
        for e in range(boxes):
            copy = rows.variable(f"copy_{e}", *whole.shape)
            rows.put(added, copy, 1.0)
            envelope_rows(rows, copy[:, :6], copy[:, 6:], share=modes[stance, e], e=e)
        one = rows.equal("one_mode", stances)
        rows.put(one[:, None], modes, 1.0)
        rows.right(one, 1.0)
        rows.put(rows.at_most("mode_positive", stances, boxes), modes, -1.0)
        most = rows.at_most("mode_allowed", stances, boxes)
        rows.put(most, modes, 1.0)
        rows.right(most, Of("allowed"))


def _best(answers: Sequence[RelaxationAnswer]) -> RelaxationAnswer:
    """The answer with the least margin, with its index as ``chosen``; an answer with margin NaN if
    that one is not feasible and some of the answers are not known.
    """
    if len(answers) == 1:
        return answers[0]
    chosen = int(np.nanargmin([answer.margin if answer.known else np.inf for answer in answers]))
    best = replace(answers[chosen], chosen=chosen, solves=len(answers))
    all_known = all(answer.known for answer in answers)
    return (
        best
        if best.feasible or all_known
        else RelaxationAnswer(margin=float("nan"), solves=len(answers))
    )


def moment_axes(scaled: Scaled) -> Array:
    """P_j × F_k (E7, E9) in the column 9i + 3j + k, shape (3, 9B): the moment balance of a posture
    is axes · m = 0.
    """
    across = np.matmul(skew(np.eye(3)), scaled.contact_frames[:, None])  # (B, j, 3, k)
    return np.asarray(across.transpose(2, 0, 1, 3).reshape(3, -1))


def _terms(
    rows: Rows[Given], layout: Layout, *, explicit: bool, inner: bool = False
) -> tuple[BodyVariables, FreeToes, Forces]:
    """Every term but m = p f and the objective."""
    body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=explicit)
    forces = Forces.of_candidates(rows, layout, toes)
    forces.balance()
    forces.in_cones()
    forces.in_box(implied=False)
    body.reach(toes, inner=inner)
    body.limits()
    body.steps(toes)
    return body, toes, forces


def _relaxed(solution: ConicSolution, scaled: Scaled, forces: Forces) -> Relaxed:
    return Relaxed(
        scaled=scaled,
        com=solution.value("com"),
        rotation=solution.value("rotation"),
        weights=np.maximum(solution.value("weights"), 0.0),
        forces=solution.value("forces"),
        rows=(forces.contact, forces.candidate),
        seconds=solution.seconds,
    )


def domain_of(scaled: Scaled, axes: Axes = "contact", *, reach: bool = True) -> Envelope:
    """The box over the contacts.

    p: open patches against the ball of the centre of mass.

    Arguments:
        reach: met with the shoulder's reach at any tilt. f: the force box met with the cone's, over
            the open patches; in world axes the box around those boxes.
    """
    layout = scaled.layout
    stance, limb, foothold = layout.contacts
    frame = layout.stance_frames[stance]
    low, high = toe_ranges(scaled)
    radius = scaled.com_radius[frame][:, None]
    p_low, p_high = (
        low[foothold] - scaled.com[frame] - radius,
        high[foothold] - scaled.com[frame] + radius,
    )
    if reach:
        shoulders, size = scaled.shoulders[limb], np.abs(scaled.shoulders[limb])
        far = scaled.reach[limb][:, None] + scaled.tilt * (
            size.sum(axis=1, keepdims=True) - size
        )  # |(Θ × v)_j|
        p_low, p_high = np.maximum(p_low, shoulders - far), np.minimum(p_high, shoulders + far)
    f_low, f_high = _forces(scaled, layout, axes)
    return Envelope.from_vector(
        np.concatenate([np.hstack([p_low, f_low]), np.hstack([p_high, f_high])], axis=None)
    )


def toe_ranges(scaled: Scaled) -> tuple[Array, Array]:
    """Lowest and highest coordinates of every foothold's open patches, shape (P, 3) each."""
    starts = np.searchsorted(scaled.layout.vertex_footholds, np.arange(scaled.layout.footholds))
    return np.minimum.reduceat(scaled.vertices, starts), np.maximum.reduceat(
        scaled.vertices, starts
    )


def _forces(scaled: Scaled, layout: Layout, axes: Axes) -> tuple[Array, Array]:
    """Bounds on the forces of every contact in its box's axes, (B, 3) each."""
    contact, candidate = layout.contact_candidates
    low, high = cones_met(
        scaled.force_min[contact], scaled.force_max[contact], scaled.friction[candidate]
    )
    if axes == "world":
        turn = scaled.frames[candidate]
        middle = np.matmul(turn, 0.5 * (low + high)[..., None])[..., 0]
        half = np.matmul(np.abs(turn), 0.5 * (high - low)[..., None])[..., 0]
        low, high = middle - half, middle + half
    starts = np.searchsorted(contact, np.arange(len(scaled.force_min)))
    return np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)


_BELOW, _ABOVE = 0, 1
"""Numbers of the cones with p_j − l_j and with h_j − p_j."""
_SIGNS = np.array([1.0, -1.0])[:, None, None, None]
"""Signs of m in those cones, shape (2, 1, 1, 1)."""


class Coned(McCormick):
    """McCormick's P1 over one box, with the friction cones times the box's bounds of positions: tighter
    than McCormick's envelope, in the same box.

    McCormick's rows multiply bounds of p by bounds of f. The friction cone ‖f_t‖ ≤ μ f_n (E10) is a
    bound of f, too, and times p_j − l_j ≥ 0 and h_j − p_j ≥ 0 it gives, with m_jk for p_j f_k,

        ‖m_jt − l_j f_t‖ ≤ μ (m_jn − l_j f_n),    ‖h_j f_t − m_jt‖ ≤ μ (h_j f_n − m_jn),

    two second-order cones per axis j and contact. Both hold at every point of the box with m = p f,
    so that nothing that P admits is lost. The signed margin t widens them as it widens the envelope.

    The rows are left out of contacts with several candidates, of boxes in world axes, and where a
    stance chooses among boxes: forces have no one cone in the axes of the box there, or the box is
    not known yet.
    """

    own_rows: ClassVar[tuple[str, ...]] = ("box_cones",)

    def __init__(
        self, layout: Layout, axes: Axes = "contact", soft: bool = True, boxes: int = 1
    ) -> None:
        super().__init__(layout, axes, soft, boxes)
        counts = np.bincount(layout.candidate_footholds, minlength=layout.footholds)
        foothold = layout.contacts[2]
        alone = counts[foothold] == 1 if axes == "contact" and boxes == 1 else counts[foothold] < 0
        self._coned = np.flatnonzero(alone)
        self._candidate = np.searchsorted(layout.candidate_footholds, foothold)[self._coned]
        rows, shape = (
            self.rows,
            (2, len(self._coned), 3, 3),
        )  # side, contact, axis j, row of the cone
        cone = rows.cones("box_cones", int(np.prod(shape[:3])), 3).reshape(shape)
        moments = self._moments.reshape(-1, 3, 3)[self._coned]
        forces = self._box_forces[self._coned][:, None, :]
        rows.put(cone, moments, lambda given: -_SIGNS * self._sides(given.scaled))
        rows.put(cone, forces, self._moved)
        if soft:
            rows.put(cone[..., 0], rows.columns["margin"], -1.0)

    def solve(self, scaled: Scaled, box: Envelope, *, gradient: bool = False) -> RelaxationAnswer:
        """P1 over one box; the gradient has the part of the cones, too."""
        program_data = Boxed(scaled, boxes=(box,))
        solution = self.rows.solve(program_data)
        answer = self._answer(solution, scaled)
        if not gradient or answer.at is None:
            return answer
        force = answer.at[self._coned, None, 3:] * self._sides(scaled)
        multipliers = solution.dual("box_cones").reshape(2, -1, 3, 3)
        by_end = _SIGNS[..., 0] * np.sum(multipliers * force, axis=3)
        low, high = margin_gradient(solution, answer.at, box)
        low[self._coned, :3] += by_end[_BELOW]
        high[self._coned, :3] += by_end[_ABOVE]
        return replace(answer, gradient=(low, high))

    def _sides(self, scaled: Scaled) -> Array:
        """Factors of (f_n, f_y, f_z) in a cone's rows: μ, 1, 1, shape (C, 1, 3)."""
        friction = scaled.friction[self._candidate]
        return np.stack([friction, np.ones_like(friction), np.ones_like(friction)], axis=-1)[
            :, None, :
        ]

    def _moved(self, given: Given) -> Array:
        """Factors of the forces: l and −h of the contacts with cones, times the factors, (2, C, 3,
        3).
        """
        assert isinstance(given, Boxed)
        ends = np.stack(given.boxes[0].position)[:, self._coned, :, None]
        return np.asarray(_SIGNS * ends * self._sides(given.scaled))
