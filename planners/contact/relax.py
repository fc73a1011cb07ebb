"""P̄ and P1: the posture problem without its bilinear constraint, and with McCormick envelopes in its place.

P1 is kept in signed-margin form: minimise t with every envelope row relaxed by t. The margin t is defined wherever P̄
has an answer; t ≤ 0 says that P1 is feasible and t > 0 that it is not, and by how much. Its multipliers give the exact
derivative of t in every bound of the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from ..outcome import InvalidInput
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
    solves: int = 1
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What one solve of P1 tells about every other box over the same problem.

    margin: as in ``RelaxationAnswer``; the rest is None where there is none.
    point: [p, f], shape (N, 6), and excess = m − p f, shape (N, 3, 3), indices contact, j, k: a primal solution.
    rows: u ≥ 0, multipliers of the four envelope rows low-low, high-high, low-high, high-low, shape (4, N, 3, 3).
    slope, constant: what the Lagrangian  slope · [p, f] + constant  of all other constraints but [p, f] ∈ B and
    t is, shape (N, 6), minimised over what else there is, a lower bound that holds for every answer of the problem.
    """

    margin: float
    point: Array | None = None
    excess: Array | None = None
    rows: Array | None = None
    slope: Array | None = None
    constant: float = 0.0


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
        return self._read(self._model.solve(scaled.values()), scaled)

    def solve_all(self, scaled: ScaledProblem) -> list[Point | None]:
        """The same of every problem of a batch."""
        solutions = self._model.solve_all(scaled.values(), len(scaled.friction))
        return [self._read(solution, scaled.select(k)) for k, solution in enumerate(solutions)]

    def _read(self, solution: ConicSolution, scaled: ScaledProblem) -> Point | None:
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
        rows = dict(zip(_ROWS, envelope, strict=True))
        self.model = ConicModel(self.problem, equilibrate=p1_values(typical, box), duals=rows)

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

    def examine(self, scaled: ScaledProblem, envelope: Envelope) -> Evidence:
        """Signed margin over this box, and what its solution and multipliers say about other boxes."""
        model, n = self.model, envelope.contacts
        solution = model.solve(p1_values(scaled, envelope))
        if solution.status is not ConicStatus.SOLVED:
            return Evidence(margin=float("inf") if solution.status is ConicStatus.INFEASIBLE else float("nan"))
        position, forces = model.value("position", solution), model.value("forces", solution)
        excess = model.value("moments", solution).reshape(n, 3, 3) - position[:, :, None] * forces[:, None, :]
        rows = np.stack([model.dual(name, solution).reshape(n, 3, 3) for name in _ROWS[:4]])
        sides = [model.dual(name, solution) for name in _ROWS[4:]]
        constant, slope = model.lagrangian(solution)
        by_p, by_f, by_m = (slope[model.columns(name)] for name in ("position", "forces", "moments"))
        # Take the rows of the box out: they are linear in its bounds, and come back at another box.
        (p_low, p_high), (f_low, f_high) = envelope.position, envelope.force
        constant -= bound_constant(rows, envelope) + float(
            np.sum(sides[0] * p_low) - np.sum(sides[1] * p_high) + np.sum(sides[2] * f_low) - np.sum(sides[3] * f_high)
        )
        over_p, over_f = bound_slopes(rows, envelope)
        own = np.concatenate([by_p - over_p + sides[0] - sides[1], by_f - over_f + sides[2] - sides[3]], axis=1)
        # What is left of the other columns, the solver's dual residual, at its worst over their ranges.
        com, turn, weights = (slope[model.columns(name)] for name in ("com", "rotation", "weights"))
        constant += float(com @ scaled.com - scaled.com_radius * np.linalg.norm(com) - scaled.tilt * np.abs(turn).sum())
        constant += float(np.minimum(weights, 0.0).sum())
        left = by_m.reshape(n, 3, 3)  # of m: made up for by the rows low-low (−m) and low-high (+m)
        rows = np.maximum(rows, 0.0) + np.stack([np.maximum(left, 0), 0 * left, np.maximum(-left, 0), 0 * left])
        return Evidence(
            margin=float(model.value("margin", solution)),
            point=np.concatenate([position, forces], axis=1),
            excess=excess,
            rows=rows,
            slope=own,
            constant=constant,
        )

    def solve_any(self, scaled: ScaledProblem, envelopes: Sequence[Envelope]) -> RelaxationAnswer:
        """P1 with one binary an envelope: the box of least margin. One posture has few boxes, so each is tried."""
        if not envelopes:
            raise InvalidInput("envelopes: expected one or more, got none")
        answers = [self.solve(scaled, envelope) for envelope in envelopes]
        chosen = int(np.nanargmin([answer.margin if answer.known else np.inf for answer in answers]))
        best = replace(answers[chosen], chosen=chosen, solves=len(answers))
        all_known = all(answer.known for answer in answers)
        return best if best.feasible or all_known else RelaxationAnswer(margin=float("nan"), solves=len(answers))

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


_ROWS = ("low_low_rows", "high_high_rows", "low_high_rows", "high_low_rows", "p_above", "p_below", "f_above", "f_below")
"""Names of what ``mccormick_rows`` returns, for their multipliers."""


def bound_constant(rows: Array, envelope: Envelope) -> float:
    """−b'u of the envelope rows (``Evidence.rows``) over a box."""
    (p_low, p_high), (f_low, f_high) = envelope.position, envelope.force
    ends = ((p_low, f_low), (p_high, f_high), (p_low, f_high), (p_high, f_low))
    low_low, high_high, low_high, high_low = (
        float(np.einsum("njk,nj,nk->", u, p, f)) for u, (p, f) in zip(rows, ends, strict=True)
    )
    return low_high + high_low - low_low - high_high


def bound_slopes(rows: Array, envelope: Envelope) -> tuple[Array, Array]:
    """A'u of the envelope rows over a box: the coefficients of p and of f, each of shape (N, 3)."""
    (p_low, p_high), (f_low, f_high) = envelope.position, envelope.force
    u = rows
    by_p = np.einsum("njk,nk->nj", u[0] - u[3], f_low) + np.einsum("njk,nk->nj", u[1] - u[2], f_high)
    by_f = np.einsum("njk,nj->nk", u[0] - u[2], p_low) + np.einsum("njk,nj->nk", u[1] - u[3], p_high)
    return by_p, by_f


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
    """Data of P1."""
    return scaled.values() | {"moment_axes": moment_axes(scaled)} | box_values(envelope)


def moment_axes(scaled: ScaledProblem) -> Array:
    """P_j × F_k of eq. 9 in the column 9i + 3j + k, shape (3, 9N): the moment balance is  moment_axes · m = 0."""
    return side_by_side(np.matmul(skew(np.eye(3)), scaled.frames[:, None]).reshape(-1, 3, 3))


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
