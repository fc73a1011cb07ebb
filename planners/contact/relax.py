"""P̄ and P1: the posture problem without its bilinear constraint, and with McCormick envelopes in its place.

P1 is kept in signed-margin form: minimise t with every envelope row relaxed by t. The margin t is defined wherever P̄
has an answer; t ≤ 0 says that P1 is feasible and t > 0 that it is not, and by how much. Its multipliers give the exact
derivative of t in every bound of the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from .envelope import Envelope
from .project import Point
from .scaled import ScaledProblem, side_by_side, skew
from .terms import Body, Equilibrium, Forces, Toes

FEASIBLE_MARGIN = 1e-7
"""A margin up to this counts as feasible: the solver's own tolerance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RelaxationAnswer:
    """One solve of P1 over one box.

    margin: t; inf where already P̄ is infeasible, NaN where the solver gave up. chosen: which envelope of a set.
    point: the relaxation's answer, off the bilinear surface by ``gap`` = max |m − p f|; None without an answer.
    gradient: (∂t/∂low, ∂t/∂high), each of shape (N, 6), where asked for.
    """

    margin: float
    point: Point | None = None
    gap: float = float("nan")
    chosen: int = 0
    seconds: float = 0.0
    gradient: tuple[Array, Array] | None = None

    @property
    def feasible(self) -> bool:
        """Whether P1 admits the problem. False also where nothing is known: see ``known``."""
        return self.margin <= FEASIBLE_MARGIN

    @property
    def known(self) -> bool:
        """Whether the solver came to an end."""
        return not np.isnan(self.margin)


class PostureWithoutMoment:
    """P̄ (paper E §III): all constraints but the bilinear one. With m free, eq. 9 constrains nothing."""

    def __init__(self, contacts: int, vertices: int) -> None:
        terms = _Posture(contacts, vertices)
        self._model = ConicModel(
            cp.Problem(cp.Minimize(0), terms.constraints),
            equilibrate=ScaledProblem.typical(contacts, vertices).values(),
        )

    def solve(self, scaled: ScaledProblem) -> Point | None:
        """A point of P̄ in the middle of its feasible set, or None where there is none or the solver gave up."""
        solution = self._model.solve(scaled.values())
        return _point(self._model, solution, scaled)[0] if solution.status is ConicStatus.SOLVED else None


class McCormick:
    """P1 over one box, for N contacts and U vertices a patch, compiled."""

    def __init__(self, contacts: int, vertices: int) -> None:
        terms = _Posture(contacts, vertices)
        moments = cp.Variable((contacts, 9), name="moments")  # m_jk in column 3j + k (eq. 8)
        axes = cp.Parameter((3, 9 * contacts), name="moment_axes")
        margin = cp.Variable(name="margin")
        position = cp.Variable((contacts, 3), name="position")
        legs = terms.toes.position() - cp.vstack([terms.body.com] * contacts)  # p of eq. 2
        envelope = mccormick_rows(position, terms.forces.forces, moments, margin)
        constraints = [*terms.constraints, position == legs, axes @ cp.vec(moments, order="C") == 0, *envelope]
        typical = ScaledProblem.typical(contacts, vertices)
        box = Envelope(low=-np.ones((contacts, 6)), high=np.ones((contacts, 6)))
        self.problem = cp.Problem(cp.Minimize(margin), constraints)
        self.model = ConicModel(self.problem, equilibrate=p1_values(typical, box))

    def solve(self, scaled: ScaledProblem, envelope: Envelope, *, gradient: bool = False) -> RelaxationAnswer:
        """Signed margin of the problem over this box."""
        solution = self.model.solve(p1_values(scaled, envelope))
        if solution.status is not ConicStatus.SOLVED:
            infeasible = solution.status is ConicStatus.INFEASIBLE
            return RelaxationAnswer(margin=float("inf") if infeasible else float("nan"), seconds=solution.seconds)
        point, position = _point(self.model, solution, scaled)
        product = (position[:, :, None] * point.forces[:, None, :]).reshape(-1, 9)
        return RelaxationAnswer(
            margin=float(self.model.value("margin", solution)),
            point=point,
            gap=float(np.max(np.abs(self.model.value("moments", solution) - product))),
            seconds=solution.seconds,
            gradient=self._gradient(solution, envelope) if gradient else None,
        )

    def solve_any(self, scaled: ScaledProblem, envelopes: Sequence[Envelope]) -> RelaxationAnswer:
        """P1 with one binary an envelope: the box of least margin. One posture has few boxes, so each is tried."""
        best: RelaxationAnswer | None = None
        for index, envelope in enumerate(envelopes):
            answer = self.solve(scaled, envelope)
            if best is None or np.isnan(best.margin) or answer.margin < best.margin:
                best = RelaxationAnswer(
                    margin=answer.margin, point=answer.point, gap=answer.gap, chosen=index, seconds=answer.seconds
                )
        assert best is not None
        return best

    def _gradient(self, solution: ConicSolution, envelope: Envelope) -> tuple[Array, Array]:
        """∂t/∂low and ∂t/∂high: the envelope theorem, with the chain rule through the products of bounds."""
        names = ("p_low", "p_high", "f_low", "f_high", "low_low", "high_high", "low_high", "high_low")
        by = self.model.gradient(solution, names)
        (p_low, p_high), (f_low, f_high) = envelope.position, envelope.force
        ll, hh, lh, hl = (by[name].reshape(-1, 3, 3) for name in names[4:])  # rows j of p, columns k of f
        low = [
            by["p_low"] + _over_f(ll, f_low) + _over_f(lh, f_high),
            by["f_low"] + _over_p(ll, p_low) + _over_p(hl, p_high),
        ]
        high = [
            by["p_high"] + _over_f(hh, f_high) + _over_f(hl, f_low),
            by["f_high"] + _over_p(hh, p_high) + _over_p(lh, p_low),
        ]
        return np.concatenate(low, axis=1), np.concatenate(high, axis=1)


def _over_f(by_product: Array, force: Array) -> Array:
    """Chain rule of p_j f_k into p_j."""
    return np.asarray(np.einsum("njk,nk->nj", by_product, force))


def _over_p(by_product: Array, position: Array) -> Array:
    """Chain rule of p_j f_k into f_k."""
    return np.asarray(np.einsum("njk,nj->nk", by_product, position))


def mccormick_rows(
    position: cp.Expression, forces: cp.Expression, moments: cp.Expression, margin: cp.Expression | float
) -> list[cp.Constraint]:
    """M_c(B) ≤ t: the four envelope rows of every m_jk = p_j f_k, and [p, f] ∈ B, relaxed by the margin t.

    position, forces: shape (N, 3); moments: shape (N, 9). The box and the products of its bounds are parameters, see
    ``box_values``.
    """
    contacts = position.shape[0]
    p_low, p_high = (cp.Parameter((contacts, 3), name=f"p_{end}") for end in ("low", "high"))
    f_low, f_high = (cp.Parameter((contacts, 3), name=f"f_{end}") for end in ("low", "high"))
    ends = ("low_low", "high_high", "low_high", "high_low")  # of p and of f
    low_low, high_high, low_high, high_low = (cp.Parameter((contacts, 9), name=name) for name in ends)
    rows = np.kron(np.eye(3), np.ones((1, 3)))  # repeats p_j over the columns 3j + k
    columns = np.kron(np.ones((1, 3)), np.eye(3))  # repeats f_k
    p, f = position @ rows, forces @ columns

    def product(p_end: cp.Parameter, f_end: cp.Parameter, both: cp.Parameter) -> cp.Expression:
        return cp.multiply(p_end @ rows, f) + cp.multiply(f_end @ columns, p) - both

    return [
        product(p_low, f_low, low_low) - moments <= margin,
        product(p_high, f_high, high_high) - moments <= margin,
        moments - product(p_low, f_high, low_high) <= margin,
        moments - product(p_high, f_low, high_low) <= margin,
        p_low - position <= margin,
        position - p_high <= margin,
        f_low - forces <= margin,
        forces - f_high <= margin,
    ]


def box_values(envelope: Envelope) -> dict[str, Array | float]:
    """Data of ``mccormick_rows``."""
    (p_low, p_high), (f_low, f_high) = envelope.position, envelope.force

    def products(p: Array, f: Array) -> Array:
        return (p[:, :, None] * f[:, None, :]).reshape(-1, 9)

    return {
        "p_low": p_low, "p_high": p_high, "f_low": f_low, "f_high": f_high,
        "low_low": products(p_low, f_low), "high_high": products(p_high, f_high),
        "low_high": products(p_low, f_high), "high_low": products(p_high, f_low),
    }  # fmt: skip


def p1_values(scaled: ScaledProblem, envelope: Envelope) -> dict[str, Array | float]:
    """Data of P1: P_j × F_k of eq. 9 is the column 9i + 3j + k of the moment axes, and k of [P_j]× R_WC."""
    axes = side_by_side(np.matmul(skew(np.eye(3)), scaled.frames[:, None]))
    return scaled.values() | {"moment_axes": axes} | box_values(envelope)


class _Posture:
    """The terms of P̄."""

    def __init__(self, contacts: int, vertices: int) -> None:
        self.body, self.toes, self.forces = Body(contacts), Toes(contacts, vertices), Forces(contacts)
        self.constraints = [
            Equilibrium(3 * contacts).of_forces(self.forces.flat()),
            self.forces.in_cones(),
            *self.forces.in_box(),
            *self.toes.on_patches(),
            self.body.within_reach(self.toes.position()),
            *self.body.within_limits(),
        ]


def _point(model: ConicModel, solution: ConicSolution, scaled: ScaledProblem) -> tuple[Point, Array]:
    """The point and its p (eq. 2), shape (N, 3)."""
    weights = np.maximum(model.value("weights", solution), 0.0)
    weights = weights / weights.sum(axis=1, keepdims=True)
    toes = np.matmul(weights[:, None, :], scaled.vertices)[:, 0]
    com, forces = model.value("com", solution), model.value("forces", solution)
    point = Point(
        com=com, rotation=model.value("rotation", solution), toes=toes, forces=forces, residual=float("nan"), solves=1
    )
    return point, toes - com
