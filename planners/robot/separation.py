"""Distances between moving bodies that have to be measured, for all moments of a motion at once.

Two bodies that are d₁ and d₂ apart at two moments, and whose points go m in between, are d₁ − m
apart at the second one at least, and (d₁ + d₂ − m) / 2 anywhere between the two (conservative
advancement; Mirtich, 1996). Balls and boxes around bodies bound the distances of all moments in
arrays. What these bounds leave open is measured, moment after moment, so that every distance that
is measured bounds the ones after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array

Index = NDArray[np.intp]
ON_FACE_M = 1e-9
"""A point that is so little outside of a face's border is on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """Bounds on the distances of K pairs of bodies at T moments.

    Arguments:
        least: no distance is less, shape (T, K) [m].
        way: how far points go from every moment to the next, of both bodies together, shape (T - 1,
            K) [m].
        exact: truth values, True for bounds that are the distances themselves, shape (T, K).
    """

    least: Array
    way: Array
    exact: NDArray[np.bool_]

    def nearer(self, limit_m: float, *, between: bool) -> NDArray[np.bool_]:
        """Tell which pairs may be nearer than this at a moment, or with ``between`` on the way
        before or after it, shape (T, K).
        """
        near = self.least < limit_m
        if between:
            on = self.least[:-1] + self.least[1:] < self.way + 2.0 * limit_m
            near[:-1] |= on
            near[1:] |= on
        return near

    def measured(
        self, measure: Callable[[int, int], float], limit_m: float, *, between: bool
    ) -> Bounds:
        """Better bounds: exact are those that are nearer than the limit, at moments and, with
        ``between``, at both ends of ways on which bodies may be nearer.

        Arguments:
            measure: the distance of a pair (k) at a moment (t).
        """
        least, exact = self.least.copy(), self.exact.copy()
        open_ = self.nearer(limit_m, between=between) & ~exact
        for k in np.flatnonzero(open_.any(axis=0)).tolist():
            rows, known, steps = least[:, k].tolist(), exact[:, k].tolist(), self.way[:, k].tolist()
            last, end = len(rows), len(rows) - 1
            for t in np.flatnonzero(open_[:, k]).tolist():
                for s in range(last, t):
                    rows[s + 1] = max(rows[s + 1], rows[s] - steps[s])
                last, close = t, rows[t] < limit_m
                if between and not close:
                    close = t > 0 and rows[t - 1] + rows[t] < steps[t - 1] + 2.0 * limit_m
                    close = close or (t < end and rows[t] + rows[t + 1] < steps[t] + 2.0 * limit_m)
                if close:
                    rows[t], known[t] = measure(t, k), True
            least[:, k], exact[:, k] = rows, known
        return replace(self, least=least, exact=exact)


def balls_apart(middles: Array, radii: Array, pairs: Index) -> Array:
    """Distances between balls around bodies, shape (T, K) [m].

    Arguments:
        middles: centres of S bodies, shape (T, S, 3).
        radii: radii of the balls, shape (S,).
        pairs: indices of the bodies, shape (K, 2).
    """
    first, second = pairs.T
    between = middles[:, second] - middles[:, first]
    return np.asarray(
        np.sqrt(np.einsum("tki,tki->tk", between, between)) - (radii[first] + radii[second])
    )


def boxes_apart(between: Array, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Least distance at which an axis of either box keeps two apart, shape (L,) [m].

    Arguments:
        between: vector from the centre of one to that of the other, shape (L, 3).
        one, other: rotations R of the boxes, and half their sides, shapes (L, 3, 3) and (L, 3).
    """
    (a, ha), (b, hb) = one, other
    across = np.abs(np.swapaxes(a, 1, 2) @ b)
    along_a = np.abs(between[:, None] @ a)[:, 0] - ha - (across @ hb[:, :, None])[..., 0]
    along_b = np.abs(between[:, None] @ b)[:, 0] - hb - (ha[:, None] @ across)[:, 0]
    return np.asarray(np.maximum(along_a.max(axis=1), along_b.max(axis=1)))


def off_solids(
    middles: Array, supports: Array, normals: Array, offsets_m: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Least distance at which a face of a convex body keeps another body off, shape (L,) [m], and
    which middles are inside of the convex body, or nearest to the inside of a face of it: of balls
    these are the distances.

    Arguments:
        middles: centres of the bodies, shape (L, 3).
        supports: how far they reach along the faces' normals, shape (L, F) or (L, 1).
        normals, offsets_m: of the F faces n·x = d of every convex body, shapes (L, F, 3), (L, F).
    """
    heights = (normals @ middles[:, :, None])[..., 0] - offsets_m
    face, rows = heights.argmax(axis=1), np.arange(len(heights))
    height = heights[rows, face]
    below = middles - height[:, None] * normals[rows, face]
    over = np.all((normals @ below[:, :, None])[..., 0] - offsets_m < ON_FACE_M, axis=1)
    return (heights - supports).max(axis=1), over | (height <= 0.0)
