"""The upper side of triangles on a grid: which nodes lie under each triangle, and how high it is
there.
"""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array

NEAR_M = 1e-6
"""Nodes this close to a triangle's extent are looked at [m]."""
EDGE = 1e-5
"""A node is under a triangle up to this share beyond its edges: corners are often in single
precision."""
FLAT_M2 = 1e-14
"""Twice the area, seen from above, below which a triangle covers nothing [m²]."""
PAIRS = 1_000_000
"""Pairs of a triangle and a node that are looked at together, unless one triangle alone has
more."""


def raised(triangles: Array, x_m: Array, y_m: Array) -> Array:
    """The greatest height of triangles, shape (T, 3, 3) [m], over each node of a grid, −inf where
    there is none.

    Arguments:
        x_m, y_m: lines of the grid, shapes (X,) and (Y,), increasing.

    Returns:
        Shape (X, Y) [m].
    """
    heights = np.full((len(x_m), len(y_m)), -np.inf)
    flat = triangles[..., :2]
    low, high = flat.min(axis=1) - NEAR_M, flat.max(axis=1) + NEAR_M
    first = np.stack(
        [np.searchsorted(line, low[:, k]) for k, line in enumerate((x_m, y_m))], axis=1
    )
    last = np.stack(
        [np.searchsorted(line, high[:, k]) for k, line in enumerate((x_m, y_m))], axis=1
    )
    counts = (last - first).prod(axis=1)
    a, b, c = (flat[:, corner] for corner in range(3))
    doubles = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    there = np.flatnonzero((counts > 0) & (np.abs(doubles) >= FLAT_M2))
    ends = np.cumsum(counts[there])
    begin = 0
    while begin < len(there):
        done = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, done + PAIRS, side="right")))
        some = there[begin:end]
        _raise(heights, triangles[some], doubles[some], first[some], last[some], x_m, y_m)
        begin = end
    return heights


def _raise(
    heights: Array,
    triangles: Array,
    doubles: Array,
    first: Array,
    last: Array,
    x_m: Array,
    y_m: Array,
) -> None:
    """Raise the grid to some triangles where they lie higher.

    Arguments:
        first, last: of their lines, shape (T, 2).
    """
    sizes = last - first
    counts = sizes.prod(axis=1)
    of = np.repeat(np.arange(len(triangles)), counts)
    step = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    i, j = first[of, 0] + step // sizes[of, 1], first[of, 1] + step % sizes[of, 1]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (triangles[of, corner].T for corner in range(3))
    u, v, double = x_m[i] - ax, y_m[j] - ay, doubles[of]
    second = (u * (cy - ay) - v * (cx - ax)) / double
    third = (v * (bx - ax) - u * (by - ay)) / double
    inside = (second > -EDGE) & (third > -EDGE) & (second + third < 1.0 + EDGE)
    result = (az + second * (bz - az) + third * (cz - az))[inside]
    np.maximum.at(heights.reshape(-1), (i * len(y_m) + j)[inside], result)
