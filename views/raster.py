"""Triangles in perspective with a depth buffer: what a video needs, whose frames share most of what they show.

The camera is a ``Painter``'s; pictures of one moment are painted, films are rasterised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb as rgb
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array

from .painter import Painter

ROUND = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
FINER = 2
"""Rows and columns to a pixel; their mean is what is seen."""
PAPER = 1.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with a normal and a colour at every corner, each of shape (N, 3, 3); points in [m]."""

    points: Array
    normals: Array
    colours: Array

    @classmethod
    def joined(cls, meshes: list[Mesh]) -> Mesh:
        """All triangles of several meshes."""
        return cls(*(np.concatenate([getattr(mesh, n) for mesh in meshes]) for n in ("points", "normals", "colours")))


class Raster:
    """Pixels and their depths. low, high: corners of what is shown on the painter's picture plane, shape (2,) [m]."""

    def __init__(self, painter: Painter, low: Array, high: Array, size_px: tuple[int, int]) -> None:
        self.painter, self.size_px = painter, size_px
        room = FINER * np.array(size_px)
        self._scale = float(np.min(room / (high - low)))
        self._middle = 0.5 * (low + high)
        self._room = room
        self.colours = np.full((room[1], room[0], 3), PAPER, dtype=np.float32)
        self.depths = np.zeros((room[1], room[0]), dtype=np.float32)  # one over the distance, 0 is far away

    def copy(self) -> Raster:
        """The same picture, to be drawn on."""
        other = Raster.__new__(Raster)
        other.__dict__.update(self.__dict__)
        other.colours, other.depths = self.colours.copy(), self.depths.copy()
        return other

    def draw(self, mesh: Mesh, *, raised_m: float = 0.0) -> None:
        """Draw triangles where nothing is nearer; ``raised_m`` brings them nearer in this comparison."""
        flat = mesh.points.reshape(-1, 3)
        plane, near = self.painter.project(flat)
        at = (plane - self._middle) * self._scale * [1.0, -1.0] + 0.5 * self._room
        inverse = 1.0 / np.maximum(self.painter.distance_m - near - raised_m, 1e-3)
        corners, depths = at.reshape(-1, 3, 2), inverse.reshape(-1, 3)
        shades = self._lit(mesh)
        first = np.clip(np.floor(corners.min(axis=1)), 0, self._room).astype(int)
        last = np.clip(np.ceil(corners.max(axis=1)) + 1, 0, self._room).astype(int)
        (ax, ay), (bx, by), (cx, cy) = (corners[:, k].T for k in range(3))
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        for k in np.flatnonzero(np.all(last > first, axis=1) & (np.abs(area) > 1e-9)):
            box = np.s_[first[k, 1] : last[k, 1], first[k, 0] : last[k, 0]]
            x = np.arange(first[k, 0], last[k, 0]) + 0.5 - ax[k]
            y = (np.arange(first[k, 1], last[k, 1]) + 0.5 - ay[k])[:, None]
            second = (x * (cy[k] - ay[k]) - y * (cx[k] - ax[k])) / area[k]
            third = (y * (bx[k] - ax[k]) - x * (by[k] - ay[k])) / area[k]
            one = 1.0 - second - third
            depth = one * depths[k, 0] + second * depths[k, 1] + third * depths[k, 2]
            seen = (one >= 0.0) & (second >= 0.0) & (third >= 0.0) & (depth > self.depths[box])
            if seen.any():
                weights = np.stack([one[seen], second[seen], third[seen]], axis=1)
                self.depths[box][seen] = depth[seen]
                self.colours[box][seen] = weights @ shades[k]

    def pixels(self) -> NDArray[np.uint8]:
        """What is seen, shape (H, W, 3)."""
        width, height = self.size_px
        fine = self.colours.reshape(height, FINER, width, FINER, 3)
        mean = sum(fine[:, i, :, j] for i in range(FINER) for j in range(FINER)) * (255.0 / FINER**2)
        return np.asarray(np.clip(mean, 0.0, 255.0)).astype(np.uint8)

    def _lit(self, mesh: Mesh) -> Array:
        """Colours of the corners in the painter's light."""
        shade = 0.78 + 0.30 * np.clip(mesh.normals @ self.painter.light, -0.4, 1.0)[..., None]
        base = mesh.colours * np.minimum(shade, 1.0)
        return np.asarray(base + (1.0 - base) * np.maximum(0.0, shade - 1.0) * 2.5)


def surface(points: Array, normals: Array, colours: Array) -> Mesh:
    """A sheet of quadrilaterals: corners, normals and colours at the nodes of a grid, shape (n, m, 3)."""
    return Mesh(*(_halves(values) for values in (points, normals, colours)))


def box(centre: Array, turn: Array, half: Array, colour: Any) -> Mesh:
    """A solid box turned by R, half sides of shape (3,) [m]."""
    quads, normals = [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            corners = np.zeros((2, 2, 3))
            corners[..., axis] = side
            corners[..., u] = np.array([-1.0, 1.0])[:, None]
            corners[..., v] = np.array([-1.0, 1.0])
            quads.append(_halves(centre + (corners * half) @ turn.T))
            normals.append(np.broadcast_to(side * turn[:, axis], (2, 3, 3)))
    return _coloured(np.concatenate(quads), np.concatenate(normals), colour)


def tube(start: Array, end: Array, radii: tuple[float, float], colour: Any) -> Mesh:
    """A round tapered bar without its ends."""
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side = side / np.linalg.norm(side)
    ring = np.outer(np.cos([*ROUND, 0.0]), side) + np.outer(np.sin([*ROUND, 0.0]), np.cross(along, side))
    points = np.stack([start + radii[0] * ring, end + radii[1] * ring])
    return _coloured(_halves(points), _halves(np.stack([ring, ring])), colour)


def ball(centre: Array, radius: float, colour: Any) -> Mesh:
    """A ball of 8 by 4 pieces."""
    turns, heights = np.array([*ROUND, 0.0]), np.linspace(-0.5 * np.pi, 0.5 * np.pi, 5)[:, None]
    out = np.stack([np.cos(heights) * np.cos(turns), np.cos(heights) * np.sin(turns), 0 * turns + np.sin(heights)], -1)
    return _coloured(_halves(centre + radius * out), _halves(out), colour)


def arrow(start: Array, vector: Array, thickness: float, colour: Any) -> list[Mesh]:
    """A shaft and a head; nothing for one too short to see."""
    length = float(np.linalg.norm(vector))
    if length < 2.0 * thickness:
        return []
    neck = start + (1.0 - min(5.5 * thickness, 0.6 * length) / length) * vector
    return [
        tube(start, neck, (thickness, thickness), colour),
        tube(neck, start + vector, (2.4 * thickness, 0.0), colour),
    ]


def disc(centre: Array, frame: Array, radius: float, colour: Any) -> Mesh:
    """A flat disc across the third column of a frame, shape (3, 3)."""
    turns = np.array([*ROUND, 0.0])
    ring = centre + radius * np.column_stack([np.cos(turns), np.sin(turns)]) @ frame[:, :2].T
    points = np.stack([np.broadcast_to(centre, (8, 3)), ring[:-1], ring[1:]], axis=1)
    return _coloured(points, np.broadcast_to(frame[:, 2], (8, 3, 3)), colour)


def ribbon(points: Array, painter: Painter, width: float, colour: Any) -> Mesh:
    """A line through points, shape (K, 3), as wide as it is seen [m]."""
    ahead = np.diff(points, axis=0)
    towards = painter.target + painter.distance_m * painter.axes[2] - points[:-1]
    side = np.cross(ahead, towards)
    side = 0.5 * width * side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    a, b, c, d = points[:-1] + side, points[:-1] - side, points[1:] - side, points[1:] + side
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return _coloured(triangles, np.broadcast_to(painter.light, triangles.shape) * 0.7, colour)


def _halves(grid: Array) -> Array:
    """The two triangles of each quadrilateral of a grid of nodes, shape (n, m, 3) → (2 (n − 1)(m − 1), 3, 3)."""
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])


def _coloured(points: Array, normals: Array, colour: Any) -> Mesh:
    return Mesh(points, np.asarray(normals), np.broadcast_to(np.array(rgb(colour)), points.shape))
