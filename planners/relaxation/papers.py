"""The programs of Lin et al. in cvxpy, as the paper writes them: to read, to run, to change first.

Every equation stands once, for a plan of M frames; a posture is a plan of one. Numbers of a problem
are written right into the terms, and all quantities are non-dimensional (E3, E4; ``scaled``).

    P    E1–E11 as they are, with m = p f (E8), which is bilinear
    P̄    ``p_bar``: P without E8
    P1   ``p1``, ``p1_of_modes``: E8 replaced by McCormick's envelope over a box, or over one of several
    lift ``lift``: P without a box, f split over the corners of its patch
    P2   ``fix_toes``, ``fix_forces``: P with one factor of E8 kept from P1, so that it is linear
    MICP ``micp``: E8 over a grid of small envelopes, one of which is chosen by binaries

MICP is solved as it stands here (``micp``). The others are planned with as blocks of rows
(``equilibrium.rows``), some hundred times as fast; tests hold both equal, row by row.

    p1(Scaled.of(problem), box, soft=True).problem.solve(solver="CLARABEL")
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from ..equilibrium.layout import Index
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..robot.model import turned_most
from .envelope import Envelope
from .mccormick import Axes

Terms = dict[str, cp.Constraint]
"""Constraints by name, with the names, shapes and signs of the groups of rows in ``terms``."""
_Vectors: TypeAlias = cp.Expression | Array
"""A vector a row, shape (n, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """A program: minimise the cost subject to the terms.

    Arguments:
        plan: variables of body and toes.
        products: p, f and m of every stance contact, of programs that have m.
    """

    cost: cp.Expression
    terms: Terms
    plan: PlanVariables
    products: Products | None = None

    @property
    def problem(self) -> cp.Problem:
        """The program as cvxpy solves it."""
        return cp.Problem(cp.Minimize(self.cost), list(self.terms.values()))


def p_bar(scaled: Scaled, *, inner: bool = False) -> Model:
    """P̄: E1–E5, E10 and E11, everything but m = p f (Lin et al. §III). With m free, the moments'
    balance E9 says nothing.

    Arguments:
        scaled: the problem, with any number of candidates.
        inner: see ``on_toes``.

    Returns:
        A model without an objective: where it has no answer, neither has the problem.
    """
    plan = PlanVariables(scaled)
    terms = {**on_toes(plan, inner=inner), **on_forces(ContactForces.of_candidates(plan))}
    return Model(cost=cp.Constant(0.0), terms=terms, plan=plan)


def p1(scaled: Scaled, box: Envelope, *, soft: bool, axes: Axes = "contact") -> Model:
    """P1: P̄ and E9, with m = p f (E8) replaced by its envelope over one box per stance contact
    (Lin et al. §III).

    Arguments:
        soft: the signed margin t, by which every row of the envelope is relaxed, is minimised; else
            the objective.
        axes: of the box's forces (``Products``).

    Raises:
        InvalidInput: for soles.
    """
    plan, products, terms = coupled(scaled, axes)
    if not soft:
        terms |= mccormick(products.parts, box)
        return Model(cost=plan.objective(), terms=terms, plan=plan, products=products)
    margin = cp.Variable(1, name="margin")
    terms |= mccormick(products.parts, box, margin=margin)
    return Model(cost=margin[0], terms=terms, plan=plan, products=products)


def p1_of_modes(
    scaled: Scaled, boxes: Sequence[Envelope], allowed: Array, *, axes: Axes = "contact"
) -> Model:
    """P1 over several boxes, one chosen per stance (Lin et al. §IV-A): the convex hull of the
    choices.

    Each stance has z_e ≥ 0, Σ z = 1; its (p, f, m) is a sum of copies, the e-th in z_e M_c(B_e).

    Arguments:
        allowed: bounds of z, shape (S, E).
    """
    plan, products, terms = coupled(scaled, axes)
    modes = cp.Variable(allowed.shape, name="modes")
    terms |= {
        "one_mode": cp.sum(modes, axis=1) == 1,
        "mode_positive": modes >= 0,
        "mode_allowed": modes <= allowed,
    }
    whole, copies = cp.hstack(products.parts), []
    for e, box in enumerate(boxes):
        copies.append(cp.Variable(whole.shape, name=f"copy_{e}"))
        parts = copies[e][:, :3], copies[e][:, 3:6], copies[e][:, 6:]
        rows = mccormick(parts, box, share=modes[:, e][scaled.layout.contacts[0]])
        terms |= {f"{name}_{e}": row for name, row in rows.items()}
    terms["added"] = sum(copies) - whole == 0
    return Model(cost=plan.objective(), terms=terms, plan=plan, products=products)


def lift(scaled: Scaled, *, least_moment: bool) -> Model:
    """The relaxation without a box: f_u := λ_u f at every vertex, so that Σ p_w × f (E6) is
    Σ_u v_u × f_u, linear (``relaxation.lift``).

    Arguments:
        scaled: with any number of candidates.
        least_moment: minimise the largest component of the moments (E6, E9); else they are zero and
            the objective is the course's. Its optimum is a lower bound on that of the problem.
    """
    plan = PlanVariables(scaled)
    forces = ContactForces.of_vertices(plan)
    moment = plan.net(cross(scaled.bearing_vertices, forces.world), forces.stance)
    return _with_moment(plan, moment, {**on_toes(plan), **on_forces(forces)}, least_moment)


def fix_toes(scaled: Scaled, held: Point, *, hold_body: bool, least_moment: bool) -> Model:
    """P2 with p kept from P1 (fix-p, Lin et al. §IV-A): toes held, with hold_body c and Θ, too.

    Σ f is fixed (E5), so that Σ p × f (E6) is linear in (c, f).

    Arguments:
        held: the point whose toes, and body, are kept; one candidate per foothold.
        least_moment: minimise the moments that are left; else they are zero and the objective is
            the course's.
    """
    plan = PlanVariables(scaled, held.toes)
    forces = ContactForces.of_contacts(scaled)
    moment = plan.net(cross(scaled.bearing_points(held.toes), forces.world), forces.stance)
    body = plan.stays_at(held)
    if not hold_body:
        body = {**plan.within_reach(inner=True), **plan.within_limits(), **plan.steps()}
    return _with_moment(plan, moment, {**on_forces(forces), **body}, least_moment)


def fix_forces(scaled: Scaled, held: Point) -> Model:
    """P2 with f kept from P1 (fix-f, Lin et al. §III): the least moment residual (E6) over toes, c
    and Θ.

    Arguments:
        held: the point whose forces, shape (B, 3), are kept; their frames are those of the chosen
            candidates, so that the forces in the world are kept, too, and p × f is linear in p.
    """
    plan = PlanVariables(scaled)
    stance, _, foothold = scaled.layout.contacts
    offsets = scaled.bearing_points(np.zeros_like(held.toes))
    levers = cross(plan.toes[foothold] + offsets, scaled.in_world(held.forces))
    moment = plan.net(levers, stance)
    return _with_moment(plan, moment, on_toes(plan, inner=True), least_moment=True)


def micp(
    scaled: Scaled,
    breaks: Breaks,
    *,
    axes: Axes = "contact",
    envelope: Envelope | None = None,
    optimise: bool = False,
) -> Model:
    """MICP: P̄ and E9, with m = p f (E8) over a grid of cells that binaries choose among (Lin et al.
    §II and Table II, [11]); which candidate patch a toe takes is binary, too.

    Arguments:
        breaks: where p and f are cut.
        envelope: a box whose envelope is added to the grid, as in Table II.
        optimise: minimise the objective; else a cost with which a first point is found soon.
    """
    plan, products, terms = coupled(scaled, axes)
    cells = Cells(breaks)
    terms |= cells.terms(*products.parts)
    if envelope is not None:
        terms |= mccormick(products.parts, envelope)
    layout = scaled.layout
    chosen = [k for k, p in enumerate(layout.candidate_footholds) if len(layout.corners[p]) > 1]
    if chosen:
        terms["one_patch"] = plan.shares[chosen] == cp.Variable(len(chosen), boolean=True)
    cost = plan.objective() if optimise else cells.spread()
    return Model(cost=cost, terms=terms, plan=plan, products=products)


def coupled(scaled: Scaled, axes: Axes) -> tuple[PlanVariables, Products, Terms]:
    """Variables and terms of P1 and MICP: everything but what stands for m = p f, and the cost.

    Raises InvalidInput for soles.

    Arguments:
        axes: of the forces that the products are taken of, those of contacts or of the world.
    """
    scaled.layout.check_point_feet("envelopes")
    plan = PlanVariables(scaled)
    forces = ContactForces.of_candidates(plan)
    products = Products(plan, forces, axes)
    return plan, products, {**on_toes(plan), **on_forces(forces), **products.terms()}


def on_toes(plan: PlanVariables, *, inner: bool = False) -> Terms:
    """Terms on the toes: patches (E1), reach, limits and steps (E11).

    Arguments:
        inner: of half-spaces of reach, for plans; relaxations have the outer sets.
    """
    return {
        **plan.on_patches(),
        **plan.within_reach(inner=inner),
        **plan.within_limits(),
        **plan.steps(),
    }


def on_forces(forces: ContactForces) -> Terms:
    """Terms on the forces: E5, E10 and their bounds."""
    return {**forces.balance(), **forces.in_cones(), **forces.in_boxes()}


def _with_moment(
    plan: PlanVariables, moment: cp.Expression, terms: Terms, least_moment: bool
) -> Model:
    """Minimise the largest component of the net moments, or the objective where they vanish."""
    if not least_moment:
        return Model(cost=plan.objective(), terms={**terms, "moment": moment == 0}, plan=plan)
    residual, rows = within(moment)
    return Model(cost=residual, terms={**terms, **rows}, plan=plan)


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
        along = cp.sum(cp.multiply(rows[row, :3], apart[which]), axis=1)
        is_apart = apart - self.toes[other] + self.toes[moved] == 0
        return {"apart": is_apart, "relative_reach": along <= rows[row, 3]}

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
    parts: Sequence[_Vectors],
    box: Envelope,
    *,
    share: _Vectors | None = None,
    margin: _Vectors | float = 0,
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


class Breaks(NamedTuple):
    """Breakpoints of every p_j and f_k, rows 3i + j and 3i + k for contact i, and products of each
    two, 9i + 3j + k.

    Numbers, or parameters in their place.
    """

    p: _Vectors
    f: _Vectors
    products: _Vectors

    @classmethod
    def of(cls, domain: Envelope, intervals: int) -> Breaks:
        """The breakpoints that cut the sides of a domain evenly.

        Arguments:
            domain: of [p, f], B contacts.
            intervals: pieces of every p_j and f_k, so that there is one more breakpoint each.
        """
        p, f = (
            np.linspace(low, high, intervals + 1, axis=-1)
            for low, high in (domain.position, domain.force)
        )
        products = p[:, :, None, :, None] * f[:, None, :, None, :]
        rows = 3 * len(p)
        return cls(p.reshape(rows, -1), f.reshape(rows, -1), products.reshape(3 * rows, -1))


class Cells:
    """m = p f (E8) over a grid of McCormick cells, one of which is chosen (Lin et al. §II, [11]).

    Every p_j and f_k is cut into intervals. Over one cell the envelope of m = p f is the hull of
    the four points (p, f, p f) at its corners, so that over the grid

        (p, f, m) = Σ_ab w_ab (P_a, F_b, P_a F_b),   w ≥ 0, Σ w = 1,   α_a = Σ_b w_ab and
        β_b = Σ_a w_ab of type SOS2,

    with breakpoints P_a, F_b: weight lies on one cell's corners only. So do Dai, Izatt and Tedrake
    (2019, [11]) in Drake (``AddBilinearProductMcCormickEnvelopeSos2``). The three products of a p_j
    share its α, those of an f_k its β, so that binaries are per variable and not per cell.

    Arguments:
        breaks: breakpoints; α, β and w have their rows.
    """

    def __init__(self, breaks: Breaks) -> None:
        self._breaks = breaks
        self._alpha, self._beta = (cp.Variable(ends.shape, nonneg=True) for ends in breaks[:2])
        self._corners = cp.Variable(
            breaks.products.shape, nonneg=True
        )  # w_ab in column a (K_f + 1) + b

    def spread(self) -> cp.Expression:
        """Σ of α and β times the squared distance (in intervals) of their breakpoint from the
        middle one.

        Least on neighbours for a given p or f: HiGHS finds them ten times faster than without an
        objective.
        """
        every = (self._alpha, self._beta)
        steps = [np.arange(one.shape[1]) - 0.5 * (one.shape[1] - 1) for one in every]
        return sum(cp.sum(one @ step**2) for one, step in zip(every, steps, strict=True))

    def terms(self, position: cp.Variable, forces: cp.Variable, moments: cp.Variable) -> Terms:
        """(p, f, m) lies in the McCormick envelope of one cell of the grid, chosen by binaries.

        Arguments:
            position, forces: shape (B, 3).
            moments: the products p_j f_k, shape (B, 9).

        Returns:
            Constraints; the weights of every breakpoint and corner are variables of the grid.
        """
        alpha, beta, corners = self._alpha, self._beta, self._corners
        rows, ends = np.arange(alpha.shape[0]), (alpha.shape[1], beta.shape[1])
        of_p, of_f = rows.repeat(3), rows.reshape(-1, 3).repeat(3, axis=0).ravel()
        by_p = corners @ np.kron(np.eye(ends[0]), np.ones((ends[1], 1)))
        by_f = corners @ np.kron(np.ones((ends[0], 1)), np.eye(ends[1]))
        terms: Terms = {
            "one_alpha": cp.sum(alpha, axis=1) == 1,
            "one_beta": cp.sum(beta, axis=1) == 1,
            "by_p": by_p == alpha[of_p],
            "by_f": by_f == beta[of_f],
        }
        for name, weights in (("alpha", alpha), ("beta", beta)):
            sos2 = neighbouring(weights)
            terms |= {f"sos2_{name}_{k}": row for k, row in enumerate(sos2)}
        names, parts = ("on_p", "on_f", "on_m"), (position, forces, moments)
        every = (alpha, beta, corners)
        for name, part, weights, breaks in zip(names, parts, every, self._breaks, strict=True):
            blend = cp.sum(cp.multiply(breaks, weights), axis=1)
            terms[name] = cp.vec(part, order="C") == blend
        return terms


def neighbouring(weights: cp.Variable) -> list[cp.Constraint]:
    """Every row of ``weights``, shape (R, K + 1), is zero but for two neighbours (SOS2), by log2 K
    binaries (Vielma and Nemhauser); one interval needs no row.
    """
    rows, count = weights.shape[0], weights.shape[1] - 1
    if count == 1:
        return []
    bits = count.bit_length() - 1
    code = (
        np.array([k ^ (k >> 1) for k in range(count)])[:, None] >> np.arange(bits) & 1 == 1
    )  # Gray, by digit
    beside = np.stack(
        [code[[0, *range(count)]], code[[*range(count), count - 1]]]
    )  # of both intervals at a breakpoint
    digit = cp.Variable((rows, bits), boolean=True)
    return [weights @ beside.all(axis=0) <= digit, weights @ (~beside).all(axis=0) <= 1 - digit]


def added(values: _Vectors, groups: Index, count: int) -> cp.Expression:
    """Rows added up by group: row g is the sum of the rows whose group is g."""
    member = sp.csr_matrix(
        (np.ones(len(groups)), (groups, np.arange(len(groups)))), shape=(count, len(groups))
    )
    return member @ values


def cross(first: _Vectors, second: _Vectors) -> cp.Expression:
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
