"""A mesh as a terrain: triangles in the world's frame, cropped, and seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from .elevation import ElevationMap
from .heightfield import MOST_POINTS, WIDEST_M
from .import_options import OTHER_UNIT, ImportOptions, doubt
from .inside_out import ROOM_M, aligned, one_sided, turned
from .obstacles import fan
from .patch import Patch

NEAR_M = 1e-6
"""Nodes this close to a triangle's extent are looked at [m]."""
EDGE = 1e-5
"""A node is under a triangle up to this share beyond its edges: corners are often in single
precision."""
_FLAT_M2 = 1e-14
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
    there = np.flatnonzero((counts > 0) & (np.abs(doubles) >= _FLAT_M2))
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


_WELD_M = 1e-6
"""Corners closer than this are one [m]: STL files have no others."""
_FARTHEST_M = 0.9 * LARGEST
"""No corner of a terrain is farther from the origin [m]."""
_LARGEST_M, _SMALLEST_MESH_M = 50.0, 0.01
"""A terrain is no larger and no smaller than this from end to end [m]: what is, is in another
unit."""
_MOST_COVERED = 2e8
"""Grid points under all triangles of a mesh together, as each has to be looked at."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleMesh:
    """Corners, shape (V, 3) [m], and triangles by their numbers, shape (T, 3), each with an area.

    Seen from where the terrain may be stood on, a triangle's corners turn to the left.

    Arguments:
        name: for messages.
    """

    corners_m: Array
    triangles: NDArray[np.int_]
    name: str

    @classmethod
    def of(
        cls, corners: Array, triangles: NDArray[np.int_], options: ImportOptions, name: str
    ) -> TriangleMesh:
        """Mesh of a file, welded, in the world's frame, cropped.

        Raises InvalidInput where nothing is left, for an unlikely size, and for a solid that is
        inside out.
        """
        with np.errstate(all="ignore"):  # absurd magnitudes end as no area
            corners, triangles = _welded(options.placed(corners), triangles)
        if len(triangles) == 0:
            raise InvalidInput(f"{name}: expected a mesh with triangles, got an empty one")
        corners, triangles = _cropped(corners, triangles, options, name)
        triangles, rooms = one_sided(corners, triangles)
        if rooms:
            doubt(
                f"{name}: {rooms} closed parts that are given from both sides were taken for "
                "solids; crop the ceiling off a room"
            )
        triangles, against = aligned(corners, triangles)
        triangles, count, middle = turned(corners, triangles)
        if middle is not None:
            place = ", ".join(f"{value + 0.0:.3g}" for value in middle.round(6))
            raise InvalidInput(
                f"{name}: expected triangles that turn to the left as seen from outside, got a "
                f"solid about ({place}) m "
                "that is inside out; turn its normals, or crop the ceiling off a room"
            )
        if against:
            doubt(f"{name}: {against} triangles are wound against their neighbours and were turned")
        if count:
            doubt(
                f"{name}: {count} closed parts narrower than {ROOM_M:g} m are inside out and were "
                "turned"
            )
        return cls(corners_m=corners, triangles=triangles, name=name)

    @classmethod
    def as_given(
        cls, corners: Array, triangles: NDArray[np.int_], options: ImportOptions, name: str
    ) -> TriangleMesh:
        """Mesh of a file in the world's frame, cropped, to be seen from above alone: nothing else
        is looked at.

        Raises InvalidInput where nothing is left.
        """
        with np.errstate(all="ignore"):
            corners = options.placed(corners)
        corners, triangles = _cropped(corners, triangles, options, name)
        return cls(corners_m=corners, triangles=triangles, name=name)

    @classmethod
    def of_patches(cls, patches: Sequence[Patch], name: str) -> TriangleMesh:
        """Patches as triangles whose corners turn about their normals."""
        corners = np.concatenate([fan(patch) for patch in patches]).reshape(-1, 3)
        welded = _welded(corners, np.arange(len(corners)).reshape(-1, 3))
        return cls(corners_m=welded[0], triangles=welded[1], name=name)

    @property
    def spread_m(self) -> Array:
        """Corners of the triangles, shape (T, 3, 3) [m]."""
        return np.asarray(self.corners_m[self.triangles])

    def check_size(self) -> None:
        """Raise InvalidInput for a mesh without footholds."""
        size, far = float(np.ptp(self.corners_m, axis=0).max()), np.abs(self.corners_m).max()
        if far > _FARTHEST_M:
            there = ",".join(f"{-round(each)}" for each in self.corners_m.mean(axis=0).tolist())
            raise InvalidInput(
                f"{self.name}: expected a terrain within {_FARTHEST_M:g} m of the origin, got one "
                f"{far:.4g} m away; offset_m moves it, by {there}"
            )
        if size > _LARGEST_M:
            raise InvalidInput(
                f"{self.name}: expected a terrain of at most {_LARGEST_M:g} m from end to end, got "
                f"{size:g} m; {OTHER_UNIT}"
            )
        if size < _SMALLEST_MESH_M:
            raise InvalidInput(
                f"{self.name}: expected a terrain of at least {_SMALLEST_MESH_M:g} m from end to "
                f"end, got {size:g} m; {OTHER_UNIT}"
            )

    def from_above(self, spacing_m: float) -> ElevationMap:
        """The upper side on the largest grid within the extent, with holes where there is no
        triangle.

        Raises InvalidInput for a mesh that is too wide, too small, or takes too long.
        """
        triangles = self.spread_m
        x_m, y_m = _grid_lines(triangles, spacing_m, self.name)
        _check_cover(triangles, spacing_m, self.name)
        heights = raised(triangles, x_m, y_m)
        return ElevationMap(
            x_m=x_m,
            y_m=y_m,
            heights_m=np.where(np.isfinite(heights), heights, np.nan),
            name=self.name,
        )


def _welded(corners: Array, triangles: NDArray[np.int_]) -> tuple[Array, NDArray[np.int_]]:
    """Corners and triangles without corners given twice and triangles without an area."""
    _, first, number = np.unique(
        np.round(corners / _WELD_M), axis=0, return_index=True, return_inverse=True
    )
    corners, triangles = corners[first], number.reshape(-1)[triangles]
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return corners, triangles[area > _WELD_M**2]


def _cropped(
    corners: Array, triangles: NDArray[np.int_], options: ImportOptions, name: str
) -> tuple[Array, NDArray[np.int_]]:
    """Part inside the box, where there is one, with triangles cut at its sides.

    Raises InvalidInput for none.
    """
    if options.crop_m is None:
        return corners, triangles
    from trimesh.intersections import slice_faces_plane

    sliced: Any = slice_faces_plane
    box = options.box_m
    low, high = corners[triangles].min(axis=1), corners[triangles].max(axis=1)
    triangles = triangles[np.all((high >= box[0] - _WELD_M) & (low <= box[1] + _WELD_M), axis=1)]
    for axis in range(3):
        for sign, at in ((1.0, box[0, axis]), (-1.0, box[1, axis])):
            if not np.isfinite(at) or not len(triangles):
                continue
            # what lies on the border belongs to it, of which trimesh keeps what faces inside alone
            normal, origin = sign * np.eye(3)[axis], (at - sign * _WELD_M) * np.eye(3)[axis]
            corners, triangles, *_ = sliced(corners, triangles, normal, origin)
    inside = np.clip(np.asarray(corners, dtype=np.float64), *box)
    corners, triangles = _welded(inside, np.asarray(triangles, dtype=np.int_).reshape(-1, 3))
    if len(triangles) == 0:
        raise InvalidInput(f"{name}: crop_m: expected some of the mesh inside, got none of it")
    return corners, triangles


def _grid_lines(triangles: Array, spacing: float, name: str) -> list[Array]:
    """Grid lines along x and y, a spacing apart, within the extent of triangles."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for axis in range(2):
        if high[axis] - low[axis] > WIDEST_M:
            raise InvalidInput(
                f"{name}: expected {WIDEST_M:g} m or less along {'xy'[axis]}, got "
                f"{high[axis] - low[axis]:g} m; "
                f"{OTHER_UNIT}"
            )
    edge = 1e-9 * (high - low)  # the outermost nodes lie just within the mesh
    counts = np.floor((high - low - 2.0 * edge)[:2] / spacing + 1e-6).astype(int) + 1
    if counts[0] * counts[1] > MOST_POINTS:
        raise InvalidInput(
            f"{name}: expected {MOST_POINTS} grid points or fewer, got {counts[0] * counts[1]}"
        )
    if counts.min() < 4:
        raise InvalidInput(
            f"{name}: expected {4 * spacing:g} m or more at spacing_m={spacing:g}, "
            f"got {high[0] - low[0]:g} x {high[1] - low[1]:g} m"
        )
    lines = [
        np.linspace(low[k] + edge[k], low[k] + edge[k] + (n - 1) * spacing, n)
        for k, n in enumerate(counts)
    ]
    return [np.minimum(line, high[k] - edge[k]) for k, line in enumerate(lines)]


def _check_cover(triangles: Array, spacing: float, name: str) -> None:
    """Raise InvalidInput for triangles that lie over one another so often that reading them takes
    minutes.
    """
    spans = np.ptp(triangles[:, :, :2], axis=1) / spacing + 1.0
    covered = float(np.prod(spans, axis=1).sum())
    if covered > _MOST_COVERED:
        raise InvalidInput(
            f"{name}: expected triangles over {_MOST_COVERED:g} grid points in all or fewer, got "
            f"{covered:.3g}"
        )
