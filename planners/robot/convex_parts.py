"""A mesh as few convex parts, where its hull is much larger than it is: a trunk that is a frame, an
arm that is bent.

The mesh is cut by planes along two of its three axes, and each cell has the hull of the surface in
it. All of the mesh is in these hulls: the surface is, and from a point inside, a line along the
third axis leaves its cell nowhere, and so meets the surface on both sides of the point within the
cell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ..files.arrays import Array
from .meshes import points_on

_FEW_PARTS, MOST_PARTS = 4, 16
"""As many say which two axes are cut along, and as many there are."""
_PLACES, _FINE = 5, 16
"""So many cuts of a cell are tried along each axis; by points on the surface, so many on the
longest side."""
_THIN_M, _AROUND = 1e-5, np.concatenate([np.eye(3), -np.eye(3)])
"""Half of what a flat piece is thick [m]."""
_WORTH, _EACH = 0.25, 0.01
"""Share of the hull's volume that the parts have to save together, and that each cut has to."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cell:
    """A part of the surface between cutting planes.

    Arguments:
        sides: (axis, place, sign) of the planes that it is behind.
        points: on the surface in it, shape (P, 3) [m].
        volume: volume of their hull [m³].
    """

    sides: tuple[tuple[int, float, float], ...]
    points: Array
    volume: float

    @classmethod
    def of(cls, points: Array, sides: tuple[tuple[int, float, float], ...] = ()) -> _Cell:
        corners, volume = _hull(points)
        return cls(sides=sides, points=points if len(corners) else corners, volume=volume)

    def cuts(self, axes: tuple[int, ...]) -> Iterator[tuple[_Cell, _Cell]]:
        """The cell in two, by planes along these axes; the points of a half are those up to the
        plane.
        """
        for axis in axes if self.volume > 0.0 else ():
            along = self.points[:, axis]
            for place in np.linspace(along.min(), along.max(), _PLACES + 2)[1:-1].tolist():
                low, high = ((*self.sides, (axis, place, sign)) for sign in (1.0, -1.0))
                yield (
                    _Cell.of(self.points[along <= place], low),
                    _Cell.of(self.points[along >= place], high),
                )


def convex_parts(vertices_m: Array, faces: NDArray[np.int_]) -> tuple[Array, ...]:
    """Corners of convex parts that hold a mesh, shape (K, 3) [m] each; none where its hull is
    nearly as small.

    Arguments:
        vertices_m: shape (V, 3) [m].
        faces: corners by index, shape (F, 3).
    """
    triangles = np.asarray(vertices_m, dtype=np.float64)[faces]
    volume = _hull(triangles.reshape(-1, 3))[1]
    if volume <= 0.0:
        return ()
    apart_m = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _FINE
    whole = _Cell.of(points_on(triangles, apart_m))
    if whole.volume - min(_volume(pair) for pair in whole.cuts((0, 1, 2))) < _EACH * whole.volume:
        return ()
    best = min(((0, 1), (0, 2), (1, 2)), key=lambda axes: _volume(_parts(whole, axes, _FEW_PARTS)))
    cells = _parts(whole, best, MOST_PARTS)
    parts, left = list[Array](), 0.0
    for cell in cells:
        inside = triangles
        for side in cell.sides:
            inside = _behind(inside, *side)
        points = inside.reshape(-1, 3)
        corners, hull_faces = _hull(points)
        if len(points) and not len(corners):  # a flat piece
            corners, hull_faces = _hull((points[:, None] + _THIN_M * _AROUND).reshape(-1, 3))
        if len(corners):
            parts.append(corners)
            left += hull_faces
    return tuple(parts) if len(parts) > 1 and left <= (1.0 - _WORTH) * volume else ()


def _hull(points: Array) -> tuple[Array, float]:
    """Corners of a hull, shape (K, 3) [m], and its volume [m³]; none where points span none."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # flat, or nothing
        return points[:0], 0.0
    return points[np.sort(hull.vertices)], float(hull.volume)


def _volume(cells: Sequence[_Cell]) -> float:
    return sum(cell.volume for cell in cells)


def _parts(whole: _Cell, axes: tuple[int, ...], most: int) -> list[_Cell]:
    """At most so many cells by cuts along these axes, each time the one that saves the most."""
    cells, best = [whole], dict[tuple[tuple[int, float, float], ...], tuple[_Cell, ...]]()
    while len(cells) < most:
        for cell in cells:
            if cell.sides not in best:
                best[cell.sides] = min(cell.cuts(axes), key=_volume, default=(cell,))
        cut = max(cells, key=lambda cell: cell.volume - _volume(best[cell.sides]))
        if cut.volume - _volume(best[cut.sides]) < _EACH * whole.volume:
            break
        cells = [cell for cell in cells if cell is not cut] + list(best[cut.sides])
    return cells


def _behind(triangles: Array, axis: int, place: float, sign: float) -> Array:
    """Parts of triangles where sign · x ≤ sign · place, as triangles, shape (F, 3, 3)."""
    height = sign * (triangles[:, :, axis] - place)
    inside = height <= 0.0
    count = inside.sum(axis=1)
    pieces = [triangles[count == 3]]
    for corners in (1, 2):
        which = np.flatnonzero(count == corners)
        if not len(which):
            continue
        apex = (inside[which] if corners == 1 else ~inside[which]).argmax(axis=1)
        turn = (apex[:, None] + np.arange(3)) % 3
        points = np.take_along_axis(triangles[which], turn[:, :, None], axis=1)
        heights = np.take_along_axis(height[which], turn, axis=1)
        share = heights[:, :1] / (
            heights[:, :1] - heights[:, 1:]
        )  # from the apex to where its sides are cut
        met = points[:, :1] + share[:, :, None] * (points[:, 1:] - points[:, :1])
        if corners == 1:
            pieces.append(np.concatenate([points[:, :1], met], axis=1))
        else:
            pieces.append(np.concatenate([points[:, 1:], met[:, :1]], axis=1))
            pieces.append(np.stack([points[:, 2], met[:, 1], met[:, 0]], axis=1))
    return np.concatenate(pieces)
