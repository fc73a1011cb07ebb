"""m = p f over a grid of cells with a McCormick envelope each: mixed-integer terms in cvxpy (Lin et
al. §II, [11]).

Every p_j and f_k is cut into intervals. Over one cell the envelope of m = p f is the hull of the
four points (p, f, p f) at its corners, so that over the grid

    (p, f, m) = Σ_ab w_ab (P_a, F_b, P_a F_b),   w ≥ 0, Σ w = 1,   α_a = Σ_b w_ab and β_b = Σ_a w_ab
    of type SOS2,

with breakpoints P_a, F_b: weight lies on one cell's corners only. So do Dai, Izatt and Tedrake
(2019, [11]) in Drake (``AddBilinearProductMcCormickEnvelopeSos2``). The three products of a p_j
share its α, those of an f_k its β, so that binaries are per variable and not per cell: log₂ K by a
Gray code (Vielma and Nemhauser 2011), or one an interval in Padberg's (2000) locally ideal form. A
solver without second-order cones gets planes around or inside them, and tangents in the place of
squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import cvxpy as cp
import numpy as np
from cvxpy.atoms.affine.add_expr import AddExpression

from ..equilibrium.equations import Vectors
from ..equilibrium.layout import Index
from ..equilibrium.scaled import Scaled
from .envelope import Envelope
from .mccormick import Axes

Encoding = Literal["log", "unary"]
Cones = Literal["exact", "outer", "inner"]
TANGENTS = 16  # planes around a disc: the polygon exceeds it by 2 % at its corners, the polyhedron of a ball by 4 %
KNOTS = np.array([0.0, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.33, 0.5, 0.8, 1.3])
"""Where tangents touch a square, either side, in length scales: up to .35 off, y² is at most .0025
above them."""


class Breaks(NamedTuple):
    """Breakpoints of every p_j and f_k, rows 3i + j and 3i + k for contact i, and products of each
    two, 9i + 3j + k.

    Numbers, or parameters in their place.
    """

    p: Vectors
    f: Vectors
    products: Vectors

    @classmethod
    def of(cls, domain: Envelope, counts: tuple[int, int]) -> Breaks:
        """The breakpoints that cut the sides of a domain evenly.

        Arguments:
            domain: of [p, f], B contacts.
            counts: pieces of a p_j and of an f_k, so that there are one more breakpoint each.
        """
        p, f = (
            np.linspace(low, high, count + 1, axis=-1)
            for (low, high), count in zip((domain.position, domain.force), counts, strict=True)
        )
        products = p[:, :, None, :, None] * f[:, None, :, None, :]
        rows = 3 * len(p)
        return cls(p.reshape(rows, -1), f.reshape(rows, -1), products.reshape(3 * rows, -1))


class Cells:
    """The grid over p and f of every contact, and m = p f on it.

    Arguments:
        counts: pieces of a p_j and of an f_k. Rows of α, β and w as those of the breakpoints.
    """

    def __init__(self, breaks: Breaks, counts: tuple[int, int], encoding: Encoding) -> None:
        self._breaks, self._counts, self._encoding = breaks, counts, encoding
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
        pieces = zip((self._alpha, self._beta), self._counts, strict=True)
        return sum(
            cp.sum(weights @ (np.arange(count + 1) - 0.5 * count) ** 2) for weights, count in pieces
        )

    def terms(
        self, position: cp.Variable, forces: cp.Variable, moments: cp.Variable
    ) -> list[cp.Constraint]:
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
        constraints = [
            cp.sum(alpha, axis=1) == 1,
            cp.sum(beta, axis=1) == 1,
            corners @ np.kron(np.eye(ends[0]), np.ones((ends[1], 1))) == alpha[of_p],
            corners @ np.kron(np.ones((ends[0], 1)), np.eye(ends[1])) == beta[of_f],
            *neighbouring(alpha, self._encoding),
            *neighbouring(beta, self._encoding),
        ]
        parts, every = (position, forces, moments), (alpha, beta, corners)
        for part, weights, breaks in zip(parts, every, self._breaks, strict=True):
            constraints.append(
                cp.vec(part, order="C") == cp.sum(cp.multiply(breaks, weights), axis=1)
            )
        return constraints


def cell_error(domain: Envelope, counts: tuple[int, int]) -> float:
    """The most that m may be off p f in a cell: a quarter of the largest product of its sides
    (McCormick 1976).

    Arguments:
        domain: of [p, f].
        counts: pieces of a p_j and of an f_k. Non-dimensional, as m is.
    """
    sides = domain.high - domain.low
    return float(np.max(sides[:, :3, None] * sides[:, None, 3:])) / (4.0 * counts[0] * counts[1])


def neighbouring(weights: cp.Variable, encoding: Encoding) -> list[cp.Constraint]:
    """Every row of ``weights``, shape (R, K + 1), is zero but for two neighbours (SOS2); one
    interval needs no row.

    Arguments:
        encoding: "unary" has a binary an interval, "log" log2 of them (Vielma and Nemhauser).

    Returns:
        Constraints.
    """
    rows, count = weights.shape[0], weights.shape[1] - 1
    if count == 1:
        return []
    if (
        encoding == "unary"
    ):  # Padberg: weight up to breakpoint a wants an interval up to a; from a on, from a − 1 on
        chosen, ends = cp.Variable((rows, count), boolean=True), np.ones((count + 1, count))
        return [
            cp.sum(chosen, axis=1) == 1,
            weights @ np.triu(ends) <= chosen @ np.triu(ends[1:]),
            weights @ np.tril(ends, -1) <= chosen @ np.tril(ends[1:]),
        ]
    bits = count.bit_length() - 1
    code = (
        np.array([k ^ (k >> 1) for k in range(count)])[:, None] >> np.arange(bits) & 1 == 1
    )  # Gray, by digit
    beside = np.stack(
        [code[[0, *range(count)]], code[[*range(count), count - 1]]]
    )  # of both intervals at a breakpoint
    digit = cp.Variable((rows, bits), boolean=True)
    return [weights @ beside.all(axis=0) <= digit, weights @ (~beside).all(axis=0) <= 1 - digit]


def planes(constraint: cp.Constraint, cones: Cones) -> Sequence[cp.Constraint]:
    """The constraint, or planes around or inside it if it is second-order cones ‖x‖ ≤ t of 2 or 3
    components.

    Three components are nested discs, ‖(x₁, x₂)‖ ≤ r and ‖(r, x₃)‖ ≤ t, with a variable r each
    (Ben-Tal, Nemirovski).
    """
    if cones == "exact" or not isinstance(constraint, cp.SOC):
        return [constraint]
    radius, vectors = (
        cp.reshape(part, (constraint.args[0].size, -1), order="C").T for part in constraint.args
    )
    if constraint.axis == 0 and constraint.args[1].ndim == 2:
        vectors = constraint.args[1]
    if cones == "inner":  # the polygon has corners, and so has the one that nests it
        radius = np.cos(np.pi / TANGENTS) ** (vectors.shape[0] - 1) * radius
    angle = np.linspace(0.0, 2.0 * np.pi, TANGENTS, endpoint=False)
    circle, every = np.column_stack([np.cos(angle), np.sin(angle)]), np.ones((TANGENTS, 1))
    if vectors.shape[0] == 2:
        return [circle @ vectors <= every @ radius]
    inner, half = (
        cp.Variable((1, vectors.shape[1])),
        circle[:, 0] > -1e-9,
    )  # the first rows imply r ≥ 0
    outer = circle[half] @ cp.vstack([inner, vectors[2:]]) <= every[half] @ radius
    return [circle @ vectors[:2] <= every @ inner, outer]


def without_squares(cost: cp.Expression) -> tuple[cp.Expression, list[cp.Constraint]]:
    """A sum of weighted sums of squares, each square replaced by its highest tangent at ``KNOTS``:
    from below.
    """
    knots, total, rows = np.concatenate([-KNOTS[:0:-1], KNOTS])[:, None], 0.0, []
    for term in cost.args if isinstance(cost, AddExpression) else [cost]:
        weight, squares = term.args
        line = cp.reshape(squares.args[0], (1, squares.args[0].size), order="C")
        above = cp.Variable(line.shape, nonneg=True)
        rows.append(
            np.ones_like(knots) @ above >= 2.0 * knots @ line - knots**2 @ np.ones(line.shape)
        )
        total = total + weight * cp.sum(above)
    return total, rows


def axes_of(scaled: Scaled) -> Axes:
    """The contact frames where the candidates under every stance contact share one, else the
    world's axes.
    """
    return "world" if len(of_several_frames(scaled)) else "contact"


def of_several_frames(scaled: Scaled) -> Index:
    """The stance contacts under which candidates of several frames are open, in order."""
    contact, candidate = scaled.layout.contact_candidates
    first = np.searchsorted(scaled.layout.candidate_footholds, scaled.layout.contacts[2])
    off = np.abs(scaled.frames[candidate] - scaled.frames[first[contact]]).max(axis=(1, 2))
    return np.unique(contact[off > 1e-6])


def unit_domain(scaled: Scaled) -> Envelope:
    """[−1, 1] for every p and f of every stance contact (Lin et al. §II), f_n included."""
    ends = np.ones((len(scaled.layout.contacts[0]), 6))
    return Envelope(low=-ends, high=ends)


def meet(first: Envelope, second: Envelope) -> Envelope:
    """The common part of two boxes; on a side where they have none, the gap between them."""
    ends = (np.maximum(first.low, second.low), np.minimum(first.high, second.high))
    return Envelope.from_vector(np.concatenate(ends, axis=None))
