"""A scene on paper: faces in perspective, shaded, drawn from far to near by matplotlib, with labels
where room is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb as rgb, to_rgba
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from stancekit.planners.files.arrays import Array

from .scene import (
    Arrow,
    Box,
    Camera,
    DrawnBody,
    Faces,
    Facet,
    Layer,
    Path,
    Scene,
    Sheet,
    along,
    arrow_profile,
    mesh_of,
    turned,
)

GLASS = 0.10
"""Opacity of terrain between the viewer and the middle of what he looks at."""
_CREASE = 0.92
"""Cosine of the angle between faces beyond which the edge between them is drawn."""
_CIRCLE = np.column_stack(
    [np.cos(turn := np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)), np.sin(turn)]
)
_WEIGHT = {Layer.TERRAIN: 5.0, Layer.SPACE: 1.0, Layer.GLASS: 0.3, Layer.TOP: 4.0}
"""Weight of a label's distance from what is drawn."""


def is_glass(facet: Facet, camera: Camera) -> bool:
    """Tell whether terrain turns its back on the viewer and stands before what he looks at."""
    middle = facet.corners_m.mean(axis=0)
    away = bool(camera.facing(middle, facet.normal) < 0.0)
    return facet.layer == Layer.TERRAIN and away and float(camera.project(middle)[1]) > 0.0


class Still:
    """A painter's algorithm over a scene, as its camera sees it."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.scene, self.camera = scene, camera
        self._faces: list[tuple[tuple[int, float], Array, Any, Any, float]] = []
        for each in scene.sheets:
            self._sheet(each)
        for facet in scene.facets:
            self._facet(facet)
        for body in scene.bodies:
            self._body(body)
        for arrow in scene.arrows:
            self._arrow(arrow)
        for path in scene.paths:
            self._path(path)

    def frame(self) -> tuple[Array, Array]:
        """Corners of what is shown, shape (2,): all of the robot, and of the terrain what is not
        too far from it.
        """
        whole = np.concatenate([face[1] for face in self._faces])
        near = np.concatenate([face[1] for face in self._faces if face[0][0] >= Layer.SPACE])
        low, high = near.min(axis=0), near.max(axis=0)
        room = float(np.max(high - low))
        return np.maximum(whole.min(axis=0), low - room), np.minimum(whole.max(axis=0), high + room)

    def paint(self, axes: Axes) -> float:
        """Draw every face, show all of them at equal scale, write the labels; returns metres to
        0.01 inch of paper.
        """
        faces = sorted(self._faces, key=lambda face: face[0])
        outlines, fills, edges, widths = ([face[k] for face in faces] for k in (1, 2, 3, 4))
        collection = PolyCollection(
            outlines, facecolors=fills, edgecolors=edges, linewidths=widths, joinstyle="round"
        )
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

    def _face(
        self, points: Array, fill: Any, edge: Any, width: float, layer: int, lift_m: float = 0.0
    ) -> None:
        """A polygon, shape (K, 3) [m]."""
        xy, near = self.camera.project(points)
        self._faces.append(((int(layer), float(near.mean()) + lift_m), xy, fill, edge, width))

    def _sheet(self, sheet: Sheet) -> None:
        colours = sheet.colours.reshape(-1, 3)[sheet.faces].mean(axis=1)
        self._solid(sheet.points_m.reshape(-1, 3), sheet.faces, colours, None, Layer.SPACE)

    def _facet(self, facet: Facet) -> None:
        glass, fill = is_glass(facet, self.camera), np.array(rgb(facet.colour))
        if facet.layer in (Layer.TERRAIN, Layer.SPACE):
            fill = 0.6 * fill + 0.4 * self.camera.lit(fill, facet.normal)
        opacity, layer = (
            (GLASS * facet.opacity, Layer.GLASS) if glass else (facet.opacity, facet.layer)
        )
        *edge, strength = to_rgba("none" if facet.edge is None else facet.edge)
        edge.append(strength * (0.2 if glass else 1.0))
        self._face(
            facet.corners_m, (*fill, opacity), edge, facet.width, layer, facet.lift_m - 9.0 * glass
        )

    def _body(self, body: DrawnBody) -> None:
        corners, faces = mesh_of(body.shape)
        points = corners @ body.rotation.T + body.position_m
        if body.opacity < 1.0:
            self._veil(points, faces, body)
        else:
            colours = np.broadcast_to(rgb(body.colour), (len(faces), 3))
            self._solid(points, faces, colours, body.edge, body.layer, body.lift_m)

    def _arrow(self, arrow: Arrow) -> None:
        if arrow.visible:
            corners, faces = turned(
                arrow_profile(float(np.linalg.norm(arrow.vector_m)), arrow.radius_m)
            )
            points = corners @ along(arrow.vector_m).T + arrow.start_m
            self._solid(
                points,
                faces,
                np.broadcast_to(rgb(arrow.colour), (len(faces), 3)),
                "white",
                Layer.TOP,
            )

    def _solid(
        self,
        points: Array,
        faces: Faces,
        colours: Array,
        edge: Any,
        layer: Layer,
        lift_m: float = 0.0,
    ) -> None:
        """The faces that the viewer sees, in the light, with outlines and creases."""
        normals = normals_of(points[faces])
        xy, near = self.camera.project(points)
        front = self.camera.facing(points[faces].mean(axis=1), normals) > 0.0
        depth, lit = near[faces].mean(axis=1) + lift_m, self.camera.lit(colours, normals)
        for k in np.flatnonzero(front):
            fill = tuple(lit[k])
            self._faces.append(((int(layer), float(depth[k])), xy[faces[k]], fill, fill, 0.35))
        if edge is not None:
            pairs, owners = _edges_of(faces)
            sharp = np.sum(normals[owners[:, 0]] * normals[owners[:, 1]], axis=1) < _CREASE
            shown = front[owners].any(axis=1) & (sharp | (front[owners].sum(axis=1) == 1))
            for pair, owner in zip(pairs[shown], owners[shown], strict=True):
                nearest = float(depth[owner][front[owner]].max()) + 1e-3
                self._faces.append(((int(layer), nearest), xy[pair], "none", edge, 1.0))

    def _veil(self, points: Array, faces: Faces, body: DrawnBody) -> None:
        """The silhouette of a convex solid as one translucent face, its edges stronger and those
        behind faint.
        """
        xy, near = self.camera.project(points)
        if np.linalg.matrix_rank(xy - xy[0], tol=1e-6) < 2:
            return
        layer = Layer.GLASS if body.layer == Layer.SPACE else body.layer
        rank, fill = (int(layer), float(near.mean()) + body.lift_m), rgb(body.colour)
        outline = xy[ConvexHull(xy).vertices]
        self._faces.append((rank, outline, (*fill, body.opacity), (*fill, 0.3), 0.9))
        if body.edge is not None:
            normals = normals_of(points[faces])
            front = self.camera.facing(points[faces].mean(axis=1), normals) > 0.0
            pairs, owners = _edges_of(faces)
            sharp = np.sum(normals[owners[:, 0]] * normals[owners[:, 1]], axis=1) < _CREASE
            for pair, owner in zip(pairs[sharp], owners[sharp], strict=True):
                colour = (*rgb(body.edge), 0.6 if front[owner].any() else 0.25)
                self._faces.append((rank, xy[pair], "none", colour, 1.0))

    def _path(self, path: Path) -> None:
        pieces = path.pieces_m
        if path.layer == Layer.SPACE:
            pieces = pieces[~self.inside(pieces.mean(axis=1))]
        colour = (*rgb(path.colour), path.opacity)
        for piece in pieces:
            if path.halo:
                self._face(piece, "none", "white", path.width + 2.2, path.layer, path.lift_m - 9.0)
            self._face(piece, "none", colour, path.width, path.layer, path.lift_m)

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """Tell which points, shape (K, 3), are inside a box."""
        inside = np.zeros(len(points), dtype=bool)
        for body in self.scene.bodies:
            if isinstance(body.shape, Box):
                local = (points - body.position_m) @ body.rotation
                inside |= np.all(np.abs(local) < body.shape.half_m, axis=1)
        return inside

    def _write(self, axes: Axes, scale: float, low: Array, high: Array) -> None:
        """Write each label where it covers the least, the earlier ones first."""
        ink = self._ink(low, high, 5.0 * scale)
        boxes_taken: list[tuple[Array, Array]] = []
        for label in self.scene.labels:
            anchor = self.camera.project(label.position_m)[0]
            half = scale * np.array([6.0 * len(label.text) + 4.0, 13.0])

            def price(centre: Array, half: Array = half, anchor: Array = anchor) -> float:
                corner = np.clip(
                    (np.array([centre - half, centre + half]) - low) / (5.0 * scale), 0, None
                ).round()
                (a, b), (c, d) = np.minimum(corner.astype(int), np.array(ink.shape) - 1).tolist()
                covered = ink[c, d] - ink[a, d] - ink[c, b] + ink[a, b]
                others = sum(
                    bool(np.all(np.abs(centre - at) < half + size)) for at, size in boxes_taken
                )
                outside = bool(np.any(centre - half < low) or np.any(centre + half > high))
                away = float(np.linalg.norm(centre - anchor)) / scale
                return float(covered) + 0.2 * away + 500.0 * others + 1e9 * outside

            rings = [half + gap * scale for gap in (10.0, 35.0, 60.0, 90.0)]
            best = min(
                (anchor + ring * towards for ring in rings for towards in 1.2 * _CIRCLE[::3]),
                key=price,
            )
            boxes_taken.append((best, half))
            axes.text(
                float(best[0]),
                float(best[1]),
                label.text,
                size=12,
                weight="bold",
                color=label.colour,
                ha="center",
                va="center",
                zorder=9,
                parse_math=False,
                path_effects=[withStroke(linewidth=3.0, foreground="white")],
            )

    def _ink(self, low: Array, high: Array, cell: float) -> Array:
        """Amount of ink to the left of and below every corner of a grid of cells over the
        picture.
        """
        faces = [
            (face[1], _WEIGHT[Layer(face[0][0])]) for face in self._faces if face[0][0] in _WEIGHT
        ]
        sizes = [len(outline) for outline, _ in faces]
        corners, starts = (
            np.concatenate([outline for outline, _ in faces]),
            np.cumsum([0, *sizes[:-1]]),
        )
        weights = np.repeat([weight for _, weight in faces], sizes)
        spread = np.maximum.reduceat(corners, starts) - np.minimum.reduceat(corners, starts)
        large = [faces[k] for k in np.flatnonzero(spread.max(axis=1) > 4.0 * cell)]
        inner = [_within(outline) for outline, _ in large]
        corners = np.concatenate([corners, *inner])
        weights = np.concatenate(
            [weights, *(np.full(len(xy), at[1]) for xy, at in zip(inner, large, strict=True))]
        )
        edges = [np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True)]
        counts = np.histogram2d(corners[:, 0], corners[:, 1], bins=edges, weights=weights)[0]
        return np.pad(counts.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))


def normals_of(at: Array) -> Array:
    """Unit normals of faces by their corners, shape (F, 3 or 4, 3)."""
    normals = np.cross(at[:, 2] - at[:, 0], at[:, -1] - at[:, 1])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15))


def _edges_of(faces: Faces) -> tuple[Faces, Faces]:
    """Edges between two faces, shape (E, 2), and the faces, shape (E, 2)."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), faces.shape[1])
    edges, first = np.unique(pairs, axis=0, return_index=True)
    _, last = np.unique(pairs[::-1], axis=0, return_index=True)
    owners = np.stack([owner[first], owner[::-1][last]], axis=1)
    shared = owners[:, 0] != owners[:, 1]
    return edges[shared], owners[shared]


def _within(outline: Array) -> Array:
    """Points on the border of a polygon and between it and its middle."""
    border = np.concatenate([outline, 0.5 * (outline + np.roll(outline, 1, axis=0))])
    middle = outline.mean(axis=0)
    return np.concatenate([border + share * (middle - border) for share in (0.0, 0.4, 0.8)])
