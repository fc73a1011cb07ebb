"""Sizes of a robot's links: the shapes that stand for them, and points whose hull each shape is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from .shapes import Shape

CORNERS = 24
"""Corners of the polygon that stands for a circle."""
RINGS = 10
"""Rings of a sphere, from pole to pole."""


def solid_shapes(shapes: Sequence[Shape]) -> list[Shape]:
    """For each link the shapes that it collides with, or where there are none what it looks
    like.
    """
    bodies = {shape.link for shape in shapes if shape.collides}
    return [shape for shape in shapes if shape.collides or shape.link not in bodies]


def shape_points(shape: Shape) -> Array | None:
    """Points whose hull is the shape, in its own frame, shape (K, 3) [m]; None for a mesh without a
    hull.
    """
    if shape.kind == "box":
        return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    if shape.kind == "mesh":
        return shape.corners_m
    radius = float(shape.size_m[0])
    half = 0.5 * float(shape.size_m[1]) if len(shape.size_m) > 1 else 0.0
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    rim = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(CORNERS)])
    if shape.kind == "cylinder":
        return np.vstack([rim + np.array([0.0, 0.0, end]) for end in (-half, half)])
    rings = [
        rim * [np.cos(angle), np.cos(angle), 0.0]
        + np.array([0.0, 0.0, radius * np.sin(angle) + np.sign(angle) * half])
        for angle in np.linspace(-0.5 * np.pi, 0.5 * np.pi, RINGS)
    ]
    return np.vstack(rings)


def surface_points(points: Array, apart_m: float) -> Array:
    """Points all over the hull of others, shape (K, 3), not much farther apart than this, shape (P,
    3) [m].
    """
    from scipy.spatial import ConvexHull  # slow to import

    hull = ConvexHull(points)
    every = _all_over(points[hull.vertices], points[hull.simplices], apart_m)
    return np.asarray(every[np.union1d(_apart(every, apart_m), np.arange(len(hull.vertices)))])


def points_on(triangles: Array, apart_m: float) -> Array:
    """Points all over triangles, shape (F, 3, 3), not much farther apart than this, shape (P, 3)
    [m].
    """
    every = _all_over(triangles.reshape(-1, 3), triangles, apart_m)
    return np.asarray(every[_apart(every, apart_m)])


def _all_over(corners: Array, triangles: Array, apart_m: float) -> Array:
    """Corners, and points on triangles that are larger than this."""
    points = [corners]
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    for pieces in np.unique(np.ceil(sides / apart_m)).astype(int):
        if pieces > 1:
            part = triangles[np.ceil(sides / apart_m) == pieces]
            i, j = np.triu_indices(pieces + 1)
            shares = np.stack([i, j - i, pieces - j], axis=1) / pieces
            points.append(np.einsum("sk,tkj->tsj", shares, part).reshape(-1, 3))
    return np.concatenate(points)


def _apart(points: Array, apart_m: float) -> NDArray[np.int_]:
    """Thin out points: lay a grid of cells half as wide as ``apart_m`` [m] over them, and return
    the indices of the first point in each cell.
    """
    cells = np.round(points / (0.5 * apart_m))
    ranks = [np.unique(axis, return_inverse=True)[1] for axis in cells.T]
    number = np.ravel_multi_index(ranks, [int(rank.max(initial=0)) + 1 for rank in ranks])
    return np.asarray(np.unique(number, return_index=True)[1])
