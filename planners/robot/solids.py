"""How large a robot's links are: the shapes that stand for them, and points whose hull each shape is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from ..files.arrays import Array
from .shapes import Shape

HEAVIEST_MESH = 3_000_000
"""Bytes of a mesh that is still loaded for its hull."""
MOST_POINTS = 4000
CORNERS = 24
"""Of the polygon that stands for a circle."""
RINGS = 10
"""Of a sphere, from pole to pole."""


def solid_shapes(shapes: Sequence[Shape]) -> list[Shape]:
    """For each link the shapes that it collides with, or where there are none what it looks like."""
    bodies = {shape.link for shape in shapes if shape.collides}
    return [shape for shape in shapes if shape.collides or shape.link not in bodies]


def shape_points(shape: Shape) -> Array | None:
    """Points whose hull is the shape, in its own frame, shape (K, 3) [m]; None for a mesh that cannot be had."""
    if shape.kind == "box":
        return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    if shape.kind == "mesh":
        return _mesh_points(shape)
    radius = float(shape.size_m[0])
    half = 0.5 * float(shape.size_m[1]) if len(shape.size_m) > 1 else 0.0
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    rim = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(CORNERS)])
    if shape.kind == "cylinder":
        return np.vstack([rim + np.array([0.0, 0.0, end]) for end in (-half, half)])
    rings = [
        rim * [np.cos(angle), np.cos(angle), 0.0] + np.array([0.0, 0.0, radius * np.sin(angle) + np.sign(angle) * half])
        for angle in np.linspace(-0.5 * np.pi, 0.5 * np.pi, RINGS)
    ]
    return np.vstack(rings)


def _mesh_points(shape: Shape) -> Array | None:
    if shape.mesh is None or shape.mesh.stat().st_size > HEAVIEST_MESH:
        return None
    try:
        import coal

        loaded = coal.MeshLoader().load(str(shape.mesh), np.array(shape.size_m))
        points = np.array(loaded.vertices(), dtype=np.float64)
    except Exception:  # what assimp meets
        return None
    return points[:: 1 + len(points) // MOST_POINTS] if len(points) > 3 else None
