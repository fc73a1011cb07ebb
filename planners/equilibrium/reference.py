"""Lin et al.'s convex models in cvxpy: what to read, and what to change first.

Each model is a short list of terms (``equations``) with a problem's numbers written into it. The
programs that plan say the same as blocks of rows (``rows``, ``terms``), some hundred times as fast;
a test holds them equal. ``Programs(engine="cvxpy")`` solves these models in their place.
"""

from __future__ import annotations

from collections.abc import Sequence

import cvxpy as cp
import numpy as np

from ..files.arrays import Array
from .equations import (
    Axes,
    ContactBox,
    ContactForces,
    PlanVariables,
    Products,
    added,
    cross,
    mccormick,
    rotated,
    within,
)
from .model import ConicModel, Terms
from .scaled import Point, Scaled


def without_moments(scaled: Scaled, *, inner: bool = False) -> ConicModel:
    """P̄: everything but m = p f (Lin et al. §III); with m free, the moments' balance E9 says
    nothing.

    Arguments:
        scaled: the problem, with any number of candidates.
        inner: see ``_on_toes``.

    Returns:
        A model without an objective: where it has no answer, neither has the problem.
    """
    plan = PlanVariables(scaled)
    forces = ContactForces.of_candidates(plan)
    return ConicModel(cp.Constant(0.0), {**_on_toes(plan, inner=inner), **_on_forces(forces)})


def p1(scaled: Scaled, box: ContactBox, *, soft: bool, axes: Axes = "contact") -> ConicModel:
    """P1: m = p f replaced by its envelope over one box a stance contact (§III).

    Arguments:
        soft: the signed margin t, by which every row of the envelope is relaxed, is minimised; else
            the objective.
        axes: of the box's forces (``Products``).
    """
    plan, products, terms = coupled(scaled, axes)
    if not soft:
        return ConicModel(plan.objective(), {**terms, **mccormick(products.parts, box)})
    margin = cp.Variable(1, name="margin")
    return ConicModel(margin[0], {**terms, **mccormick(products.parts, box, margin=margin)})


def joint(
    scaled: Scaled, box: ContactBox, about: Point | None, *, price: float | None
) -> ConicModel:
    """The lift and P1 over a box, linked in all nine components of Σ p fᵀ (``relaxation.joint``).

    Arguments:
        about, price: where the gap is linearised, and the price of the margin beside it; None: the
            signed margin alone.
    """
    scaled.layout.check_point_feet("envelopes")
    plan = PlanVariables(scaled)
    layout, forces = plan.layout, ContactForces.of_vertices(plan)
    stance, count = layout.contacts[0], len(layout.stances)
    contact, vertex = layout.contact_vertices
    products = Products(plan, forces, "contact")
    margin = cp.Variable(1, name="margin")
    com = plan.com[layout.stance_frames]
    linked = []
    for j in range(3):  # of p; the rows are the axes of R f
        lifted = added(
            cp.multiply(scaled.vertices[vertex][:, j : j + 1], forces.world), stance[contact], count
        )
        relaxed = rotated(scaled.contact_frames, products.parts[2][:, 3 * j : 3 * j + 3])
        linked.append(
            lifted - added(relaxed, stance, count) - cp.multiply(com[:, j : j + 1], scaled.borne)
        )
    moment = plan.net(cross(scaled.bearing_vertices, forces.world), forces.stance)
    terms = {
        **_on_toes(plan),
        **_on_forces(forces),
        **products.sums(),
        "moment": moment == 0,
        "linked": cp.hstack(linked) == 0,
        **mccormick(products.parts, box, margin=margin),
    }
    if about is None or price is None:
        return ConicModel(margin[0], terms)
    gap, is_gap = _gap(plan, forces, about)
    return ConicModel(price * margin[0] + gap, {**terms, **is_gap, "margin_positive": -margin <= 0})


def p1_of_modes(
    scaled: Scaled, boxes: Sequence[ContactBox], allowed: Array, *, axes: Axes = "contact"
) -> ConicModel:
    """P1 over several boxes, one chosen a stance (§IV-A): the convex hull of the choices.

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
    return ConicModel(plan.objective(), {**terms, "added": sum(copies) - whole == 0})


def lift(scaled: Scaled, *, least_moment: bool) -> ConicModel:
    """The lift: f_u := λ_u f at every vertex, so that Σ p_w × f is Σ_u v_u × f_u, linear
    (``relaxation.lift``).

    Arguments:
        scaled: with any number of candidates.
        least_moment: minimise the largest component of the moments (E6, E9); else they are zero and
            the objective is the course's. Its optimum is a lower bound on that of the problem.
    """
    plan = PlanVariables(scaled)
    forces = ContactForces.of_vertices(plan)
    moment = plan.net(cross(scaled.bearing_vertices, forces.world), forces.stance)
    return _with_moment(plan, moment, {**_on_toes(plan), **_on_forces(forces)}, least_moment)


def least_gap(scaled: Scaled, about: Point) -> ConicModel:
    """The lift with the least gap Σ_u (v_u − p̂)(f_u − λ_u f̂)ᵀ of its products from p fᵀ,
    linearised at (p̂, f̂).

    Arguments:
        scaled: one candidate a foothold.
        about: the point that has p̂ and f̂.

    Returns:
        The model of least Σ g² over all nine components of every stance contact, moments being
        zero.
    """
    plan = PlanVariables(scaled)
    forces = ContactForces.of_vertices(plan)
    moment = plan.net(cross(scaled.bearing_vertices, forces.world), forces.stance)
    cost, terms = _gap(plan, forces, about)
    return ConicModel(
        cost, {**_on_toes(plan, inner=True), **_on_forces(forces), **terms, "moment": moment == 0}
    )


def fix_toes(scaled: Scaled, held: Point, *, hold_body: bool, least_moment: bool) -> ConicModel:
    """Toes held, with hold_body c and Θ, too (fix-p, Lin et al. §IV-A). Σ f is fixed, so that Σ p ×
    f is linear in (c, f).

    Arguments:
        held: the point whose toes, and body, are kept; one candidate a foothold.
        least_moment: minimise the moments that are left; else they are zero and the objective is
            the course's.
    """
    plan = PlanVariables(scaled, held.toes)
    forces = ContactForces.of_contacts(scaled)
    moment = plan.net(cross(scaled.bearing_points(held.toes), forces.world), forces.stance)
    body = plan.stays_at(held)
    if not hold_body:
        body = {**plan.within_reach(inner=True), **plan.within_limits(), **plan.steps()}
    return _with_moment(plan, moment, {**_on_forces(forces), **body}, least_moment)


def fix_forces(scaled: Scaled, held: Point) -> ConicModel:
    """Contact-frame forces held (fix-f, Lin et al. §II): the least moment residual over toes, c and
    Θ.

    Arguments:
        held: the point whose forces, shape (B, 3), are kept; their frames are those of the chosen
            candidates, so that the forces in the world are kept, too, and p × f is linear in p.
    """
    plan = PlanVariables(scaled)
    stance, _, foothold = scaled.layout.contacts
    offsets = scaled.bearing_points(np.zeros_like(held.toes))
    levers = cross(plan.toes[foothold] + offsets, scaled.in_world(held.forces))
    moment = plan.net(levers, stance)
    return _with_moment(plan, moment, _on_toes(plan, inner=True), least_moment=True)


def linearised(scaled: Scaled, about: Point, *, price: float | None) -> ConicModel:
    """A step of SCP: p × F is replaced by p̄ × F + (p − p̄) × F̄ about a point (p̄, F̄), in every
    stance.

    Arguments:
        about: that point; one candidate a foothold.
        price: of the largest moment that is left, beside the objective; None minimises it alone.
    """
    plan, foothold = PlanVariables(scaled), scaled.layout.contacts[2]
    forces, before = ContactForces.of_contacts(scaled), scaled.in_world(about.forces)
    moved = cross(scaled.bearing_points(about.toes), forces.world)
    moved += cross(plan.toes[foothold] - about.toes[foothold], before)
    moment = plan.net(moved, forces.stance)
    residual, terms = within(moment)
    cost = residual if price is None else plan.objective() + price * residual
    return ConicModel(cost, {**terms, **_on_toes(plan, inner=True), **_on_forces(forces)})


def positions(scaled: Scaled) -> ConicModel:
    """Body and toes without forces, as a decoupled planner chooses them first."""
    plan = PlanVariables(scaled)
    return ConicModel(plan.objective(), _on_toes(plan, inner=True))


def coupled(scaled: Scaled, axes: Axes) -> tuple[PlanVariables, Products, Terms]:
    """Common part of P1 and the mixed-integer program: everything but what stands for m = p f, and
    the cost.

    Arguments:
        axes: of the forces that the products are taken of, those of contacts or of the world.

    Returns:
        The variables of body and toes, those of p, f and m, and the constraints by name.

    Raises:
        InvalidInput: for soles.
    """
    scaled.layout.check_point_feet("envelopes")
    plan = PlanVariables(scaled)
    forces = ContactForces.of_candidates(plan)
    products = Products(plan, forces, axes)
    return plan, products, {**_on_toes(plan), **_on_forces(forces), **products.terms()}


def _on_toes(plan: PlanVariables, *, inner: bool = False) -> Terms:
    """Terms on the toes: patches, reach, limits and steps.

    Arguments:
        inner: of half-spaces of reach, for plans; relaxations have the outer sets.
    """
    return {
        **plan.on_patches(),
        **plan.within_reach(inner=inner),
        **plan.within_limits(),
        **plan.steps(),
    }


def _on_forces(forces: ContactForces) -> Terms:
    return {**forces.balance(), **forces.in_cones(), **forces.in_boxes()}


def _gap(plan: PlanVariables, forces: ContactForces, about: Point) -> tuple[cp.Expression, Terms]:
    """Σ g² and what g is, g_jk of a stance contact in the column 3j + k."""
    layout = plan.layout
    contact, vertex = layout.contact_vertices
    arms = plan.scaled.vertices[vertex] - about.toes[layout.contacts[2][contact]]
    off = forces.forces - cp.multiply(plan.weights[vertex][:, None], about.forces[contact])
    products = cp.hstack([cp.multiply(arms[:, j : j + 1], off) for j in range(3)])
    gap = cp.Variable((len(layout.contacts[0]), 9), name="gap")
    return cp.sum_squares(gap), {
        "gap": added(products, contact, len(layout.contacts[0])) - gap == 0
    }


def _with_moment(
    plan: PlanVariables, moment: cp.Expression, terms: Terms, least_moment: bool
) -> ConicModel:
    """Minimise the largest component of the net moments, or the objective where they vanish."""
    if not least_moment:
        return ConicModel(plan.objective(), {**terms, "moment": moment == 0})
    residual, rows = within(moment)
    return ConicModel(residual, {**terms, **rows})
