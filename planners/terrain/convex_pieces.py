"""Plane polygons, maybe with holes, cut into few convex pieces: triangles, merged while they stay
convex.

After Hertel and Mehlhorn (1983): never more than four times as many pieces as there need be.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..files.arrays import Array

STRAIGHT = 1e-3
"""Sine of a turn that counts as none: 57 mm off on 57 m."""
SAME_M = 1e-9
"""Corners closer than this are one."""

Loop = list[int]
Point = Sequence[float]
Corners = dict[int, Point]


def convex_pieces(polygon: Any) -> list[Array]:
    """The pieces of a polygon of shapely's, each by its corners to the left, shape (U, 2) [m]."""
    outline = np.asarray(polygon.exterior.coords)[:-1]
    if not polygon.interiors:
        outline = outline if polygon.exterior.is_ccw else outline[::-1]
        loop = list(range(len(outline)))
        flat = dict(enumerate(outline.tolist()))
        turns = _turns(loop, flat)
        if np.all(turns > 0.0):
            return [outline]
        if np.all(turns > -STRAIGHT) and np.sum(turns > STRAIGHT) > 2:
            return [_exact(outline[turns > STRAIGHT])]
    import shapely

    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = np.array([np.asarray(triangle.exterior.coords)[:3] for triangle in triangles])
    _, first, number = np.unique(
        np.round(corners.reshape(-1, 2) / SAME_M), axis=0, return_index=True, return_inverse=True
    )
    points = corners.reshape(-1, 2)[first]
    loops = number.reshape(-1, 3)
    a, b, c = (points[loops[:, i]] for i in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    loops = np.where((area < 0.0)[:, None], loops[:, ::-1], loops)[np.abs(area) > SAME_M**2]
    return [
        _exact(points[loop])
        for loop in _merged(loops.tolist(), dict(enumerate(points.tolist())))
        if len(loop) > 2
    ]


def _exact(piece: Array) -> Array:
    """A piece that is convex but for what counts as straight, convex to the last bit."""
    loop = list(range(len(piece)))
    if np.all(_turns(loop, dict(enumerate(piece.tolist()))) > 0.0):
        return piece
    import shapely

    hull = shapely.MultiPoint(piece).convex_hull
    return np.asarray(hull.exterior.coords)[-2::-1] if hull.geom_type == "Polygon" else piece


def _merged(loops: list[Loop], flat: Corners) -> list[Loop]:
    """Loops that touch along edges, merged pair by pair while the union stays convex."""
    pieces, merged = dict(enumerate(loops)), True
    while merged:
        merged, changed = False, set[int]()
        for one, other in _touching(pieces):
            if changed & {one, other}:
                continue
            union = _border([pieces[one], pieces[other]])
            if union is not None and _convex(union, flat):
                pieces[one], merged = union, True
                changed |= {one, other}
                del pieces[other]
    return [_straightened(loop, flat) for loop in pieces.values()]


def _border(loops: list[Loop]) -> Loop | None:
    """The border of pieces that touch along edges, as one loop; None where it is not one (holes,
    pinched corners).
    """
    edges = {(a, b) for loop in loops for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)}
    following = {a: b for a, b in edges if (b, a) not in edges}
    open_edges = sum((b, a) not in edges for a, b in edges)
    if len(following) != open_edges or not following:
        return None
    start = min(following)
    loop = [start]
    while (ahead := following[loop[-1]]) != start:
        loop.append(ahead)
        if len(loop) > open_edges or ahead not in following:
            return None
    return loop if len(loop) == open_edges else None


def _touching(pieces: dict[int, Loop]) -> list[tuple[int, int]]:
    """Pairs of pieces that share an edge, those that share most first."""
    owner = {
        (a, b): key
        for key, loop in pieces.items()
        for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)
    }
    pairs = Counter[tuple[int, int]]()
    for (a, b), key in owner.items():
        other = owner.get((b, a))
        if other is not None and key < other:
            pairs[key, other] += 1
    return [pair for pair, _ in pairs.most_common()]


def _turns(loop: Loop, flat: Corners) -> Array:
    """Sine of the turn at every corner, positive to the left, shape (len(loop),)."""
    return np.array([_turn(flat[a], flat[b], flat[c]) for a, b, c in _corners(loop)])


def _corners(loop: Loop) -> Iterator[tuple[int, int, int]]:
    """Each corner of a loop between the one before and the one after it."""
    return zip([loop[-1], *loop[:-1]], loop, [*loop[1:], loop[0]], strict=True)


def _turn(before: Point, here: Point, after: Point) -> float:
    """Sine of the turn at a corner, positive to the left."""
    into_x, into_y, out_x, out_y = (
        here[0] - before[0],
        here[1] - before[1],
        after[0] - here[0],
        after[1] - here[1],
    )
    return (into_x * out_y - into_y * out_x) / max(
        math.hypot(into_x, into_y) * math.hypot(out_x, out_y), 1e-300
    )


def _convex(loop: Loop, flat: Corners) -> bool:
    return all(_turn(flat[a], flat[b], flat[c]) > -STRAIGHT for a, b, c in _corners(loop))


def _straightened(loop: Loop, flat: Corners) -> Loop:
    """The loop without corners on a straight line."""
    return [
        corner for corner, turn in zip(loop, _turns(loop, flat), strict=True) if turn > STRAIGHT
    ]
