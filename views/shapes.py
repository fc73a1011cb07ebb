"""Shapes and their surfaces: capsule, sphere, box and mesh, and the solids and lines that pictures
are made of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from stancekit.planners.files.arrays import Array

Faces = NDArray[np.int64]
"""Corners of faces by index, shape (F, 3) or (F, 4), to the left as seen from outside."""
_AROUND = 16
"""Corners of what is round."""
_TURN = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)


@dataclass(frozen=True)
class Capsule:
    """A round bar along z about the origin, with these radii below and above [m]."""

    length_m: float
    radii_m: tuple[float, float]


@dataclass(frozen=True)
class Sphere:
    """A ball about the origin."""

    radius_m: float


@dataclass(frozen=True, eq=False)
class Box:
    """A box about the origin.

    Arguments:
        half_m: half its sides, shape (3,) [m].
    """

    half_m: Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """Corners, shape (V, 3) [m], and faces, shape (F, 3)."""

    vertices_m: Array
    faces: Faces


Shape = Capsule | Sphere | Box | Mesh


def triangles_of(faces: Faces) -> Faces:
    """Faces of four corners in halves, shape (2 F, 3)."""
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])


def mesh_of(shape: Shape) -> tuple[Array, Faces]:
    """Corners, shape (V, 3) [m], and faces of a shape."""
    match shape:
        case Mesh(vertices, faces):
            return vertices, faces
        case Box(half):
            corners = (
                np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
            )
            sides = ["0132", "4675", "0451", "2376", "0264", "1573"]
            return corners, np.array([[int(k) for k in side] for side in sides])
        case Sphere(radius):
            turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
            return turned(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
        case Capsule(length, (low, high)):
            turn = np.linspace(0.0, 0.5 * np.pi, 5)
            cap = np.column_stack([np.cos(turn), np.sin(turn)])
            bar = np.column_stack([np.linspace(low, high, 7), length * np.linspace(-0.5, 0.5, 7)])
            below = low * cap[:0:-1] * [1.0, -1.0] - [0.0, 0.5 * length]
            return turned(np.concatenate([below, bar, high * cap[1:] + [0.0, 0.5 * length]]))
    raise TypeError(shape)


def box_of(shape: Shape) -> tuple[Array, Array]:
    """Lowest and highest coordinates of a shape, shape (3,) each [m]."""
    match shape:
        case Capsule(length, (low, high)):
            wide = max(low, high)
            return np.array([-wide, -wide, -0.5 * length - low]), np.array(
                [wide, wide, 0.5 * length + high]
            )
        case Sphere(radius):
            return np.full(3, -radius), np.full(3, radius)
    points = mesh_of(shape)[0]
    return points.min(axis=0), points.max(axis=0)


def turned(profile: Array) -> tuple[Array, Faces]:
    """The solid of a profile (distance from z, height), shape (K, 2) [m] and upward, turned around
    z.
    """
    ring = np.column_stack([np.cos(_TURN), np.sin(_TURN)])
    corners = np.concatenate(
        [np.column_stack([radius * ring, np.full(_AROUND, z)]) for radius, z in profile]
    )
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(_AROUND), indexing="ij")
    ahead = (column + 1) % _AROUND
    quads = [
        _AROUND * row + column,
        _AROUND * row + ahead,
        _AROUND * (row + 1) + ahead,
        _AROUND * (row + 1) + column,
    ]
    return corners, np.stack(quads, axis=-1).reshape(-1, 4)


def hull(points: Array) -> Mesh:
    """The convex solid of these corners, shape (K, 3) [m]."""
    result = ConvexHull(points)
    outward = np.cross(
        points[result.simplices[:, 1]] - points[result.simplices[:, 0]],
        points[result.simplices[:, 2]] - points[result.simplices[:, 0]],
    )
    inward = np.einsum("ij,ij->i", outward, result.equations[:, :3]) < 0.0
    return Mesh(points, np.where(inward[:, None], result.simplices[:, ::-1], result.simplices))


def plate(outline: Array, offset_m: Array) -> Mesh:
    """The solid between a convex outline, shape (K, 3) [m], and the same moved, by shape (3,) [m]."""
    count, corner = len(outline), np.arange(len(outline))
    after, fan = np.roll(corner, -1), np.column_stack([0 * corner, corner - 1, corner])[2:]
    faces = np.concatenate(
        [
            np.column_stack([corner, after, count + after]),
            np.column_stack([corner, count + after, count + corner]),
            fan[:, ::-1],
            count + fan,
        ]
    )
    first = outline[0]
    area = np.cross(outline[1:-1] - first, outline[2:] - first).sum(axis=0)
    to_the_left = float(area @ offset_m) > 0.0
    return Mesh(
        np.concatenate([outline, outline + offset_m]), faces if to_the_left else faces[:, ::-1]
    )


def prism(outline: Array, low_m: float, high_m: float) -> Mesh:
    """The convex prism over an outline in the plane, shape (K, 2) [m]."""
    return hull(
        np.concatenate(
            [np.column_stack([outline, np.full(len(outline), z)]) for z in (low_m, high_m)]
        )
    )


def disc(normal: Array, radius_m: float) -> Mesh:
    """A thin round plate across a normal: a foothold."""
    ends = prism(radius_m * np.column_stack([np.cos(_TURN), np.sin(_TURN)]), 0.0, 0.08 * radius_m)
    return Mesh(ends.vertices_m @ along(normal).T, ends.faces)


def arrow_profile(length: float, radius: float) -> Array:
    """Profile of an arrow: the shaft from the origin, and its head."""
    neck = length - min(5.5 * radius, 0.6 * length)
    return np.array(
        [[0.0, 0.0], [radius, 0.0], [radius, neck], [2.4 * radius, neck], [0.0, length]]
    )


def along(direction: Array) -> Array:
    """A rotation that turns z into a direction, shape (3, 3)."""
    z = unit(direction)
    x = unit(np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z))
    return np.column_stack([x, np.cross(z, x), z])


def unit(vector: Array) -> Array:
    """The vector over its length; zero stays zero."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def polyline(points: Array) -> Array:
    """A line through points, shape (K, 3), in straight pieces, shape (K − 1, 2, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def thinned(points: Array, off_m: float) -> Array:
    """A line through points, shape (K, 3), without every second corner that is within ``off_m`` of
    the piece in its place, again and again: flat ground needs no corners, and each piece costs a
    viewer time.
    """
    while len(points) > 2:
        middle = np.arange(1, len(points) - 1, 2)
        start, piece = points[middle - 1], points[middle + 1] - points[middle - 1]
        square = np.maximum(np.sum(piece**2, axis=1), 1e-24)
        share = np.clip(np.sum((points[middle] - start) * piece, axis=1) / square, 0.0, 1.0)
        idle = np.linalg.norm(points[middle] - start - share[:, None] * piece, axis=1) < off_m
        if not idle.any():
            break
        points = np.delete(points, middle[idle], axis=0)
    return points


def dashed(points: Array) -> Array:
    """Every second piece of a line through points, shape (K, 3)."""
    return polyline(points)[::2]


def dashes(points: Array, apart_m: float = 0.05) -> Array:
    """Dashes along a line whose points may be far apart, shape (K, 3), each so long [m]."""
    spent = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, spent[-1], max(2, 1 + round(spent[-1] / apart_m)))
    return dashed(np.stack([np.interp(at, spent, axis) for axis in points.T], axis=1))


def lines_told(told: object) -> list[Array]:
    """The lines through points, shape (L, 3) each [m], of a list that a file may hold; what is none
    is left out.
    """
    lines = list[Array]()
    for line in told if isinstance(told, list) else []:
        try:
            points = np.asarray(line, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):
            continue
        if (
            points.ndim == 2
            and points.shape[1] == 3
            and len(points) > 1
            and np.isfinite(points).all()
        ):
            lines.append(points)
    return lines


def ring(points: Array) -> Array:
    """A line through points and back to the first, in straight pieces."""
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)
