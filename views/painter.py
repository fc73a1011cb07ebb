"""A small painter for pictures of scenes: faces in space, seen in perspective, shaded, drawn from far to near."""

from __future__ import annotations

from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb as rgb
from matplotlib.patheffects import withStroke
from scipy.spatial import ConvexHull

from stancekit.planners.files.arrays import Array

GROUND, TERRAIN, ROBOT, VEIL, FORCE = range(5)
"""Layers from the back to the front; within a layer the nearer face covers the farther one."""
UP = np.array([0.0, 0.0, 1.0])
TURN = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])
"""Points round the unit circle, shape (48, 2)."""


class Painter:
    """A painter's algorithm: faces in space, seen in perspective, drawn from far to near in one collection.

    axes: rows right, up and towards the viewer, shape (3, 3); what is at ``target`` is drawn to scale [m].
    """

    def __init__(self, target: Array, azimuth_rad: float, elevation_rad: float, distance_m: float) -> None:
        (a, b), (c, d) = ((np.cos(x), np.sin(x)) for x in (azimuth_rad, elevation_rad))
        self.axes = np.array([[-b, a, 0.0], [-a * d, -b * d, c], [a * c, b * c, d]])
        self.target, self.distance_m = target, distance_m
        self.light = unit(np.array([-0.45, 0.75, 0.55]) @ self.axes)
        self._labels: list[tuple[Array, str, Any]] = []
        self._faces: list[tuple[tuple[int, float], Array, Any, Any, float]] = []

    def project(self, points: Array) -> tuple[Array, Array]:
        """Points, shape (K, 3), on the picture plane, shape (K, 2) [m], and how near they are, shape (K,) [m]."""
        local = (np.atleast_2d(points) - self.target) @ self.axes.T
        away = np.maximum(self.distance_m - local[:, 2], 0.2 * self.distance_m)  # what is behind the viewer stays ahead
        return local[:, :2] * (self.distance_m / away)[:, None], local[:, 2]

    def near(self, point: Array) -> float:
        """How near one point is [m]."""
        return float(self.project(point)[1][0])

    def facing(self, point: Array, normal: Array) -> float:
        """Cosine of the angle at which the viewer sees a face; negative from behind."""
        return float(normal @ unit(self.target + self.distance_m * self.axes[2] - point))

    def lit(self, colour: Any, normal: Array, alpha: float = 1.0) -> tuple[float, ...]:
        """The colour of a face with this normal in the light from above left."""
        shade = 0.78 + 0.30 * float(np.clip(normal @ self.light, -0.4, 1.0))
        base = np.array(rgb(colour)) * min(shade, 1.0)
        return (*(base + (1.0 - base) * max(0.0, shade - 1.0) * 2.5), alpha)

    def face(
        self, points: Array, fill: Any, layer: int, *, edge: Any = None, width: float = 0.0, depth: float | None = None
    ) -> None:
        """A polygon, shape (K, 3) [m]; ``depth`` replaces the mean nearness of its corners."""
        xy, near = self.project(points)
        key = (layer, float(near.mean()) if depth is None else depth)
        self._faces.append((key, xy, fill, fill if edge is None else edge, width))

    def prism(self, top: Array, bottom: Array, colour: Any, layer: int, edge: Any, alpha: float = 1.0) -> None:
        """The sides of a convex prism that the viewer sees, rings of shape (K, 3) [m]."""
        centre = 0.5 * (top + bottom).mean(axis=0)
        for k in range(len(top)):
            quad = np.array([top[k], top[k - 1], bottom[k - 1], bottom[k]])
            normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
            normal = unit(normal) * np.sign((quad.mean(axis=0) - centre) @ normal)
            if self.facing(quad.mean(axis=0), normal) > 0.0:
                self.face(quad, self.lit(colour, normal, alpha), layer, edge=edge, width=0.7)

    def veil(self, points: Array, colour: Any, alpha: float, edge_alpha: float) -> None:
        """The silhouette of a convex solid as one translucent face."""
        xy, _ = self.project(points)
        if np.linalg.matrix_rank(xy - xy[0], tol=1e-6) == 2:
            outline = points[ConvexHull(xy).vertices]
            self.face(outline, (*rgb(colour), alpha), VEIL, edge=(*rgb(colour), edge_alpha), width=0.9)

    def tube(self, start: Array, end: Array, radii: tuple[float, float], colour: Any, layer: int, rim: Any) -> None:
        """A round tapered bar as shaded strips with a rim, in pieces so that each has its own depth."""
        across = np.cross(end - start, self.target + self.distance_m * self.axes[2] - start)
        if np.linalg.norm(across) < 1e-9:
            return
        side, out = unit(across), unit(np.cross(across, end - start))
        stations = np.linspace(0.0, 1.0, 7)[:, None]
        line, wide = start + stations * (end - start), (radii[0] + stations * (radii[1] - radii[0])) * side
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 8)
        behind = max(radii) + abs(self.near(end) - self.near(start)) / 6.0  # a rim never covers the next piece
        for k in range(6):
            (a, b), (r, s) = line[k : k + 2], wide[k : k + 2]
            depth, extra = self.near(0.5 * (a + b)), 0.0022 * side
            rims = np.array([a + r + extra, b + s + extra, b - s - extra, a - r - extra])
            self.face(rims, rim, layer, depth=depth - behind)
            for low, high in pairwise(angles):
                middle, (i, j) = 0.5 * (low + high), np.sin([low, high])
                fill = self.lit(colour, np.sin(middle) * side + np.cos(middle) * out)
                self.face(np.array([a + i * r, b + i * s, b + j * s, a + j * r]), fill, layer, width=0.25, depth=depth)

    def ball(self, centre: Array, radius: float, colour: Any, layer: int, rim: Any) -> None:
        """A shaded ball as discs that close in on its lit side."""
        depth = self.near(centre) + 0.5 * radius
        disc = CIRCLE @ self.axes[:2]
        self.face(centre + (radius + 0.0022) * disc, rim, layer, depth=depth)
        lit_side = (self.axes[:2] @ self.light) @ self.axes[:2]
        for share in np.linspace(0.0, 0.85, 7):
            normal = unit((1.0 - share) * (self.axes[2] - lit_side) + share * self.light)
            points = centre + 0.55 * share * radius * lit_side + (1.0 - share) * radius * disc
            self.face(points, self.lit(colour, normal), layer, depth=depth)

    def arrow(self, start: Array, vector: Array, colour: Any, thickness: float) -> None:
        """A shaded arrow with a white rim; nothing for one too short to see."""
        length = float(np.linalg.norm(vector))
        if length > 2.0 * thickness:
            neck = start + (1.0 - min(5.5 * thickness, 0.6 * length) / length) * vector
            self.tube(start, neck, (thickness, thickness), colour, FORCE, "white")
            self.tube(neck, start + vector, (2.4 * thickness, 0.0), colour, FORCE, "white")

    def plane(self, axis: int, level: float, low: Array, high: Array, step: float) -> None:
        """A pale piece of the plane across one axis at this level, with grid lines at multiples of ``step``."""
        first, second = (k for k in range(3) if k != axis)

        def at(*pairs: tuple[float, float]) -> Array:
            points = np.full((len(pairs), 3), level)
            points[:, [first, second]] = pairs
            return points

        (a, c), (b, d) = low[[first, second]], high[[first, second]]
        self.face(at((a, c), (b, c), (b, d), (a, d)), "#f3f5f7", GROUND, edge="#c3cad2", width=1.0, depth=-9.0)
        for u in step * np.arange(np.ceil(a / step), b / step):
            self.face(at((u, c), (u, d)), "none", GROUND, edge="#dde2e8", width=0.8, depth=-7.0)
        for v in step * np.arange(np.ceil(c / step), d / step):
            self.face(at((a, v), (b, v)), "none", GROUND, edge="#dde2e8", width=0.8, depth=-7.0)

    def stone(self, top: Array, axis: int, level: float, colour: Any, edge: Any) -> None:
        """A block from the plane across an axis up to a coloured polygon, shape (K, 3), its sides a tint of the colour.

        Where the viewer stands behind the polygon, the block is of glass and in front of all that is solid.
        """
        foot = top.copy()
        foot[:, axis] = level
        tint = 0.35 * np.array(rgb(colour)) + 0.65 * np.array(rgb("#dcd8d0"))
        middle, normal = top.mean(axis=0), np.cross(top[1] - top[0], top[2] - top[0])
        behind = self.facing(middle, normal * ((middle - foot.mean(axis=0)) @ normal)) < 0.0
        layer, alpha, raised = (VEIL, 0.3, -1.0) if behind else (TERRAIN, 1.0, 0.05)
        self.prism(top, foot, tint, layer, (*(0.75 * tint), alpha), alpha)
        fill = (*rgb(colour), 0.75 if behind else 1.0)
        self.face(top, fill, layer, edge=edge, width=1.0, depth=self.near(middle) + raised)

    def box(self, low: Array, high: Array, colour: Any) -> None:
        """A translucent box along the axes, its hidden edges faint."""
        corner = np.array(list(product((0, 1), repeat=3)))
        points = np.where(corner == 1, high, low)
        self.veil(points, colour, 0.05, 0.0)
        back = int(np.argmin(self.project(points)[1]))
        for i, j in combinations(range(8), 2):
            if np.sum(corner[i] != corner[j]) == 1:
                faint = 0.25 if back in (i, j) else 0.85
                self.face(points[[i, j]], "none", VEIL, edge=(*rgb(colour), faint), width=1.2)

    def dashes(self, points: Array, colour: Any, layer: int, *, width: float, depth: float | None = None) -> None:
        """A dashed line through points, shape (K, 3), that are half a dash apart."""
        for start in range(0, len(points) - 1, 2):
            self.face(points[start : start + 2], "none", layer, edge=colour, width=width, depth=depth)

    def label(self, point: Array, text: str, colour: Any) -> None:
        """Words to stand beside a point, where they cover little."""
        self._labels.append((self.project(point)[0][0], text, colour))

    def paint(self, axes: Axes) -> float:
        """Draw every face, show all of them at equal scale, write the labels; returns metres to 0.01 inch of paper."""
        faces = sorted(self._faces, key=lambda face: face[0])
        outlines, fills, edges, widths = ([face[k] for face in faces] for k in (1, 2, 3, 4))
        collection = PolyCollection(outlines, facecolors=fills, edgecolors=edges, linewidths=widths, joinstyle="round")
        axes.add_collection(collection, autolim=False)
        low, high = self.frame()
        paper = 100.0 * np.array(axes.bbox.size) / axes.figure.dpi
        scale = float(np.max((high - low) / paper))
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * scale * paper, middle + 0.5 * scale * paper
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        self._write(axes, scale, low, high)
        return scale

    def frame(self) -> tuple[Array, Array]:
        """Corners of what is shown, shape (2,): all of the robot, and of the terrain what is not too far from it."""
        whole = np.concatenate([face[1] for face in self._faces])
        near = np.concatenate([face[1] for face in self._faces if face[0][0] in (ROBOT, VEIL, FORCE)])
        low, high = near.min(axis=0), near.max(axis=0)
        room = float(np.max(high - low))
        return np.maximum(whole.min(axis=0), low - room), np.minimum(whole.max(axis=0), high + room)

    def _write(self, axes: Axes, scale: float, low: Array, high: Array) -> None:
        """Write each label where it covers the least, the earlier ones first."""
        weight = {TERRAIN: 5.0, ROBOT: 1.0, VEIL: 0.3, FORCE: 4.0}
        drawn = [(_inked(face[1]), weight[face[0][0]]) for face in self._faces if face[0][0] in weight]
        ink = np.concatenate([xy for xy, _ in drawn])
        cost = np.concatenate([np.full(len(xy), share) for xy, share in drawn])
        taken: list[tuple[Array, Array]] = []
        for anchor, text, colour in self._labels:
            half = scale * np.array([6.0 * len(text) + 4.0, 13.0])

            def price(centre: Array, half: Array = half, anchor: Array = anchor) -> float:
                covered = float(np.sum(cost[np.all(np.abs(ink - centre) < half, axis=1)]))
                others = sum(bool(np.all(np.abs(centre - at) < half + size)) for at, size in taken)
                outside = bool(np.any(centre - half < low) or np.any(centre + half > high))
                away = float(np.linalg.norm(centre - anchor)) / scale
                return covered + 0.2 * away + 500.0 * others + 1000.0 * outside

            rings = [half + gap * scale for gap in (10.0, 35.0, 60.0, 90.0)]
            places = [anchor + ring * way for ring in rings for way in 1.2 * CIRCLE[::3]]
            best = min(places, key=price)
            taken.append((best, half))
            axes.text(
                float(best[0]), float(best[1]), text, size=12, weight="bold", color=colour, ha="center", va="center",
                zorder=9, parse_math=False, path_effects=[withStroke(linewidth=3.0, foreground="white")],
            )  # fmt: skip


def _inked(outline: Array) -> Array:
    """Points on a polygon: its corners, and where they are few, also points between them and its middle."""
    if len(outline) > 5:
        return outline
    edges = 0.5 * (outline + np.roll(outline, 1, axis=0))
    inner = [outline + share * (outline.mean(axis=0) - outline) for share in (0.4, 0.8)]
    return np.concatenate([outline, edges, *inner])


def unit(vector: Array) -> Array:
    """The vector over its length; zero stays zero."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))
