"""A mesh as a terrain: triangles in the world's frame, cropped, and seen from above.

Closed surfaces that show their inside are found: solids are told apart where they touch, and each is
judged alone. The winding number of a surface counts how often it goes round a point: 1 in a solid,
0 outside, also in its cavities, and −1 in a solid whose triangles turn the wrong way. A ray from the
point to infinity leaves the surface as many more times than it enters it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array, flat_cross
from .elevation import ElevationMap
from .heightfield import MOST_POINTS, WIDEST_M, HeightField
from .import_options import OTHER_UNIT, ImportOptions, doubt
from .obstacles import fan
from .patch import Patch

_LEAST_M3 = 1e-6
"""Volume below which a solid is not judged [m³]."""
OFF = 1e-3
"""Distance of a sample from its triangle, as a share of the root of the triangle's area."""
ROOM_M = 0.4
"""A solid that is narrower along an axis has no room inside for a robot [m]."""
_FLAT = 1e-6
"""A surface is flat where the sum of its areas as vectors is shorter than that of their lengths by
no larger a share."""
_TIE = 1e-3
"""Weight of the volume that a surface encloses beside its area, where as much is wound one way as the
other [1/m]."""
_PAIRED, _STRAIGHT = np.array([[0, 1], [0, 2], [1, 2]]), 0.9
"""Of three triangles at an edge two go on in one another whose planes are alike within this cosine."""
_PAIRED.setflags(write=False)
_SAMPLES = 3
"""Triangles of a piece, its largest ones, that are looked at."""
_FINEST, _MOST_ENTRIES = 512, 4_000_000
"""Cells along each side of the table of triangles that rays are looked up in, and its entries, at
most."""
_MOST_PAIRS = 20_000_000
"""Rays times triangles near them that are looked at; what is beyond, on the smallest triangles, is
not judged."""
_RAY = np.array(
    [
        [0.736167, -0.543238, 0.403671],
        [0.676762, 0.597202, -0.430515],
        [-0.007201, 0.590120, 0.807283],
    ]
)
"""Axes in columns, the last of them along the rays: no terrain's edges are parallel to it."""


def connected(
    one: NDArray[np.int_], other: NDArray[np.int_], count: int
) -> tuple[int, NDArray[np.int_]]:
    """Number of parts that hang together by pairs of so many things, and the part of each: as
    SciPy's ``connected_components``, which takes longer to import than most meshes to read.
    """
    part = np.arange(count)
    while (apart := part[one] != part[other]).any():
        one, other = one[apart], other[apart]
        np.minimum.at(part, *np.sort([part[one], part[other]], axis=0)[::-1])
        while np.any(part != part[part]):
            part = part[part]
    first = part == np.arange(count)
    return int(first.sum()), (np.cumsum(first) - 1)[part]


def doubled(spread: Array) -> Array:
    """Normals as long as twice the area, shape (T, 3), of triangles, shape (T, 3, 3)."""
    return np.cross(spread[:, 1] - spread[:, 0], spread[:, 2] - spread[:, 0])


def turned(
    corners: Array, triangles: NDArray[np.int_]
) -> tuple[NDArray[np.int_], int, Array | None]:
    """Triangles of which narrow solids that are inside out are turned, how many such solids there
    were, and a place in another solid that is inside out and may be a room; None without one.

    Arguments:
        corners: each given once, shape (V, 3) [m].
        triangles: by corners' numbers, shape (T, 3).

    Returns:
        Triangles, shape (T, 3); a count; a place, shape (3,) [m].
    """
    wrong = _inside_out(corners, triangles)
    count = 0
    if wrong is not None:
        piece, _, pieces = wrong
        narrow = np.zeros(len(triangles), dtype=bool)
        for number in np.unique(pieces):
            mine = piece == number
            if np.ptp(corners[triangles[mine]].reshape(-1, 3), axis=0).min() < ROOM_M:
                narrow |= mine
                count += 1
        triangles = np.where(narrow[:, None], triangles[:, ::-1], triangles)
    return triangles, count, inside_out(corners, triangles) if wrong is not None else None


def one_sided(corners: Array, triangles: NDArray[np.int_]) -> tuple[NDArray[np.int_], int]:
    """Triangles, each once, without the inner side of what is given from both sides, and how many
    solids of these have room inside.

    A surface that is closed keeps the side that looks out; one that is open and not flat the side
    that looks up; a flat sheet both.

    Arguments:
        corners: each given once, shape (V, 3) [m].
        triangles: by corners' numbers, shape (T, 3).
    """
    first = np.arange(3)[None] + triangles.argmin(axis=1)[:, None]
    _, once = np.unique(np.take_along_axis(triangles, first % 3, axis=1), axis=0, return_index=True)
    triangles = triangles[np.sort(once)]
    _, face, sides = np.unique(
        np.sort(triangles, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    face = face.reshape(-1)
    both = np.flatnonzero(sides[face] == 2)
    if not len(both):
        return triangles, 0
    owner, ahead, edge, uses = _edges(triangles[both], len(corners))
    of_two = np.flatnonzero(uses[edge] == 4)
    order = np.lexsort((face[both][owner[of_two]], ahead[of_two], edge[of_two]))
    one, other, ahead_one, ahead_other = owner[of_two[order]].reshape(-1, 4).T
    piece = connected(
        np.concatenate([one, other]), np.concatenate([ahead_other, ahead_one]), len(both)
    )[1]
    spread = corners[triangles[both]]
    doubles = doubled(spread)
    areas = np.bincount(piece, np.linalg.norm(doubles, axis=1))
    sums = np.stack([np.bincount(piece, each) for each in doubles.T], axis=1)
    closed = _balanced(piece[owner], edge, np.where(ahead, 1, -1))
    flat = np.linalg.norm(sums, axis=1) > (1.0 - _FLAT) * areas
    volume = np.bincount(piece, _volumes(corners, triangles[both]))
    inner = np.where(closed, volume < 0.0, ~flat & (sums[:, 2] < 0.0))
    rooms = 0
    for number in np.flatnonzero(closed & (volume > ROOM_M**3)):
        rooms += bool(np.ptp(spread[piece == number].reshape(-1, 3), axis=0).min() >= ROOM_M)
    left = np.ones(len(triangles), dtype=bool)
    left[both[inner[piece]]] = False
    return triangles[left], rooms


def aligned(corners: Array, triangles: NDArray[np.int_]) -> tuple[NDArray[np.int_], int]:
    """Triangles, those turned that are wound against their neighbours, and how many these are.

    Neighbours share an edge that no third triangle has, or are the two of three that go on in one
    another, as a floor does below a wall. Of the two ways to wind a surface that is taken which more
    of its area has as given, and by which more of it looks up: an open surface is ground. In one
    what looks up stays so. Nothing is turned in a surface with a single side.

    Arguments:
        corners: each given once, shape (V, 3) [m].
        triangles: by corners' numbers, shape (T, 3).
    """
    owner, ahead, edge, uses = _edges(triangles, len(corners))
    order = np.argsort(edge, kind="stable")
    two, three = (order[uses[edge[order]] == count].reshape(-1, count) for count in (2, 3))
    doubles = doubled(corners[triangles])
    area = np.linalg.norm(doubles, axis=1)
    faces = np.where(ahead, 1.0, -1.0)[:, None] * (doubles / area[:, None])[owner]
    straight = -np.stack([np.vecdot(*faces[three[:, pair]].swapaxes(0, 1)) for pair in _PAIRED], 1)
    going_on = np.take_along_axis(three, _PAIRED[straight.argmax(axis=1)], axis=1)
    pairs = np.concatenate([two, going_on[straight.max(axis=1) > _STRAIGHT]])
    (one, other), against = owner[pairs].T, ahead[pairs[:, 0]] == ahead[pairs[:, 1]]
    if not against.any():
        return triangles, 0
    count = len(triangles)
    given, opposite = np.split(
        connected(
            np.concatenate([one, one + count]),
            np.concatenate([other + count * against, other + count * ~against]),
            2 * count,
        )[1],
        2,
    )
    up = doubles[:, 2] + _TIE * _volumes(corners, triangles)
    share = np.bincount(given, area + up, 2 * count) - np.bincount(opposite, up, 2 * count)
    wrong = share[given] < share[opposite]
    sides, ahead, edge, _ = _edges(
        np.where(wrong[:, None], triangles[:, ::-1], triangles), len(corners)
    )
    piece = np.minimum(given, opposite)
    closed = _balanced(piece[sides], edge, np.where(ahead, 1, -1))
    wrong &= (doubles[:, 2] < _FLAT * area) | closed[piece]
    return np.where(wrong[:, None], triangles[:, ::-1], triangles), int(wrong.sum())


def inside_out(corners: Array, triangles: NDArray[np.int_]) -> Array | None:
    """A place in a solid whose triangles turn to the left as seen from its inside, shape (3,) [m];
    None without one.

    Surfaces that are open are not judged.

    Arguments:
        corners: each given once, shape (V, 3) [m].
        triangles: by corners' numbers, shape (T, 3).
    """
    wrong = _inside_out(corners, triangles)
    return None if wrong is None else np.asarray(wrong[1])


def _inside_out(
    corners: Array, triangles: NDArray[np.int_]
) -> tuple[NDArray[np.int_], Array, NDArray[np.int_]] | None:
    """The piece of each triangle, a place in a solid that is inside out, and the pieces of all such
    solids; None without one.
    """
    piece, suspects, closed = _pieces(corners, triangles)
    if not len(suspects):
        return None
    spread = corners[triangles]
    normals = doubled(spread)
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    order = np.lexsort((-areas, piece))
    rank = np.arange(len(order)) - np.searchsorted(piece[order], piece[order])
    samples = order[(rank < _SAMPLES) & np.isin(piece[order], suspects)]
    samples = samples[np.argsort(-areas[samples], kind="stable")]
    off = (
        OFF * np.sqrt(areas[samples])[:, None] * normals[samples] / (2.0 * areas[samples])[:, None]
    )
    points = spread[samples].mean(axis=1) + off
    wrong = np.flatnonzero(_winding(spread[closed], points) < 0)
    return (piece, points[wrong[0]], piece[samples[wrong]]) if len(wrong) else None


def _pieces(
    corners: Array, triangles: NDArray[np.int_]
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.bool_]]:
    """The piece of each triangle, shape (T,); pieces that may be inside out; which triangles are of
    closed surfaces.

    A piece hangs together by edges of two triangles. It is closed where each of its edges is gone
    along as often one way as the other; pieces that are open, and share edges with others, may be
    closed together.
    """
    owner, upward, edge, uses = _edges(triangles, len(corners))
    ahead = np.where(upward, 1, -1)
    paired = np.flatnonzero(uses[edge] == 2)
    paired = paired[np.argsort(edge[paired], kind="stable")]
    piece = connected(owner[paired[::2]], owner[paired[1::2]], len(triangles))[1]
    alone = _balanced(piece[owner], edge, ahead)
    volume = np.bincount(piece, _volumes(corners, triangles))
    # pieces that are open, by the edges that they share
    first = np.full(len(uses), -1)
    first[edge] = piece[owner]
    group = connected(first[edge], piece[owner], len(alone))[1]
    opened = ~alone[piece[owner]]
    together = _balanced(
        group[piece[owner]][opened], edge[opened], ahead[opened], int(group.max()) + 1
    )[group]
    suspects = np.flatnonzero((alone & (volume < -_LEAST_M3)) | (~alone & together))
    return piece, suspects, (alone | together)[piece]


def _edges(
    triangles: NDArray[np.int_], corners: int
) -> tuple[NDArray[np.int_], NDArray[np.bool_], NDArray[np.int_], NDArray[np.int_]]:
    """Sides of triangles, three of each: its triangle, whether it goes from the lower corner's
    number to the higher, and its edge; and how many sides each edge has.
    """
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    key = sides.min(axis=1) * corners + sides.max(axis=1)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    return np.repeat(np.arange(len(triangles)), 3), sides[:, 0] < sides[:, 1], edge, uses


def _balanced(
    owner: NDArray[np.int_],
    edge: NDArray[np.int_],
    ahead: NDArray[np.int_],
    count: int | None = None,
) -> NDArray[np.bool_]:
    """For each owner whether all of its edges are gone along as often one way as the other."""
    count = int(owner.max(initial=-1)) + 1 if count is None else count
    if not len(edge):
        return np.zeros(count, dtype=bool)
    pairs, number = np.unique(owner * (int(edge.max()) + 1) + edge, return_inverse=True)
    odd = pairs[np.bincount(number, ahead) != 0] // (int(edge.max()) + 1)
    balanced = np.zeros(count, dtype=bool)
    balanced[owner] = True
    balanced[odd] = False
    return balanced


def _volumes(corners: Array, triangles: NDArray[np.int_]) -> Array:
    """The share of each triangle in the volume that they enclose, by the divergence theorem, shape
    (T,) [m³].
    """
    a, b, c = (corners[triangles[:, i]] - corners.mean(axis=0) for i in range(3))
    return np.asarray(np.vecdot(a, np.cross(b, c)) / 6.0)


def _winding(surface: Array, points: Array) -> NDArray[np.int_]:
    """Winding number of closed triangles, shape (T, 3, 3), about points, shape (P, 3); 0 for points
    not looked at.
    """
    turned, rays = surface @ _RAY, points @ _RAY
    flat, low = turned[:, :, :2], turned[:, :, :2].min(axis=(0, 1))
    size = np.maximum(flat.max(axis=(0, 1)) - low, 1e-9) * (1.0 + 1e-9)
    cells = _FINEST
    while True:
        first, last = (
            ((edge - low) / size * cells).astype(int)
            for edge in (flat.min(axis=1), flat.max(axis=1))
        )
        wide = last - first + 1
        count = wide.prod(axis=1)
        if count.sum() <= _MOST_ENTRIES or cells == 1:
            break
        cells //= 2
    owner = np.repeat(np.arange(len(flat)), count)
    step = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    cell = (
        (first[owner, 0] + step // wide[owner, 1]) * cells + first[owner, 1] + step % wide[owner, 1]
    )
    order = np.argsort(cell, kind="stable")
    cell, owner = cell[order], owner[order]
    place = ((rays[:, :2] - low) / size * cells).astype(int).clip(-1, cells) @ [cells, 1]
    begin = np.searchsorted(cell, place)
    near = np.searchsorted(cell, place, side="right") - begin
    near = np.where(np.cumsum(near) <= _MOST_PAIRS, near, 0)
    ray = np.repeat(np.arange(len(rays)), near)
    triangles_of_ray = owner[begin[ray] + np.arange(len(ray)) - (np.cumsum(near) - near)[ray]]
    sides = turned[triangles_of_ray] - rays[ray][:, None]
    x, y = sides[:, :, 0], sides[:, :, 1]
    weights = np.roll(x, -1, axis=1) * np.roll(y, -2, axis=1) - np.roll(x, -2, axis=1) * np.roll(
        y, -1, axis=1
    )
    whole = weights.sum(axis=1)
    inside = np.all(weights * np.sign(whole)[:, None] > 0.0, axis=1)
    ahead = inside & (np.vecdot(weights, sides[:, :, 2]) * np.sign(whole) > 0.0)
    leaves = np.sign(whole[ahead]).astype(int)
    return np.bincount(ray[ahead], leaves, minlength=len(rays)).round().astype(int)


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
    first, last = (
        np.stack([np.searchsorted(x_m, end[:, 0]), np.searchsorted(y_m, end[:, 1])], axis=1)
        for end in (low, high)
    )
    counts = (last - first).prod(axis=1)
    a, b, c = (flat[:, corner] for corner in range(3))
    doubles = flat_cross(b - a, c - a)
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

    def off_m(self, heights: HeightField, share: float) -> float:
        """The most that heights are off what is seen from above at a share of the way from each line
        of their grid to the next, where edges on lines show, and slots between them [m].
        """
        lines = [each[:-1] + share * np.diff(each) for each in (heights.x_m, heights.y_m)]
        seen = raised(self.spread_m, *lines)
        away = seen - heights.height(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1))
        return float(np.abs(away[np.isfinite(seen)]).max(initial=0.0))


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
