"""The terms of Lin et al. as rows: each equation once, for one posture and for many key frames
alike.

A term adds its variables and rows to ``Rows``; a program is a short list of terms (``relaxation``,
``projection``). All quantities are non-dimensional. Programs are loaded with a ``Given``. The same
terms in cvxpy: ``relaxation.papers``. Half-spaces of reach (``robot.reach_sets``) have rows that
stand in for a·R(Θ)ᵀ(p − c) ≤ b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array
from .layout import Fill, Index, Layout, Of
from .rows import Rows
from .scaled import Point, Scaled, skew


def within_half_spaces(
    rows: Rows[Any],
    layout: Layout,
    com: Index,
    rotation: Index,
    put_toes: Callable[[Index, Index, float], None],
    inner: bool,
) -> None:
    """a·d + Θ·(a × s) ≤ b + t(a) (ρ + t(s)), the outer set, or a·d + Θ·(a × z) + t(a) ‖a × (d − z)‖
    ≤ b, the inner one.

    The rows are all half-spaces of the limbs that stand, frame by frame; d = p_w − c has columns of
    its own.

    Arguments:
        com, rotation: columns of c and Θ, (M, 3).
        put_toes: see ``terms.Toes``.
    """
    frame, _, foothold = layout.standing
    leg, is_leg = rows.variable("leg", len(frame), 3), rows.equal("leg", len(frame), 3)
    rows.put(is_leg, leg, 1.0)
    rows.put(is_leg, com[frame], 1.0)
    put_toes(is_leg, foothold, -1.0)
    which, row = layout.standing_rows
    rows_of_leg = leg[which]
    if inner and not layout.level:  # else both sets are a·d ≤ b
        cone = rows.cones("reach_rows", len(row), 3)
        at, levers, bounds = cone[:, 0], "levers", "bounds"
        rows.put(cone[:, 1:, None], rows_of_leg[:, None], -Of("scaled.half_spaces.arms", row))
        rows.right(cone[:, 1:], -Of("scaled.half_spaces.offsets", row))
    else:
        at, levers, bounds = rows.at_most("reach_rows", len(row)), "outer_levers", "outer_bounds"
    rows.put(at[:, None], rows_of_leg, Of("scaled.half_spaces.normals", row))
    rows.put(at[:, None], rotation[frame[which]], Of(f"scaled.half_spaces.{levers}", row))
    rows.right(at, Of(f"scaled.half_spaces.{bounds}", row))


def within_relative_reach(
    rows: Rows[Any], layout: Layout, put_toes: Callable[[Index, Index, float], None]
) -> None:
    """a·(p_other − p_limb) ≤ b wherever the limb has moved; the difference has columns of its
    own.
    """
    (half_space, which), (moved, other, _) = layout.relative_rows, layout.relative_pairs.T
    apart, is_apart = rows.variable("apart", len(moved), 3), rows.equal("apart", len(moved), 3)
    rows.put(is_apart, apart, 1.0)
    put_toes(is_apart, other, -1.0)
    put_toes(is_apart, moved, 1.0)
    at = rows.at_most("relative_reach", len(half_space))
    rows.put(at[:, None], apart[which], Of("scaled.relative", np.s_[half_space, :3]))
    rows.right(at, Of("scaled.relative", np.s_[half_space, 3]))


@dataclass(frozen=True, eq=False)
class Given:
    """Data that a program is loaded with: a problem, and the point that is held or linearised
    about, where there is one.
    """

    scaled: Scaled
    about: Point | None = None

    @property
    def held(self) -> Point:
        """``about``, which is there."""
        assert self.about is not None
        return self.about

    @cached_property
    def held_arms(self) -> Array:
        """[p̄_w]× R_WC of every stance contact, the toes held; one candidate a foothold; shape (B,
        3, 3).
        """
        return np.asarray(
            np.matmul(skew(self.scaled.bearing_points(self.held.toes)), self.scaled.contact_frames)
        )

    @cached_property
    def held_levers(self) -> Array:
        """[F̄]× of the force held at every stance contact, in the world, shape (B, 3, 3)."""
        return skew(self.scaled.in_world(self.held.forces))


class Toes(Protocol):
    """Toes of a program: variables on their patches, or held."""

    def put(self, at: Index, footholds: Index, sign: float) -> None:
        """Add sign · p_w of these footholds to rows of A x − b.

        Arguments:
            at: shape (n, 3).
        """
        ...


class FreeToes:
    """Toes as convex combinations of their candidates' vertices, p_w = Σ λ_u v_u (E1).

    Arguments:
        explicit: give p_w columns of their own, so that an objective in it does not depend on the
            data.
        implied: λ ≥ 0 follows from the forces of the stance contacts (``Scaled.box_implied``).
    """

    def __init__(
        self, rows: Rows[Any], layout: Layout, *, explicit: bool, implied: bool = False
    ) -> None:
        self._rows, self._layout = rows, layout
        self.weights = rows.variable("weights", len(layout.vertex_footholds))
        one = rows.equal("one", layout.footholds)
        rows.put(one[layout.vertex_footholds], self.weights, 1.0)  # Σ λ_u = 1
        rows.right(one, 1.0)
        loose = self.weights
        if implied:
            loose = self.weights[~np.isin(layout.vertex_footholds, layout.contacts[2])]
        rows.put(rows.at_most("positive", len(loose)), loose, -1.0)  # λ ≥ 0
        self.points: Index | None = None
        if explicit:
            points, toe = (
                rows.variable("toes", layout.footholds, 3),
                rows.equal("toe", layout.footholds, 3),
            )
            rows.put(toe, points, 1.0)
            rows.put(toe[layout.vertex_footholds], self.weights[:, None], -Of("scaled.vertices"))
            self.points = points

    def put(self, at: Index, footholds: Index, sign: float) -> None:
        """Add sign · p_w of these footholds to rows of A x.

        Arguments:
            at: shape (n, 3).
        """
        if self.points is not None:
            self._rows.put(at, self.points[footholds], sign)
            return
        which, vertex = self._layout.under(footholds)
        self._rows.put(
            at[which], self.weights[vertex][:, None], sign * Of("scaled.vertices", vertex)
        )


class HeldToes:
    """Toes that stay where the point has them."""

    def __init__(self, rows: Rows[Given]) -> None:
        self._rows = rows

    def put(self, at: Index, footholds: Index, sign: float) -> None:
        """Add −sign · p_w of these footholds to b.

        Arguments:
            at: shape (n, 3).
        """
        self._rows.right(at, -sign * Of("held.toes", footholds))


class BodyVariables:
    """Centre of mass c and small rotation Θ of every frame, and what limits them (E2, E11)."""

    def __init__(self, rows: Rows[Any], layout: Layout) -> None:
        self._rows, self._layout = rows, layout
        self.com = rows.variable("com", layout.frames, 3)
        self.rotation = rows.variable("rotation", layout.frames, 3)

    def limits(self) -> None:
        """‖c − c_nominal‖ ≤ radius and |Θ_i| ≤ tilt."""
        ball = self._rows.cones("ball", self._layout.frames, 4)
        self._rows.put(ball[:, 1:], self.com, -1.0)
        self._rows.right(ball[:, 0], Of("scaled.com_radius"))
        self._rows.right(ball[:, 1:], -Of("scaled.com"))
        for name, sign in (("tilted", 1.0), ("tilted_back", -1.0)):
            tilted = self._rows.at_most(name, self._layout.frames, 3)
            self._rows.put(tilted, self.rotation, sign)
            self._rows.right(tilted, Of("scaled.tilt"))

    def held(self) -> None:
        """c and Θ are those of the point."""
        for name, columns in (("com", self.com), ("rotation", self.rotation)):
            stay = self._rows.equal("held_" + name, self._layout.frames, 3)
            self._rows.put(stay, columns, 1.0)
            self._rows.right(stay, Of("held." + name))

    def reach(self, toes: Toes, *, inner: bool = False) -> None:
        """‖p_w − c − (I + [Θ]×) v‖ ≤ Δ_FK wherever a limb stands (E11), the rotation linearised.

        Of half-spaces of reach the outer set, or the inner one, which plans are to be in
        (``robot.reach``).
        """
        layout, rows = self._layout, self._rows
        frame, limb, foothold = layout.standing
        leg = rows.cones("reach", len(frame), 4)
        rows.put(leg[:, 1:], self.com[frame], 1.0)
        toes.put(leg[:, 1:], foothold, -1.0)
        i, j = [1, 2, 0], [2, 0, 1]  # (Θ × v)_k = Θ_i v_j − Θ_j v_i
        rows.put(leg[:, 1:], self.rotation[frame][:, i], Of("scaled.shoulders", (limb[:, None], j)))
        rows.put(
            leg[:, 1:], self.rotation[frame][:, j], -Of("scaled.shoulders", (limb[:, None], i))
        )
        rows.right(leg[:, 0], Of("scaled.reach", limb))
        rows.right(leg[:, 1:], -Of("scaled.shoulders", limb))
        if layout.reach_rows:
            within_half_spaces(rows, layout, self.com, self.rotation, toes.put, inner)

    def steps(self, toes: Toes | None) -> None:
        """‖c[r] − c[r−1]‖, ‖p_i[r] − p_i[r−1]‖, ‖Θ[r] − Θ[r−1]‖ ≤ Δ_max (E11), and the progress of
        c along its path.

        Arguments:
            toes: None where they are held, and their steps are what they are.
        """
        layout, rows, count = self._layout, self._rows, self._layout.frames - 1
        if not count:
            return
        for name, columns, limit in (
            ("com_step", self.com, 0),
            ("rotation_step", self.rotation, 2),
        ):
            step = rows.cones(name, count, 4)
            rows.put(step[:, 1:], columns[1:], -1.0)
            rows.put(step[:, 1:], columns[:-1], 1.0)
            rows.right(step[:, 0], Of("scaled.steps", limit))
        ahead = rows.at_most("progress", count)  # progress − d·(c[r] − c[r−1]) ≤ 0
        rows.put(ahead[:, None], self.com[1:], -Of("scaled.direction"))
        rows.put(ahead[:, None], self.com[:-1], Of("scaled.direction"))
        rows.right(ahead, -Of("scaled.progress"))
        if layout.linear:
            self._linear_steps()
        if toes is not None and len(layout.moves):
            step = rows.cones("toe_step", len(layout.moves), 4)
            toes.put(step[:, 1:], layout.moves[:, 1], -1.0)
            toes.put(step[:, 1:], layout.moves[:, 0], 1.0)
            rows.right(step[:, 0], Of("scaled.steps", 1))
            if len(layout.relative_rows[0]):
                within_relative_reach(rows, layout, toes.put)

    def _linear_steps(self) -> None:
        """a·(c[r] − c[r−1], Θ[r] − Θ[r−1]) ≤ b of every further row
        (``StepLimits.linear_rows``).
        """
        row = np.tile(np.arange(self._layout.linear), self._layout.frames - 1)
        step = np.repeat(np.arange(self._layout.frames - 1), self._layout.linear)
        at = self._rows.at_most("linear_step", len(row))
        for columns, of in ((self.com, [0, 1, 2]), (self.rotation, [3, 4, 5])):
            slope = Of("scaled.linear", (step[:, None], row[:, None], of))
            self._rows.put(at[:, None], columns[step + 1], slope)
            self._rows.put(at[:, None], columns[step], -slope)
        self._rows.right(at, Of("scaled.linear", (step, row, 6)))


class Forces:
    """Forces (f_n, f_y, f_z) in contact frames (E3), n of them, with their cones, boxes and
    balance.

    Arguments:
        contact, candidate: whose each is, shape (n,).
        share: how much of the foothold each belongs to, as (row, column) pairs whose columns add up
            to it; None where it is all of it.
    """

    def __init__(
        self,
        rows: Rows[Any],
        layout: Layout,
        contact: Index,
        candidate: Index,
        share: tuple[Index, Index] | None,
    ) -> None:
        self._rows, self._layout, self._share = rows, layout, share
        self.contact, self.candidate = contact, candidate
        self.stance = layout.contacts[0][contact]
        self.columns = rows.variable("forces", len(contact), 3)

    @classmethod
    def of_contacts(cls, rows: Rows[Any], layout: Layout) -> Forces:
        """One force a stance contact; one candidate a foothold."""
        foothold = layout.contacts[2]
        return cls(rows, layout, np.arange(len(foothold)), foothold, None)

    @classmethod
    def of_candidates(cls, rows: Rows[Given], layout: Layout, toes: FreeToes) -> Forces:
        """One force for every candidate under a contact, as large as its share Σ_u λ_u of the
        foothold (P1); where each has one candidate, ``of_contacts``.

        Arguments:
            toes: whose λ are these shares.
        """
        contact, candidate = layout.contact_candidates
        if all(len(counts) == 1 for counts in layout.corners):
            return cls.of_contacts(rows, layout)
        sizes = np.bincount(layout.vertex_candidates)
        starts = np.cumsum(sizes) - sizes
        row = np.repeat(np.arange(len(candidate)), sizes[candidate])
        within = np.arange(len(row)) - np.repeat(
            np.cumsum(sizes[candidate]) - sizes[candidate], sizes[candidate]
        )
        return cls(
            rows, layout, contact, candidate, (row, toes.weights[starts[candidate[row]] + within])
        )

    @classmethod
    def of_vertices(cls, rows: Rows[Any], layout: Layout, toes: FreeToes) -> Forces:
        """f_u := λ_u f of every vertex under a contact: the lift's forces, in the frame of the
        vertex's candidate.

        Arguments:
            toes: whose λ_u scale cone and box of each, so that a vertex without weight carries
                nothing.
        """
        contact, vertex = layout.contact_vertices
        share = (np.arange(len(vertex)), toes.weights[vertex])
        return cls(rows, layout, contact, layout.vertex_candidates[vertex], share)

    def in_cones(self) -> None:
        """√(f_y² + f_z²) ≤ μ f_n (E10)."""
        cone = self._rows.cones("cone", len(self.contact), 3)
        self._rows.put(cone[:, 0], self.columns[:, 0], -Of("scaled.friction", self.candidate))
        self._rows.put(cone[:, 1:], self.columns[:, 1:], -1.0)

    def in_box(self, *, implied: bool) -> None:
        """share · f_min ≤ f ≤ share · f_max.

        Arguments:
            implied: f_n ≤ share · f_max alone (``Scaled.box_implied``).
        """
        axes = [0] if implied else [0, 1, 2]
        self._side("most", 1.0, axes, "scaled.force_max")
        if not implied:
            self._side("least", -1.0, axes, "scaled.force_min")

    def balance(self) -> None:
        """Σ f = w e_z in every stance (E5), less the force on the body where there is one."""
        net = self._rows.equal("balance", len(self._layout.stances), 3)
        self._rows.put(
            net[self.stance][:, :, None],
            self.columns[:, None, :],
            Of("scaled.frames", self.candidate),
        )
        self._rows.right(net[:, 2], Of("scaled.weight"))
        if self._layout.loaded:
            axes = slice(3) if self._layout.wrench else slice(2)  # pushes are level
            self._rows.right(net[:, axes], -Of("scaled.wrench", (slice(None), axes)))

    def _side(self, name: str, sign: float, axes: list[int], bound: str) -> None:
        """sign · f ≤ sign · share · bound, for these components.

        Arguments:
            bound: of the stance contacts, shape (B, 3).
        """
        side = self._rows.at_most(name, len(self.contact), len(axes))
        self._rows.put(side, self.columns[:, axes], sign)
        if self._share is None:
            self._rows.right(side, sign * Of(bound, (self.contact[:, None], axes)))
        else:
            row, column = self._share
            self._rows.put(
                side[row], column[:, None], -sign * Of(bound, (self.contact[row][:, None], axes))
            )


class Moments:
    """Net moments about the COM of every stance, hard or within a slack (E6, E9): a list of linear
    parts, added up.

    Σ f is fixed to the weight, so the moment about the moving centre of mass is Σ p_w × f − w c ×
    e_z, linear in c. With a force F and a moment M on the body it is Σ p_w × f − c × (w e_z − F) +
    M.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._com: Index | None = None
        self._parts: list[tuple[Index, Index, Of | Fill[Given]]] = []
        self._offsets: list[Fill[Given]] = []

    @classmethod
    def of(
        cls, layout: Layout, body: BodyVariables, forces: Forces, arms: str = "scaled.arms"
    ) -> Moments:
        """Moments of forces with these arms, p × F, less that of the weight, of every stance."""
        moments = cls(layout)
        moments.add(forces.stance, forces.columns, Of(arms))
        moments.of_weight(body)
        return moments

    def add(self, stance: Index, columns: Index, values: Of | Fill[Given]) -> None:
        """Add a linear part, values · x[columns], to the net moment of stances.

        Arguments:
            stance: which, shape (n,).
            columns: shape (n, k).
            values: arms in the world, shape (n, 3, k), numbers or what gives them for a problem.
        """
        self._parts.append((stance, columns, values))

    def of_weight(self, body: BodyVariables) -> None:
        """−w c × e_z = −w (c_y, −c_x, 0); with a force F and a moment M on the body −c × (w e_z −
        F) + M.
        """
        self._com = body.com[self._layout.stance_frames]

    def shift(self, values: Fill[Given]) -> None:
        """Add a constant, shape (S, 3)."""
        self._offsets.append(values)

    def vanish(self, rows: Rows[Given]) -> None:
        """Every component is zero."""
        self._put(rows, rows.equal("moment", len(self._layout.stances), 3), 1.0)

    def within(self, rows: Rows[Given], *, each: bool = False) -> Index:
        """Every component is at most the residual s ≥ 0, either way; its column.

        Arguments:
            each: one residual a stance, (S,).
        """
        stances = len(self._layout.stances)
        residual = rows.variable("residual", stances if each else 1)
        for name, sign in (("above", 1.0), ("below", -1.0)):
            net = rows.at_most(name, stances, 3)
            self._put(rows, net, sign)
            rows.put(net, residual[:, None], -1.0)
        rows.put(rows.at_most("residual", len(residual)), residual, -1.0)
        return residual

    def _put(self, rows: Rows[Given], net: Index, sign: float) -> None:
        for stance, columns, values in self._parts:
            rows.put(net[stance][:, :, None], columns[:, None, :], _times(sign, values))
        if self._com is not None and self._layout.wrench:  # −c × (w e_z − F) + M
            for axis in range(3):
                after, last = (axis + 1) % 3, (axis + 2) % 3
                rows.put(
                    net[:, axis],
                    self._com[:, after],
                    -sign * Of("scaled.borne", (slice(None), last)),
                )
                rows.put(
                    net[:, axis],
                    self._com[:, last],
                    sign * Of("scaled.borne", (slice(None), after)),
                )
            rows.right(net, -sign * Of("scaled.twisted"))
        elif self._com is not None:
            rows.put(net[:, 0], self._com[:, 1], -sign * Of("scaled.weight"))
            rows.put(net[:, 1], self._com[:, 0], sign * Of("scaled.weight"))
            if self._layout.pushes:  # −c × (w e_z − F), the part of F
                for row, column, axis, turn in (
                    (0, 2, 1, -1.0),
                    (1, 2, 0, 1.0),
                    (2, 0, 1, 1.0),
                    (2, 1, 0, -1.0),
                ):
                    rows.put(
                        net[:, row],
                        self._com[:, column],
                        sign * turn * Of("scaled.wrench", (slice(None), axis)),
                    )
        for offset in self._offsets:
            rows.right(net, _times(-sign, offset))


def _times(sign: float, values: Of | Fill[Given]) -> Of | Fill[Given]:
    if isinstance(values, Of) or sign > 0.0:
        return sign * values if isinstance(values, Of) else values
    return lambda d: -np.asarray(values(d))


def objective(
    rows: Rows[Given], layout: Layout, body: BodyVariables, toes: FreeToes | None
) -> None:
    """Squared distance of the last COM to the goal and squared steps, in length scales squared (Lin
    et al. §II); and of every COM to the nominal path, which no paper has: without it bodies sink as
    low as legs are long.

    Arguments:
        toes: explicit; None where they are held, and their steps a constant.
    """
    _near(rows, body.com[-1], lambda d: d.scaled.aim.goal, lambda d: d.scaled.goal)
    _near(rows, body.com, lambda d: d.scaled.aim.com_path, lambda d: d.scaled.com)
    rows.square(body.rotation, None, lambda d: d.scaled.aim.tilt / d.scaled.length_m**2)
    if layout.frames > 1:
        rows.square(body.com[1:], body.com[:-1], lambda d: d.scaled.aim.com_step)
    if toes is not None and toes.points is not None and len(layout.moves):
        before, after = toes.points[layout.moves].swapaxes(0, 1)
        rows.square(after, before, lambda d: d.scaled.aim.toe_step)
    if layout.stands:
        _as_it_stands(rows, layout, body, None if toes is None else toes.points)


def _as_it_stands(
    rows: Rows[Given], layout: Layout, body: BodyVariables, points: Index | None
) -> None:
    """weight · Σ ‖p − c − n‖² over every limb that stands.

    Arguments:
        points: columns of the toes, None where they are held.
    """
    frame, _, foothold = layout.standing

    def by(index: Index, count: int, values: Array) -> Array:
        total = np.zeros((count, *values.shape[1:]))
        np.add.at(total, index, values)
        return total

    if points is None:
        each = np.repeat(np.bincount(frame, minlength=layout.frames), 3)

        def away(d: Given) -> Array:
            return np.asarray(d.held.toes[foothold] - d.scaled.standing)

        rows.square(body.com, None, lambda d: np.asarray(d.scaled.aim.stance * each))
        rows.linear(
            body.com,
            lambda d: -2.0 * d.scaled.aim.stance * by(frame, layout.frames, away(d)),
            lambda d: d.scaled.aim.stance * np.sum(away(d) ** 2),
        )
        return
    rows.square(points[foothold], body.com[frame], lambda d: d.scaled.aim.stance)
    rows.linear(
        points,
        lambda d: -2.0 * d.scaled.aim.stance * by(foothold, layout.footholds, d.scaled.standing),
        lambda d: d.scaled.aim.stance * np.sum(d.scaled.standing**2),
    )
    rows.linear(
        body.com, lambda d: 2.0 * d.scaled.aim.stance * by(frame, layout.frames, d.scaled.standing)
    )


def _near(
    rows: Rows[Given], columns: Index, weight: Callable[[Given], float], place: Fill[Given]
) -> None:
    """weight · ‖x − place‖²."""
    rows.square(columns, None, weight)
    rows.linear(
        columns,
        lambda d: -2.0 * weight(d) * np.asarray(place(d)),
        lambda d: weight(d) * np.sum(np.square(place(d))),
    )
