"""Geometry that the verifier works out for itself: contact frames, distances from patches, cuts of
polygons.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array

FLAT = 1e-12
"""A polygon whose corners leave its plane by less than this share of its size is the fan of its
triangles."""


FOLLOWING, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""The corner of a triangle, or the axis of space, after each, and the one after that."""


def cross(a: Array, b: Array) -> Array:
    """a × b along the last axis (``np.cross`` takes ten times as long on a few vectors)."""
    first = a.take(FOLLOWING, axis=-1) * b.take(LAST, axis=-1)
    return np.asarray(first - a.take(LAST, axis=-1) * b.take(FOLLOWING, axis=-1))


def length(vectors: Array) -> Array:
    """Euclidean norm along the last axis."""
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def exact_and_linear(rotation: Array, vectors: Array) -> tuple[Array, Array]:
    """exp([Θ]×) v by Rodrigues' formula and (I + [Θ]×) v; shapes (..., 3) each that go together."""
    angle = length(rotation)
    flat = np.maximum(angle, 1e-12)
    sine = np.where(angle < 1e-12, 1.0, np.sin(angle) / flat)
    versine = np.where(angle < 1e-6, 0.5, (1.0 - np.cos(angle)) / flat**2)
    once = cross(rotation, vectors)
    return vectors + sine[..., None] * once + versine[..., None] * cross(
        rotation, once
    ), vectors + once


def contact_frames(normals: Array, references: Array) -> Array:
    """R_WC of every contact, columns n, y = z × n, z with z the shear reference in the patch (E3).

    Arguments:
        normals, references: unit normals and shear references, shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    n = normals
    z = references - np.vecdot(references, n)[..., None] * n
    z /= length(z)[..., None]
    frames = np.empty((*n.shape, 3))
    frames[..., 0], frames[..., 1], frames[..., 2] = n, cross(z, n), z
    return frames


def patch_distances(polygons: list[Array], toes: Array) -> Array:
    """Distance of every toe from the convex hull of its patch's vertices (E1).

    Returns shape (K,) [m]. A flat convex polygon is the fan of its triangles. The corners of a
    rounded file span a thin body, and where a toe is off the fan of such, its distance is that from
    the body's nearest point.

    Arguments:
        polygons: one a toe, shape (U, 3) [m] each.
        toes: shape (K, 3) [m].
    """
    counts = [len(polygon) for polygon in polygons]
    if max(counts) == 3:
        return triangle_distances(np.array(polygons), toes)
    distances = np.empty(len(polygons))
    for count in set(counts):
        rows = np.flatnonzero(np.array(counts) == count)
        corners, points = np.array([polygons[row] for row in rows]), toes[rows]
        fan = np.empty((len(rows), count - 2, 3, 3))
        fan[:, :, 0], fan[:, :, 1], fan[:, :, 2] = corners[:, :1], corners[:, 1:-1], corners[:, 2:]
        each = triangle_distances(fan.reshape(-1, 3, 3), np.repeat(points, count - 2, axis=0))
        result = each.reshape(-1, count - 2).min(axis=1)
        off = np.flatnonzero(result > 1e-12) if count > 3 else np.zeros(0, dtype=np.intp)
        for k in off[_bent(corners[off])] if len(off) else off:
            result[k] = min(result[k], hull_distance(corners[k], points[k]))
        distances[rows] = result
    return distances


def triangle_distances(triangles: Array, points: Array) -> Array:
    """Distance of points, shape (T, 3), from triangles, shape (T, 3, 3); shape (T,)."""
    edges = triangles.take(FOLLOWING, axis=1) - triangles
    away = points[:, None] - triangles
    normals = cross(edges[:, 0], edges[:, 1])
    sides = np.vecdot(
        cross(edges, away), normals[:, None]
    )  # all ≥ 0 above the inside, either way round
    areas = np.vecdot(normals, normals)
    heights = np.vecdot(away[:, 0], normals)
    above = (sides.min(axis=1) >= 0.0) & (areas > 0.0)
    squares = heights * heights / np.maximum(areas, 1e-300)
    if not above.all():
        share = np.vecdot(away, edges) / np.maximum(np.vecdot(edges, edges), 1e-300)
        to_border = away - np.minimum(np.maximum(share, 0.0), 1.0)[:, :, None] * edges
        squares = np.where(above, squares, np.vecdot(to_border, to_border).min(axis=1))
    return np.asarray(np.sqrt(squares))


def hull_distance(vertices: Array, point: Array) -> float:
    """Distance of a point from the convex hull of points in space, shape (U, 3), never too small.

    By least-distance programming (Lawson and Hanson, Solving Least Squares Problems, ch. 23): the
    non-negative least squares of [(v_u − p)ᵀ; 1] λ = (0, 1) has the shares of the nearest point, up
    to a factor. What is returned is the distance of that combination of the vertices, whatever the
    method says of it. Cost grows with U, not with its cube.
    """
    from scipy.optimize import nnls  # costs as much to import as everything else here

    away = vertices - point
    size = float(np.abs(away).max())
    if size == 0.0:
        return 0.0
    try:
        shares, _ = nnls(
            np.vstack([away.T / size, np.ones(len(away))]), np.array([0.0, 0.0, 0.0, 1.0])
        )
    except RuntimeError:  # too many steps: any combination is an upper bound
        shares = np.ones(len(away))
    total = float(shares.sum())
    return float(length(shares @ away)) / total if total > 0.0 else math.inf


def _bent(corners: Array) -> NDArray[np.bool_]:
    """Tell which polygons, shape (G, U, 3), are not flat and convex to the last digits, shape
    (G,).
    """
    from_mean = corners - corners.mean(axis=1, keepdims=True)
    edges = np.roll(from_mean, -1, axis=1) - from_mean
    size = np.abs(from_mean).max(axis=(1, 2))
    normals = cross(from_mean, edges).sum(axis=1)
    normals /= np.maximum(length(normals), 1e-300)[:, None]
    heights = np.abs(np.vecdot(from_mean, normals[:, None])).max(axis=1)
    turns = np.vecdot(cross(np.roll(edges, 1, axis=1), edges), normals[:, None]).min(axis=1)
    return np.asarray((heights > FLAT * size) | (turns < -FLAT * size * size))


def cut(polygon: Array, first: float, second: float) -> tuple[Array, Array]:
    """Cut a convex polygon along the chord between two border coordinates (see ``Certificate``).

    Arguments:
        polygon: corners in order, shape (U, 3). first < second: k + s is the point s of the way
            from corner k to the next.

    Returns:
        Both parts, the one between the two points first.
    """

    def point(coordinate: float) -> Array:
        e = int(coordinate)
        start = polygon[e]
        return np.asarray(start + (coordinate - e) * (polygon[(e + 1) % len(polygon)] - start))[
            None
        ]

    begin, end = point(first), point(second)
    after_first, after_second = (
        math.floor(first) + 1,
        math.floor(second) + 1,
    )  # corners strictly after each point
    before_first, before_second = math.ceil(first), math.ceil(second)
    return (
        np.concatenate([begin, polygon[after_first:before_second], end]),
        np.concatenate([end, polygon[after_second:], polygon[:before_first], begin]),
    )


def sag(polygon: Array) -> float:
    """Largest distance of a point of the convex hull from the pieces that any cuts leave; 0 for a
    triangle.

    Cut pieces of a flat convex polygon cover it. A polygon from a rounded file is neither, quite:
    its corners are off some flat convex polygon by a height and by up to a depth in the plane, and
    so is every point of hull and pieces.
    """
    if len(polygon) <= 3:
        return 0.0
    centred = polygon - polygon.mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    x, y = flat[:, 0], flat[:, 1]
    around = np.sign(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))

    def turn(p: int, q: int, r: int) -> float:
        return float(around * ((x[q] - x[p]) * (y[r] - y[q]) - (y[q] - y[p]) * (x[r] - x[q])))

    corners, at = list(range(len(polygon))), 0
    while at < len(corners) and len(corners) > 3:
        if turn(corners[at - 1], corners[at], corners[(at + 1) % len(corners)]) < 0.0:
            del corners[at]
            at = max(at - 1, 0) if at < len(corners) else 0
        else:
            at += 1
    depth = 0.0
    for corner in set(range(len(polygon))).difference(corners):
        start = flat[max((k for k in corners if k < corner), default=corners[-1]), :2]
        edge = flat[min((k for k in corners if k > corner), default=corners[0]), :2] - start
        away = flat[corner, :2] - start
        share = np.clip(away @ edge / max(float(edge @ edge), 1e-300), 0.0, 1.0)
        depth = max(depth, float(np.linalg.norm(away - share * edge)))
    return float(np.ptp(flat[:, 2])) + 2.0 * depth
