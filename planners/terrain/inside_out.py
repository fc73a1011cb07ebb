"""Test for closed surfaces that show their inside: solids are told apart where they touch, and each
is judged alone.

The winding number of a surface counts how often it goes round a point: 1 in a solid, 0 outside,
also in its cavities, and −1 in a solid whose triangles turn the wrong way. A ray from the point to
infinity leaves the surface as many more times than it enters it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate, maximum_filter, minimum_filter

from ..files.arrays import Array
from .correlation import GroundCells, Labels, Noise, boxed, connected, residuals

_WINDOW_M, _FEWEST = 0.06, 2
"""Half width of the window that a step is looked for in [m], and the fewest cells."""
_SEEN = 4.0
"""Steps are seen that are so many deviations high."""
_RESIDUE = 0.02
"""Share of the variance that is taken for white at least: no noise is as smooth as its model."""
_MEDIAN, _ENOUGH = 0.6745, 40
"""Half of all values of a normal distribution are within so many deviations; and the number of
windows from which the deviation is estimated."""


def half_window(spacing_m: float) -> int:
    """Half width of the window in cells."""
    return max(round(_WINDOW_M / spacing_m), _FEWEST)


def windows(noise: Noise, spacing_m: float) -> Iterator[tuple[Array, float]]:
    """Weights of the heights in windows, shape (h, w), whose sum is the height of a step along the
    middle, in four directions; and the deviation of this height by the noise [m].
    """
    half = half_window(spacing_m)
    between, whole = np.arange(-half, half) + 0.5, np.arange(-half, half + 1.0)
    for rows, turned in ((between, False), (whole, True)):
        i, j = spacing_m * np.stack(np.meshgrid(rows, whole, indexing="ij"))
        step = 0.5 * np.sign(np.round((i + j if turned else i) / spacing_m, 3))
        weights, deviation = _weights(i.ravel(), j.ravel(), step.ravel(), noise)
        weights = weights.reshape(i.shape)
        yield weights, deviation
        yield weights[::-1] if turned else weights.T, deviation


def _weights(x: Array, y: Array, edge: Array, noise: Noise) -> tuple[Array, float]:
    """Weights that estimate the size of an edge beside a plane with the least variance, and the
    standard deviation that the noise leaves to this estimate [m].
    """
    apart = ((x[:, None] - x) ** 2 + (y[:, None] - y) ** 2) / noise.length_m**2
    smooth = min(noise.correlated, 1.0 - _RESIDUE)
    covariance = smooth * np.exp(-apart) + (1.0 - smooth) * np.eye(len(x))
    terms = np.column_stack([edge, np.ones_like(x), x, y])
    weighted = np.linalg.solve(covariance, terms)
    inverse = np.linalg.inv(terms.T @ weighted)
    return weighted @ inverse[0], float(noise.deviation_m * np.sqrt(inverse[0, 0]))


def hidden_edges(
    labels: Labels, cells: GroundCells, noise: Noise
) -> tuple[NDArray[np.bool_], float]:
    """Cells beside edges within surfaces, shape (n, m); and the deviation of a step's height [m].

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        cells: the samples.
        noise: correlated.
    """
    beside_edges = np.zeros(labels.shape, dtype=bool)
    rest, known = residuals(labels, cells), (labels >= 0) & cells.known
    count, total = boxed(np.stack([known, known * rest]).astype(np.float64), 3)
    about = count > 0.5  # a cell without samples is as those about it
    rest = np.where(known, rest, total / np.where(about, count, 1.0))
    usable = np.where(about, labels, -1)
    if cells.sparse:  # the outermost cells have points of what is beside
        low, high = (turn(usable, 3) for turn in (minimum_filter, maximum_filter))
        usable = np.where(low == high, usable, -1)
    unseen = list[float]()
    for weights, deviation in windows(noise, cells.spacing_m):
        shape = weights.shape
        size = np.abs(correlate(rest, weights, mode="nearest"))
        whole = minimum_filter(usable, shape, mode="constant", cval=-1)
        inside = (whole >= 0) & (whole == maximum_filter(usable, shape, mode="constant", cval=-1))
        if not inside.any():
            continue
        if np.count_nonzero(inside) >= _ENOUGH:
            deviation = float(np.median(size[inside])) / _MEDIAN
        unseen.append(deviation)
        beside_edges |= inside & (size > _SEEN * deviation)
    return beside_edges, max(unseen, default=noise.deviation_m)


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
    doubles = np.cross(spread[:, 1] - spread[:, 0], spread[:, 2] - spread[:, 0])
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

    Neighbours share an edge that no third triangle has. Of the two ways to wind a surface that is
    taken which more of its area has as given, and by which more of it looks up: an open surface is
    ground. In one what looks up stays so. Nothing is turned in a surface with a single side.

    Arguments:
        corners: each given once, shape (V, 3) [m].
        triangles: by corners' numbers, shape (T, 3).
    """
    owner, ahead, edge, uses = _edges(triangles, len(corners))
    paired = np.flatnonzero(uses[edge] == 2)
    paired = paired[np.argsort(edge[paired], kind="stable")]
    one, other, against = (
        owner[paired[::2]],
        owner[paired[1::2]],
        ahead[paired[::2]] == ahead[paired[1::2]],
    )
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
    spread = corners[triangles]
    doubles = np.cross(spread[:, 1] - spread[:, 0], spread[:, 2] - spread[:, 0])
    area, up = np.linalg.norm(doubles, axis=1), doubles[:, 2] + _TIE * _volumes(corners, triangles)
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
    normals = np.cross(spread[:, 1] - spread[:, 0], spread[:, 2] - spread[:, 0])
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
