"""Splines of the gait optimiser: uniform cubic B-splines (torso), clamped ones (forces), Hermite
pieces (swings).

A basis is a matrix: its value at many times is that matrix times the coefficients, and so is each
derivative.
"""

from __future__ import annotations

from typing import Any

import casadi as cs
import numpy as np
from scipy.sparse import csr_array

from ...errors import InvalidInput
from ...files.arrays import Array
from ...terrain.bspline import cubics, rows_of

DEGREE = 3


def uniform_size(duration_s: float, knot_s: float) -> int:
    """Number of coefficients of a uniform cubic B-spline on [0, duration].

    Raises InvalidInput for uneven knots.
    """
    pieces = round(duration_s / knot_s)
    if pieces < 1 or abs(pieces * knot_s - duration_s) > 1e-9:
        raise InvalidInput(
            f"torso_knot_s: expected a share of the duration of {duration_s:g} s, got {knot_s:g} s"
        )
    return pieces + DEGREE


def uniform_basis(times_s: Array, duration_s: float, knot_s: float, order: int = 0) -> csr_array:
    """Values (or a derivative) of the uniform cubic B-splines on [0, duration], shape (len(times),
    size).
    """
    size = uniform_size(duration_s, knot_s)
    return _basis(np.asarray(times_s), knot_s * np.arange(-DEGREE, size + 1.0), order)


def clamped_basis(shares: Array, pieces: int, order: int = 0) -> csr_array:
    """Values (or a derivative) of the clamped cubic B-splines on [0, 1], shape (len(shares), pieces
    + 3).
    """
    return _basis(np.asarray(shares), clamped_knots(pieces), order)


def clamped_knots(pieces: int) -> Array:
    """Knots of the clamped cubic B-splines on [0, 1], their ends fourfold, shape (pieces + 7,)."""
    return np.concatenate([np.zeros(DEGREE), np.linspace(0.0, 1.0, pieces + 1), np.ones(DEGREE)])


def greville(knots: Array) -> Array:
    """Place where each coefficient of a cubic B-spline acts most: the mean of its three inner
    knots.
    """
    return np.asarray((knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0)


def uniform_greville(duration_s: float, knot_s: float) -> Array:
    """Greville times of the uniform B-splines on [0, duration] [s]; the first and the last lie
    outside.
    """
    return np.asarray(
        knot_s * (np.arange(uniform_size(duration_s, knot_s)) - 1.0), dtype=np.float64
    )


def _basis(x: Array, knots: Array, order: int) -> csr_array:
    first, values = cubics(np.clip(x, knots[DEGREE], knots[-DEGREE - 1]), knots, order)
    basis = rows_of(first, values, len(knots) - DEGREE - 1)
    if order > 0:
        basis.eliminate_zeros()  # entries that are none make the program's matrices fuller
    return basis


def hermite(s: Any, order: int = 0) -> tuple[Any, Any, Any, Any]:
    """Weights of (p₀, T v₀, p₁, T v₁) in a cubic Hermite piece at the share s of its time T, for
    numbers or symbols.

    The derivative of this order is by s; divide by T^order for one by time.
    """
    if order == 0:
        return 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2
    if order == 1:
        return 6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, -6 * s**2 + 6 * s, 3 * s**2 - 2 * s
    return 12 * s - 6, 6 * s - 4, -12 * s + 6, 6 * s - 2


def clamped_symbolic(share: cs.SX, pieces: int) -> cs.SX:
    """``clamped_basis`` at one symbolic share in [0, 1], shape (pieces + 3, 1), by the recursion of
    Cox and de Boor.

    Beyond both ends the outer polynomial pieces go on.
    """
    knots = clamped_knots(pieces)
    inner = knots[DEGREE:-DEGREE]
    basis: list[Any] = [cs.SX(0)] * (len(knots) - 1)
    for k in range(pieces):
        above = share >= inner[k] if k > 0 else cs.SX(1)
        below = share < inner[k + 1] if k < pieces - 1 else cs.SX(1)
        basis[DEGREE + k] = above * below
    for degree in range(1, DEGREE + 1):
        basis = [
            _ramp(share - knots[i], knots[i + degree] - knots[i]) * basis[i]
            + _ramp(knots[i + degree + 1] - share, knots[i + degree + 1] - knots[i + 1])
            * basis[i + 1]
            for i in range(len(basis) - 1)
        ]
    return cs.SX(cs.vertcat(*basis))


def _ramp(rise: cs.SX, width: float) -> cs.SX:
    return cs.SX(rise / width) if width > 0.0 else cs.SX(0)
