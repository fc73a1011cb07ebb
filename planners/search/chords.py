"""Chords that part convex polygons: how a candidate is branched on where its toe may be."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array


def halving_chord(piece: Array) -> tuple[float, float]:
    """Border coordinates of a chord that halves a polygon: a triangle's median to its longest edge,
    else a diagonal.
    """
    count = len(piece)
    if count > 3:
        return 0.0, float(count // 2)
    edge = int(np.argmax(np.linalg.norm(np.roll(piece, -1, axis=0) - piece, axis=1)))
    first, second = sorted((edge + 0.5, float((edge + 2) % 3)))
    return first, second


def cut(piece: Array, first: float, second: float) -> tuple[Array, Array]:
    """The two parts of a convex polygon on either side of a chord, as ``Certificate`` orders
    them.
    """
    count = len(piece)

    def point(coordinate: float) -> Array:
        edge, share = int(coordinate), coordinate - int(coordinate)
        return np.asarray(piece[edge] + share * (piece[(edge + 1) % count] - piece[edge]))

    def run(start: float, stop: float) -> Array:
        between = [piece[k % count] for k in range(int(start) + 1, int(np.ceil(stop)))]
        return np.array([point(start), *between, point(stop % count)])

    return run(first, second), run(second, first + count)
