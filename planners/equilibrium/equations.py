"""Lin et al.'s equations in cvxpy, one each, for a plan of M frames; a posture is a plan of one.
See ``reference``.

The numbers of a problem are written right into the terms, which have the names, shapes and signs of
the groups of rows in ``terms``. All quantities are non-dimensional (E3, E4; ``scaled``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypeAlias

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from ..files.arrays import Array
from ..robot.reach import turned_most
from .layout import Index
from .model import Terms
from .scaled import Point, Scaled

Vectors: TypeAlias = cp.Expression | Array
"""A vector a row, shape (n, 3)."""


Axes = Literal["contact", "world"]


class ContactBox(Protocol):
    """Bounds on [p, f] of every stance contact: p in world axes, f in those that the model is asked
    for.
    """

    @property
    def low(self) -> Array:
        """Shape (B, 6)."""
        ...

    @property
    def high(self) -> Array:
        """Shape (B, 6)."""
        ...


class PlanVariables:
    """c and Θ of every frame, (M, 3) each, and where the toes are: λ of every vertex, (V,); or
    held, (P, 3).
    """

    def __init__(self, scaled: Scaled, held: Array | None = None) -> None:
        self.scaled, self.layout, self._held = scaled, scaled.layout, held
        self.com = cp.Variable((self.layout.frames, 3), name="com")
        self.rotation = cp.Variable((self.layout.frames, 3), name="rotation")
        self.weights = cp.Variable(len(self.layout.vertex_footholds), name="weights")

    @property
    def toes(self) -> Any:
        """p_w = Σ_u λ_u v_u of every foothold, over all of its candidates (E1); or held; shape (P,
        3).
        """
        if self._held is not None:
            return self._held
        parts = cp.multiply(self.weights[:, None], self.scaled.vertices)
        return added(parts, self.layout.vertex_footholds, self.layout.footholds)

    @property
    def shares(self) -> cp.Expression:
        """z = Σ_u λ_u of every candidate: 1 where it is all that its foothold has, shape (K,)."""
        return added(
            self.weights, self.layout.vertex_candidates, len(self.layout.candidate_footholds)
        )

    @property
    def legs(self) -> cp.Expression:
        """p = p_w − c of every stance contact (E2), shape (B, 3)."""
        stance, _, foothold = self.layout.contacts
        return self.toes[foothold] - self.com[self.layout.stance_frames[stance]]

    def on_patches(self) -> Terms:
        """Σ λ_u = 1, λ ≥ 0 (E1)."""
        one = added(self.weights, self.layout.vertex_footholds, self.layout.footholds)
        return {"one": one == 1, "positive": self.weights >= 0}

    def within_reach(self, *, inner: bool = False) -> Terms:
        """‖p_w − c − (I + [Θ]×) v‖ ≤ Δ_FK wherever a limb stands (E11), the rotation linearised.

        Of half-spaces of reach the outer set, or the inner one (``robot.reach``).
        """
        frame, limb, foothold = self.layout.standing
        shoulders = self.scaled.shoulders[limb]
        hips = self.com[frame] + shoulders + cross(self.rotation[frame], shoulders)
        legs = self.toes[foothold] - hips
        ball = {"reach": cp.SOC(self.scaled.reach[limb], legs, axis=1)}
        return {**ball, **self._half_spaces(inner)} if self.layout.reach_rows else ball

    def _half_spaces(self, inner: bool) -> Terms:
        """a·d + Θ·(a × s) ≤ b + t(a) (ρ + t(s)), or a·d + Θ·(a × z) + t(a) ‖a × (d − z)‖ ≤ b, with
        d = p_w − c.
        """
        (frame, _, foothold), (which, row) = self.layout.standing, self.layout.standing_rows
        rows, limb = self.scaled.half_spaces, self.layout.row_limbs[row]
        leg = cp.Variable((len(frame), 3), name="leg")
        is_leg = leg - self.toes[foothold] + self.com[frame] == 0
        normals, legs, turn = rows.normals[row], leg[which], self.rotation[frame[which]]
        along = cp.sum(cp.multiply(normals, legs), axis=1)
        if inner and not self.layout.level:
            room = rows.bounds[row] - along - cp.sum(cp.multiply(rows.levers[row], turn), axis=1)
            arms = [cp.sum(cp.multiply(rows.arms[row, k], legs), axis=1) for k in (0, 1)]
            across = cp.vstack(arms).T - rows.offsets[row]
            return {"leg": is_leg, "reach_rows": cp.SOC(room, across, axis=1)}
        shoulders = self.scaled.shoulders[limb]
        turned = cp.sum(cp.multiply(np.cross(normals, shoulders), turn), axis=1)
        most = turned_most(normals, self.scaled.tilt)
        far = self.scaled.reach[limb] + turned_most(shoulders, self.scaled.tilt)
        return {"leg": is_leg, "reach_rows": along + turned <= rows.bounds[row] + most * far}

    def within_limits(self) -> Terms:
        """‖c − c_nominal‖ ≤ radius, |Θ| ≤ tilt."""
        return {
            "ball": cp.SOC(self.scaled.com_radius, self.com - self.scaled.com, axis=1),
            "tilted": self.rotation <= self.scaled.tilt,
            "tilted_back": -self.rotation <= self.scaled.tilt,
        }

    def steps(self) -> Terms:
        """‖c[r] − c[r−1]‖, ‖Θ[r] − Θ[r−1]‖, ‖p_i[r] − p_i[r−1]‖ ≤ Δ_max (E11), and progress along
        the nominal path.
        """
        if self.layout.frames == 1:
            return {}
        com, toe, rotation = self.scaled.steps
        ones, moves = np.ones(self.layout.frames - 1), len(self.layout.moves)
        moved = cp.diff(self.com, axis=0)
        terms: Terms = {
            "com_step": cp.SOC(com * ones, moved, axis=1),
            "rotation_step": cp.SOC(rotation * ones, cp.diff(self.rotation, axis=0), axis=1),
            "progress": cp.sum(cp.multiply(self.scaled.direction, moved), axis=1)
            >= self.scaled.progress,
        }
        if self.layout.linear:
            turned = cp.diff(self.rotation, axis=0)
            along = [
                rows[:, :3] @ moved[k] + rows[:, 3:6] @ turned[k] - rows[:, 6]
                for k, rows in enumerate(self.scaled.linear)
            ]
            terms["linear_step"] = cp.hstack(along) <= 0.0
        if moves and self._held is None:
            terms["toe_step"] = cp.SOC(toe * np.ones(moves), self.toe_steps, axis=1)
            terms |= self.within_relative_reach()
        return terms

    def within_relative_reach(self) -> Terms:
        """a·(p_other − p_limb) ≤ b of every limb that moves (``robot.reach``)."""
        (row, which), (moved, other, _) = self.layout.relative_rows, self.layout.relative_pairs.T
        if not len(row):
            return {}
        apart, rows = cp.Variable((len(moved), 3), name="apart"), self.scaled.relative
        along = cp.sum(cp.multiply(rows.normals[row], apart[which]), axis=1)
        is_apart = apart - self.toes[other] + self.toes[moved] == 0
        return {"apart": is_apart, "relative_reach": along <= rows.bounds[row]}

    def stays_at(self, point: Point) -> Terms:
        """c and Θ are those of the point."""
        return {"held_com": self.com == point.com, "held_rotation": self.rotation == point.rotation}

    @property
    def toe_steps(self) -> cp.Expression:
        """p_i[r] − p_i[r−1] of every toe that moves."""
        before, after = self.layout.moves.T
        return self.toes[after] - self.toes[before]

    def net(self, moments: cp.Expression, stance: Index) -> cp.Expression:
        """Net moment about c of every stance (E6), shape (S, 3), from the moments p_w × f about the
        origin.

        Σ f is fixed to the weight (E5), so that it is Σ p_w × f − c × w e_z, linear in c; with a
        force F and a moment M on the body Σ p_w × f − c × (w e_z − F) + M.
        """
        borne = _borne(self.scaled)
        total = added(moments, stance, len(self.layout.stances)) - cross(
            self.com[self.layout.stance_frames], borne
        )
        return total + self.scaled.wrench[:, 3:] if self.layout.loaded else total

    def objective(self) -> cp.Expression:
        """Σ of squares: the last c to the goal, c to its nominal path, Θ, and the steps of c and of
        the toes (§II).
        """
        aim = self.scaled.aim
        cost = aim.goal * cp.sum_squares(self.com[-1] - self.scaled.goal)
        cost += aim.com_path * cp.sum_squares(self.com - self.scaled.com)
        cost += aim.tilt / self.scaled.length_m**2 * cp.sum_squares(self.rotation)
        if self.layout.frames > 1:
            cost += aim.com_step * cp.sum_squares(cp.diff(self.com, axis=0))
        if len(self.layout.moves) and self._held is None:
            cost += aim.toe_step * cp.sum_squares(self.toe_steps)
        if self.layout.stands:
            frame, _, foothold = self.layout.standing
            cost += aim.stance * cp.sum_squares(
                self.toes[foothold] - self.com[frame] - self.scaled.standing
            )
        return cost


class ContactForces:
    """Forces f_n, f_y, f_z (E3), n of them: of which stance contact, on which candidate, how large
    a share of it.
    """

    def __init__(
        self, scaled: Scaled, contact: Index, candidate: Index, share: cp.Expression | Array
    ) -> None:
        self._scaled, self.contact, self._candidate, self._share = scaled, contact, candidate, share
        self.stance = scaled.layout.contacts[0][contact]
        self.forces = cp.Variable((len(contact), 3), name="forces")
        self.world = rotated(scaled.frames[candidate], self.forces)

    @classmethod
    def of_contacts(cls, scaled: Scaled) -> ContactForces:
        """One a stance contact, one candidate a foothold."""
        foothold = scaled.layout.contacts[2]
        return cls(scaled, np.arange(len(foothold)), foothold, np.ones(len(foothold)))

    @classmethod
    def of_candidates(cls, plan: PlanVariables) -> ContactForces:
        """One for every candidate under a stance contact, as large as its share z, which is 1 of
        one candidate.
        """
        if len(plan.layout.candidate_footholds) == plan.layout.footholds:
            return cls.of_contacts(plan.scaled)
        contact, candidate = plan.layout.contact_candidates
        return cls(plan.scaled, contact, candidate, plan.shares[candidate])

    @classmethod
    def of_vertices(cls, plan: PlanVariables) -> ContactForces:
        """f_u := λ_u f of every vertex under a stance contact: what the lift has."""
        contact, vertex = plan.layout.contact_vertices
        return cls(
            plan.scaled, contact, plan.layout.vertex_candidates[vertex], plan.weights[vertex]
        )

    def in_cones(self) -> Terms:
        """√(f_y² + f_z²) ≤ μ f_n (E10)."""
        friction = self._scaled.friction[self._candidate]
        return {
            "cone": cp.SOC(cp.multiply(friction, self.forces[:, 0]), self.forces[:, 1:], axis=1)
        }

    def in_boxes(self) -> Terms:
        """Share · f_min ≤ f ≤ share · f_max."""
        low, high = self._scaled.force_min[self.contact], self._scaled.force_max[self.contact]
        share = self._share[:, None]
        return {
            "most": self.forces <= cp.multiply(share, high),
            "least": cp.multiply(share, low) <= self.forces,
        }

    def balance(self) -> Terms:
        """Σ f = w e_z in every stance (E5), less the force on the body."""
        borne = _borne(self._scaled)
        return {
            "balance": added(self.world, self.stance, len(self._scaled.layout.stances)) - borne == 0
        }


def _borne(scaled: Scaled) -> Any:
    """The sum of the contacts' forces in every stance, shape (S, 3): the weight, less the force on
    the body, both of which may be parameters.
    """
    weight = scaled.weight * np.tile([0.0, 0.0, 1.0], (len(scaled.layout.stances), 1))
    return weight - scaled.wrench[:, :3] if scaled.layout.loaded else weight


def within(moment: cp.Expression) -> tuple[cp.Expression, Terms]:
    """The residual s ≥ 0 that is at least every component of a net moment, and its terms."""
    residual = cp.Variable(1, name="residual")
    terms = {"above": moment <= residual, "below": -moment <= residual, "residual": residual >= 0}
    return residual[0], terms


class Products:
    """m = p f of every stance contact as a variable (E8): m_jk in the column 3j + k, shape (B, 9).

    Arguments:
        axes: of f: the frame of a contact's first candidate, which is all candidates' where there
            are several; or the world's, in which candidates of different slopes can be compared.
    """

    def __init__(self, plan: PlanVariables, forces: ContactForces, axes: Axes) -> None:
        layout, self._twisted = (
            plan.layout,
            plan.scaled.wrench[:, 3:] if plan.layout.loaded else None,
        )
        self._layout = layout
        contacts, first = (
            len(layout.contacts[0]),
            np.searchsorted(layout.candidate_footholds, layout.contacts[2]),
        )
        self._axes = (
            np.tile(np.eye(3), (contacts, 1, 1)) if axes == "world" else plan.scaled.frames[first]
        )
        self.position = cp.Variable((contacts, 3), name="position")
        self.forces, self.moments = forces.forces, cp.Variable((contacts, 9), name="moments")
        self._sums: Terms = {"legs": self.position == plan.legs}
        if axes == "world" or len(forces.contact) > contacts:
            self.forces = cp.Variable((contacts, 3), name="box_forces")
            total = added(forces.world, forces.contact, contacts)
            self._sums["turned"] = self.forces == rotated(self._axes.transpose(0, 2, 1), total)
        self.parts = (self.position, self.forces, self.moments)
        self.world = rotated(self._axes, self.forces)

    def sums(self) -> Terms:
        """p = p_w − c (E2), and f in its axes."""
        return dict(self._sums)

    def terms(self) -> Terms:
        """The sums, and Σ m = 0 in every stance (E9), or −M with a moment M on the body."""
        by_p = [rotated(self._axes, self.moments[:, 3 * j : 3 * j + 3]) for j in range(3)]  # p_j F
        moment = cp.vstack([by_p[i][:, j] - by_p[j][:, i] for i, j in ((1, 2), (2, 0), (0, 1))]).T
        net = added(moment, self._layout.contacts[0], len(self._layout.stances))
        return {
            **self._sums,
            "moment": net + self._twisted == 0 if self._layout.loaded else net == 0,
        }


def mccormick(
    parts: Sequence[Vectors],
    box: ContactBox,
    *,
    share: Vectors | None = None,
    margin: Vectors | float = 0,
) -> Terms:
    """(p, f, m) ∈ z M_c(B) up to t: the envelope of m_jk = p_j f_k over a box, and the box itself
    (§III).

    Arguments:
        share: z of every stance contact, shape (B,); None for 1.
        margin: t.
    """
    position, forces, moments = parts
    one = np.ones((len(box.low), 1)) if share is None else share[:, None]
    over_j, over_k = (
        np.kron(np.eye(3), np.ones((1, 3))),
        np.kron(np.ones((1, 3)), np.eye(3)),
    )  # to the columns 3j + k

    def plane(p: Array, f: Array) -> cp.Expression:
        """P f + p F − P F, which touches p f at (P, F)."""
        p, f = p @ over_j, f @ over_k
        return (
            cp.multiply(p, forces @ over_k)
            + cp.multiply(f, position @ over_j)
            - cp.multiply(one, p * f)
        )

    (p_low, f_low), (p_high, f_high) = ((end[:, :3], end[:, 3:]) for end in (box.low, box.high))
    below, above = (
        (plane(p_low, f_low), plane(p_high, f_high)),
        (plane(p_low, f_high), plane(p_high, f_low)),
    )
    at = cp.hstack([position, forces])
    return {
        "envelope": cp.vstack(
            [*(side - moments for side in below), *(moments - side for side in above)]
        )
        <= margin,
        "sides": cp.vstack([cp.multiply(one, box.low) - at, at - cp.multiply(one, box.high)])
        <= margin,
    }


def added(values: Vectors, groups: Index, count: int) -> cp.Expression:
    """Rows added up by group: row g is the sum of the rows whose group is g."""
    member = sp.csr_matrix(
        (np.ones(len(groups)), (groups, np.arange(len(groups)))), shape=(count, len(groups))
    )
    return member @ values


def cross(first: Vectors, second: Vectors) -> cp.Expression:
    """a × b, row by row; one of them is data."""
    pairs = ((1, 2), (2, 0), (0, 1))
    parts = [
        cp.multiply(first[:, i], second[:, j]) - cp.multiply(first[:, j], second[:, i])
        for i, j in pairs
    ]
    return cp.vstack(parts).T


def rotated(rotations: Array, vectors: cp.Expression) -> cp.Expression:
    """R v, row by row.

    Arguments:
        rotations: shape (n, 3, 3).
    """
    return cp.vstack([cp.sum(cp.multiply(rotations[:, k], vectors), axis=1) for k in range(3)]).T
