"""Cubic B-splines on strictly increasing knots: the one-dimensional pieces of height fields and
warp maps.

A basis over K knots has K − 4 functions and is C² from its fourth knot to its fourth last. Outside
that span the first and the last polynomial piece go on; the knots reach ``_REACH_M`` beyond the
data, and control points there go on straight.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import splu

from ..arguments import cached_property
from ..files.arrays import Array

_REACH_M = 100.0
"""Distance beyond its data that a spline's knots reach [m]."""


def cubics(x: Array, knots: Array, order: int = 0) -> tuple[NDArray[np.intp], Array]:
    """The first of the four cubic B-splines that live at each x, shape (N,), and their values (or a
    derivative), shape (N, 4), by the recursion of Cox and de Boor.

    Arguments:
        x: from the fourth knot to the fourth last, shape (N,).
        knots: never falling, shape (K,).

    It is scipy's, to the last bit, whose splines take a tenth of a second to import.
    """
    last = len(knots) - 5
    interval = np.clip(np.searchsorted(knots, x, side="right") - 1, 3, last)
    values = np.zeros((4, len(x)))
    values[0] = 1.0
    for degree in range(1, 4):
        lower = values[:degree].copy()
        values[0] = 0.0
        for n in range(1, degree + 1):
            after, before = knots[interval + n], knots[interval + n - degree]
            width = after - before
            share = np.zeros_like(x)
            slope = degree * lower[n - 1] if degree > 3 - order else lower[n - 1]
            np.divide(slope, width, out=share, where=width != 0.0)
            if degree > 3 - order:
                values[n - 1] -= share
                values[n] = share
            else:
                values[n - 1] += share * (after - x)
                values[n] = share * (x - before)
    return interval - 3, values.T


def rows_of(first: NDArray[np.intp], values: Array, size: int) -> csr_array:
    """Rows of a sparse matrix with so many columns, each of four values, shape (N, 4), from the
    column ``first`` on, shape (N,).
    """
    columns = first[:, None] + np.arange(4)
    rows = np.repeat(np.arange(len(columns)), 4)
    return csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(columns), size))


class CubicBasis:
    """Cubic B-splines over ``knots``, shape (K,), strictly increasing, K ≥ 8."""

    def __init__(self, knots: Array) -> None:
        self.knots = np.array(knots, dtype=np.float64)
        self.knots.setflags(write=False)
        self.size = len(self.knots) - 4

    @classmethod
    def over(cls, sites: Array, reach_m: float = _REACH_M) -> CubicBasis:
        """The basis with a knot at each site, shape (n,), and others beyond both ends, ever wider
        up to ``reach_m``.
        """
        before, after = (
            _beyond(sites[1] - sites[0], reach_m),
            _beyond(sites[-1] - sites[-2], reach_m),
        )
        return cls(np.concatenate([sites[0] - before[::-1], sites, sites[-1] + after]))

    @property
    def greville(self) -> Array:
        """Control points of x ↦ x, shape (size,): where the basis's functions sit."""
        return np.asarray((self.knots[1:-3] + self.knots[2:-2] + self.knots[3:-1]) / 3.0)

    @cached_property
    def _pieces(self) -> Array:
        """Polynomials of the four functions that live on an interval, by (power, interval,
        function).
        """
        starts = self.knots[3 : self.size]
        powers = [cubics(starts, self.knots, order)[1] / factorial(order) for order in range(4)]
        return np.ascontiguousarray(np.stack(powers))

    def weights(self, x: Array, orders: int = 0) -> tuple[NDArray[np.intp], list[Array]]:
        """The first of the four functions that live at x, shape (N,), and their derivatives
        0…orders, shape (N, 4).
        """
        interval = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 3, self.size - 1) - 3
        u = (x - self.knots[interval + 3])[:, None]
        c = [np.take(piece, interval, axis=0) for piece in self._pieces]
        values = [c[0] + u * (c[1] + u * (c[2] + u * c[3]))]
        if orders > 0:
            values.append(c[1] + u * (2.0 * c[2] + 3.0 * u * c[3]))
        if orders > 1:
            values.append(2.0 * c[2] + 6.0 * u * c[3])
        if orders > 2:
            values.append(6.0 * c[3])
        values += [np.zeros_like(c[0])] * (orders - 3)
        return interval, values

    def matrix(self, x: Array, order: int = 0) -> csr_array:
        """Values (or a derivative) of every function at x, sparse, shape (len(x), size)."""
        first, values = self.weights(np.asarray(x, dtype=np.float64), order)
        return rows_of(first, values[order], self.size)

    def interpolate(self, sites: Array, values: Array) -> Array:
        """Coefficients, shape (size, …), of the natural spline through values at the sites of
        ``over``, shape (n, …).

        Its second derivative is 0 at both ends and beyond: it goes on as a straight line, and stays
        C².
        """
        inner = self.knots[3:-3]
        straight = self.matrix(inner[(inner <= sites[0]) | (inner >= sites[-1])], 2)
        rows = vstack([self.matrix(sites), straight], format="csc")
        right = np.zeros((rows.shape[0], int(np.prod(values.shape[1:]))))
        right[: len(sites)] = values.reshape(len(sites), -1)
        return np.asarray(splu(rows).solve(right)).reshape(self.size, *values.shape[1:])


def _beyond(step: float, reach_m: float) -> Array:
    """Distances of knots beyond the last site: three cells, then ever wider, and three more for the
    basis.
    """
    far = (
        3.0 * step * 2.0 ** np.arange(1, max(2, int(np.ceil(np.log2(reach_m / (3.0 * step)))) + 1))
    )
    return np.concatenate([step * np.arange(1.0, 4.0), far, far[-1] * np.array([2.0, 3.0, 4.0])])
