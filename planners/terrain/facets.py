"""Facets of a mesh, whatever its edges do: triangles of one plane and one side, their union a
polygon.

No manifold is asked for: an edge may be of one triangle, of three, or of two that face opposite
ways, and what covers the same place twice counts once. Triangles that lean because their corners
were rounded are of one plane, too, where it is within the millimetre that bodies have anyway.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import check_time, installed
from ..files.arrays import Array, flat_cross
from .patch import Certainty, Patch, flat_patches
from .polygon import shear_of, width
from .triangle_mesh import TriangleMesh, connected, doubled

_STRAIGHT = 1e-3
"""Sine of a turn that counts as none: 57 mm off on 57 m."""
_SAME_M = 1e-9
"""Corners closer than this are one."""
_FINDING = "while footholds were looked for"

_Loop = list[int]
_Point = Sequence[float]
_Corners = Sequence[_Point]


def _convex_pieces(polygon: Any) -> list[Array]:
    """The pieces of a polygon of shapely's, each by its corners to the left, shape (U, 2) [m]."""
    check_time(doing=_FINDING)
    outline = np.asarray(polygon.exterior.coords)[:-1]
    if not polygon.interiors:
        outline = outline if polygon.exterior.is_ccw else outline[::-1]
        turns = _turns(range(len(outline)), outline.tolist())
        if np.all(turns > 0.0):
            return [outline]
        if np.all(turns > -_STRAIGHT) and np.sum(turns > _STRAIGHT) > 2:
            return [_exact(outline[turns > _STRAIGHT])]
    import shapely

    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    _, first, number = np.unique(
        np.round(corners.reshape(-1, 2) / _SAME_M), axis=0, return_index=True, return_inverse=True
    )
    points = corners.reshape(-1, 2)[first]
    loops = number.reshape(-1, 3)
    a, b, c = (points[loops[:, i]] for i in range(3))
    area = flat_cross(b - a, c - a)
    loops = np.where((area < 0.0)[:, None], loops[:, ::-1], loops)[np.abs(area) > _SAME_M**2]
    return [
        _exact(points[loop]) for loop in _merged(loops.tolist(), points.tolist()) if len(loop) > 2
    ]


def _exact(piece: Array) -> Array:
    """A piece that is convex but for what counts as straight, convex to the last bit."""
    if np.all(_turns(range(len(piece)), piece.tolist()) > 0.0):
        return piece
    import shapely

    hull = shapely.MultiPoint(piece).convex_hull
    return np.asarray(hull.exterior.coords)[-2::-1] if hull.geom_type == "Polygon" else piece


def _merged(loops: list[_Loop], flat: _Corners) -> list[_Loop]:
    """Loops that touch along edges, merged pair by pair while the union stays convex."""
    pieces, merged = dict(enumerate(loops)), True
    while merged:
        check_time(doing=_FINDING)
        merged, changed = False, set[int]()
        for one, other in _touching(pieces):
            if changed & {one, other}:
                continue
            union = _border([pieces[one], pieces[other]])
            met = {*pieces[one]} & {*pieces[other]}  # at other corners both turn as before
            if union is not None and all(
                _turn(flat[a], flat[b], flat[c]) > -_STRAIGHT
                for a, b, c in _corners(union)
                if b in met
            ):
                pieces[one], merged = union, True
                changed |= {one, other}
                del pieces[other]
    return [  # without corners on a straight line
        [corner for corner, turn in zip(loop, _turns(loop, flat), strict=True) if turn > _STRAIGHT]
        for loop in pieces.values()
    ]


def _border(loops: list[_Loop]) -> _Loop | None:
    """The border of pieces that touch along edges, as one loop; None where it is not one (holes,
    pinched corners).
    """
    edges = {(a, b) for loop in loops for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)}
    border = [(a, b) for a, b in edges if (b, a) not in edges]
    following, open_edges = dict(border), len(border)
    if len(following) != open_edges or not following:
        return None
    start = min(following)
    loop = [start]
    while (ahead := following[loop[-1]]) != start:
        loop.append(ahead)
        if len(loop) > open_edges or ahead not in following:
            return None
    return loop if len(loop) == open_edges else None


def _touching(pieces: dict[int, _Loop]) -> list[tuple[int, int]]:
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


def _turns(loop: Sequence[int], flat: _Corners) -> Array:
    """Sine of the turn at every corner, positive to the left, shape (len(loop),)."""
    return np.array([_turn(flat[a], flat[b], flat[c]) for a, b, c in _corners(loop)])


def _corners(loop: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Each corner of a loop between the one before and the one after it."""
    return zip([loop[-1], *loop[:-1]], loop, [*loop[1:], loop[0]], strict=True)


def _turn(before: _Point, here: _Point, after: _Point) -> float:
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


COPLANAR_RAD = 1e-3
"""Triangles whose normals differ by less may be of one facet [rad]."""
FLAT_M = 2e-4
"""No corner of a facet is farther off its plane [m]."""
_ROUNDED_M, _STRAY = 1e-3, 0.1
"""Nor is a corner of one that neighbours make up whose corners were rounded or measured [m], but for
this share of them, which are up to twice as far off."""
MEASURED_M = 2e-5
"""Corners of a facet that were rounded or measured are farther off its plane, in the rms [m]."""
_SNAP_M = 1e-8
"""Corners of a facet are moved by up to half of this to fit each other [m]."""
_CRACK_M = 2e-5
"""Cracks between triangles of a facet that are no wider are closed [m]."""
_MANY = 20
"""Triangles of a facet that are more are looked at for whether they share all their edges."""
_ROUNDS = 20
"""After these, what is left of triangles that bend away from their neighbours stays single."""


def shapely_module() -> Any:
    """shapely.

    Raises InvalidInput without it.
    """
    return installed("shapely", "terrain", "shapely", "facets", "terrain")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """A plane with its coordinates: origin, shape (3,) [m], unit normal (3,), and axes in it, shape
    (3, 2).
    """

    origin_m: Array
    normal: Array
    axes: Array

    @classmethod
    def through(cls, origin_m: Array, normal: Array) -> Plane:
        """One with the house's shear axis first."""
        shear = shear_of(normal)
        up = shear - (shear @ normal) * normal
        up /= np.linalg.norm(up)
        return cls(
            origin_m=origin_m, normal=normal, axes=np.stack([up, np.cross(normal, up)], axis=1)
        )

    def flat(self, points_m: Array) -> Array:
        """Coordinates in the plane, shape (…, 3) → (…, 2) [m]."""
        return np.asarray((points_m - self.origin_m) @ self.axes)

    def height(self, points_m: Array) -> Array:
        """Distance above the plane, shape (…, 3) → (…) [m]."""
        return np.asarray((points_m - self.origin_m) @ self.normal)

    def world(self, points: Array) -> Array:
        """Back again, shape (…, 2) → (…, 3) [m]."""
        return np.asarray(self.origin_m + points @ self.axes.T)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatPiece:
    """A plane, a polygon or several in it (shapely's), the triangles that it is of, and the rms of
    their corners off the plane [m]; how sure plane and edges are, where they were measured.
    """

    plane: Plane
    polygon: Any
    triangles: NDArray[np.int_]
    rms_m: float
    certainty: Certainty | None = None

    def pieces(self, least_m: float) -> Iterator[Array]:
        """Convex pieces that are wide enough, and wider than a thousandth of their length."""
        yield from (
            piece
            for part in parts_of(self.polygon)
            for piece in _convex_pieces(part)
            if width(piece) > max(least_m, 1e-3 * float(np.ptp(piece, axis=0).max()))
        )

    def patches(self, least_m: float, friction: float) -> list[Patch]:
        """The patches of these pieces, those of as many corners looked at all at once."""
        pieces = [self.plane.world(piece) for piece in self.pieces(least_m)]
        axes, made = [self.plane.normal, shear_of(self.plane.normal)], dict[int, Patch]()
        for corners in {len(piece) for piece in pieces}:
            of = [k for k, piece in enumerate(pieces) if len(piece) == corners]
            places, (up, shear) = np.stack([pieces[k] for k in of]), np.stack([axes] * len(of), 1)
            made.update(zip(of, flat_patches(places, up, shear, [friction] * len(of)), strict=True))
        return [made[k] for k in range(len(pieces))]


def parts_of(polygon: Any) -> list[Any]:
    """The polygons with an area that something of shapely's has."""
    shapely = shapely_module()
    if (
        not polygon.is_valid
    ):  # it crosses itself within the last digits, and triangulations want it not to
        polygon = polygon.buffer(0.0)
    parts = shapely.get_parts(polygon) if hasattr(polygon, "geoms") else [polygon]
    return [part for part in parts if part.geom_type == "Polygon" and part.area > _SNAP_M**2]


def facets_of(mesh: TriangleMesh, wanted: NDArray[np.bool_] | None = None) -> list[FlatPiece]:
    """The facets of a mesh, the largest first.

    Arguments:
        wanted: of which triangles, shape (T,), all if missing.
    """
    shapely = shapely_module()
    corners = mesh.spread_m
    doubles = doubled(corners)
    area = 0.5 * np.linalg.norm(doubles, axis=1)
    normals = doubles / (2.0 * area)[:, None]
    chosen = np.arange(len(corners)) if wanted is None else np.flatnonzero(wanted)
    labels = _joined(corners[chosen], normals[chosen], area[chosen], mesh.triangles[chosen])
    order = np.argsort(labels, kind="stable")
    groups = (
        np.split(chosen[order], np.flatnonzero(np.diff(labels[order])) + 1) if len(chosen) else []
    )
    pieces = []
    for group in sorted(groups, key=lambda group: -float(area[group].sum())):
        first = int(group[np.argmax(area[group])])
        plane = Plane.through(corners[first, 0], normals[first])
        if np.abs(plane.height(corners[group])).max() > FLAT_M:  # rounded
            middle, normal, _ = _planes(*(each.sum(axis=0) for each in _moments(corners[group])))
            plane = Plane.through(middle, normal * np.sign(normal @ normals[first]))
        polygon = shapely.polygons(plane.flat(corners[group]))
        polygon = polygon[0] if len(group) == 1 else _united(polygon)
        rms = float(np.sqrt(np.mean(plane.height(corners[group]) ** 2)))
        pieces.append(FlatPiece(plane=plane, polygon=polygon, triangles=group, rms_m=rms))
    return pieces


def _united(triangles: Any) -> Any:
    """The union of triangles in one plane, cracks between them closed where they spoil it, and
    notches of corners that were rounded.
    """
    shapely = shapely_module()
    whole = _covering(triangles) if len(triangles) > _MANY else None
    whole = shapely.union_all(triangles, grid_size=_SNAP_M) if whole is None else whole
    if whole.geom_type != "Polygon" or len(whole.interiors):
        closed = whole.buffer(_CRACK_M, join_style="mitre").buffer(-_CRACK_M, join_style="mitre")
        whole = closed if closed.area > 0.0 else whole
    whole = whole.simplify(_SNAP_M)
    return smoothed(whole) if whole.convex_hull.area - whole.area > _SNAP_M else whole


def smoothed(polygon: Any) -> Any:
    """A polygon without notches of corners that were rounded: its hull where that is as large but
    for ``_ROUNDED_M``.
    """
    simple = polygon.simplify(_ROUNDED_M)
    hull = simple.convex_hull
    return hull if simple.buffer(_ROUNDED_M).covers(hull) else simple


def _covering(triangles: Any) -> Any:
    """The union of triangles that share whole edges and cover nothing twice, in a hundredth of the
    time; None where they are not such.
    """
    shapely = shapely_module()
    exact = shapely.set_precision(triangles, _SNAP_M, mode="pointwise")
    try:
        whole = shapely.coverage_union_all(exact)
    except shapely.errors.GEOSException:  # corners within edges of others
        return None
    area = float(shapely.area(exact).sum())
    alike = whole.geom_type == "Polygon" and abs(whole.area - area) <= _CRACK_M**2 * len(exact)
    return whole if alike and whole.is_valid else None


def _joined(
    corners: Array, normals: Array, area: Array, triangles: NDArray[np.int_]
) -> NDArray[np.int_]:
    """A label for every triangle, the same for those of one facet: first over shared edges, then
    plane by plane.
    """
    pairs = edge_pairs(triangles)
    pairs = pairs[np.vecdot(*np.moveaxis(normals[pairs], 1, 0)) > np.cos(COPLANAR_RAD)]
    labels, left, count = np.full(len(corners), -1), np.arange(len(corners)), 0
    for _ in range(_ROUNDS):
        if not len(left):
            break
        within = np.full(len(corners), -1)
        within[left] = np.arange(len(left))
        some = within[pairs[np.all(within[pairs] >= 0, axis=1)]]
        number, group = connected(some[:, 0], some[:, 1], len(left))
        seed = left[_largest(group, area[left], number)]
        plane = normals[seed[group]]
        off = np.einsum("kij,kj->ki", corners[left] - corners[seed[group], :1], plane)
        fits = np.vecdot(normals[left], plane) > np.cos(COPLANAR_RAD)
        fits &= np.abs(off).max(axis=1) <= FLAT_M
        labels[left[fits]] = count + group[fits]
        left, count = left[~fits], count + number
    labels[left] = count + np.arange(len(left))
    beside = np.concatenate([edge_pairs(triangles), _beside(corners, triangles)])
    return _merged_planes(_unrounded(labels, corners, normals, beside), corners, normals, area)


def _beside(corners: Array, triangles: NDArray[np.int_]) -> NDArray[np.int_]:
    """Pairs of triangles that share no edge, a corner of one in an edge of the other to twice
    ``_ROUNDED_M``, shape (K, 2).
    """
    shapely, room = shapely_module(), 2.0 * _ROUNDED_M
    edges = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    _, number, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    side, owner = np.divmod(np.flatnonzero(count[number.reshape(-1)] == 1), len(triangles))
    start, end = corners[owner, side], corners[owner, (side + 1) % 3]
    low, high = np.minimum(start, end)[:, :2] - room, np.maximum(start, end)[:, :2] + room
    tree = shapely.STRtree(shapely.box(*low.T, *high.T))
    corner, edge = tree.query(shapely.points(start[:, :2]))
    along, away = (end - start)[edge], start[corner] - start[edge]
    share = np.clip(np.vecdot(away, along) / np.vecdot(along, along), 0.0, 1.0)
    near = np.linalg.norm(away - share[:, None] * along, axis=1) <= room
    return np.stack([owner[corner[near]], owner[edge[near]]], axis=1)


def _unrounded(
    labels: NDArray[np.int_], corners: Array, normals: Array, pairs: NDArray[np.int_]
) -> NDArray[np.int_]:
    """Labels with neighbouring groups as one whose corners are within ``_ROUNDED_M`` of one plane:
    again and again two groups that fit each other better than any other of their neighbours.

    Arguments:
        pairs: triangles that touch, shape (K, 2).
    """
    if not len(pairs):
        return labels
    labels, about = np.unique(labels, return_inverse=True)[1], corners.mean(axis=(0, 1))
    number = int(labels.max(initial=-1)) + 1
    sums = [np.zeros((number, *each.shape[1:])) for each in _moments(corners - about)]
    for total, each in zip(sums, _moments(corners - about), strict=True):
        np.add.at(total, labels, each)
    up, tried = np.zeros((number, 3)), np.zeros(0, dtype=np.int_)
    known, spread = np.zeros(0, dtype=np.int_), np.zeros(0)  # rms of pairs of groups
    np.add.at(up, labels, normals)
    pairs = pairs[np.vecdot(normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0.5]
    while True:
        pairs = pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]
        key = np.setdiff1d(np.sort(labels[pairs], axis=1) @ [number, 1], tried)
        new = np.setdiff1d(key, known, assume_unique=True)
        one, other = np.divmod(new, number)
        rms = _planes(*(total[one] + total[other] for total in sums))[2]
        known, spread = np.concatenate([known, new]), np.concatenate([spread, rms])
        order = np.argsort(known)
        known, spread = known[order], spread[order]
        rms = spread[np.searchsorted(known, key)]
        one, other = np.divmod(key, number)
        best = np.full(number, np.inf)
        np.minimum.at(best, one, rms)
        np.minimum.at(best, other, rms)
        both = np.flatnonzero((rms <= np.minimum(best[one], best[other])) & (rms < _ROUNDED_M))
        both = both[np.unique(one[both], return_index=True)[1]]
        both = both[np.unique(other[both], return_index=True)[1]]
        both = both[~np.isin(one[both], other[both])]
        if not len(both):
            return np.asarray(labels)
        first, second = one[both], other[both]
        middle, normal, _ = _planes(*(total[first] + total[second] for total in sums))
        pair = np.full(number, -1)
        pair[one[both]] = pair[other[both]] = np.arange(len(both))
        mine = np.flatnonzero(pair[labels] >= 0)
        of = pair[labels[mine]]
        off = np.abs(np.vecdot(corners[mine] - about - middle[of][:, None], normal[of][:, None]))
        facing = np.vecdot(normals[mine], normal[of]) * np.sign(
            np.vecdot(up[first[of]], normal[of])
        )
        worst, stray = np.zeros(len(both)), (off > _ROUNDED_M).mean(axis=1)
        np.maximum.at(worst, of, np.where(facing > 0.5, off.max(axis=1), np.inf))
        good = np.bincount(of, weights=stray) <= _STRAY * np.bincount(of)
        good &= worst <= 2.0 * _ROUNDED_M
        tried = np.concatenate([tried, key[rms >= _ROUNDED_M], key[both[~good]]])
        one, other = one[both[good]], other[both[good]]
        for total in (*sums, up):
            total[one] += total[other]
        whose = np.arange(number)
        whose[other] = one
        labels = whose[labels]
        changed = np.zeros(number, dtype=bool)
        changed[one] = changed[other] = True
        tried = tried[~changed[np.stack(np.divmod(tried, number))].any(axis=0)]
        same = ~changed[np.stack(np.divmod(known, number))].any(axis=0)
        known, spread = known[same], spread[same]


def _moments(triangles: Array) -> tuple[Array, Array, Array]:
    """Number, sum and sum of the products of the corners of each of T triangles, shapes (T,),
    (T, 3), (T, 3, 3).
    """
    products = np.einsum("tki,tkj->tij", triangles, triangles)
    return np.full(len(triangles), 3.0), triangles.sum(axis=1), products


def _planes(count: Array, total: Array, products: Array) -> tuple[Array, Array, Array]:
    """Middle, unit normal and rms of the planes nearest to points with these moments, shapes
    (..., 3), (..., 3), (...).
    """
    middle = total / count[..., None]
    spread = products / count[..., None, None] - middle[..., None] * middle[..., None, :]
    squares, axes = np.linalg.eigh(spread)
    return middle, axes[..., 0], np.sqrt(np.maximum(squares[..., 0], 0.0))


def _merged_planes(
    labels: NDArray[np.int_], corners: Array, normals: Array, area: Array
) -> NDArray[np.int_]:
    """Labels with groups of one plane as one, though no edge joins them: each goes to the largest
    that it fits.
    """
    _, labels = np.unique(labels, return_inverse=True)
    number = int(labels.max(initial=-1)) + 1
    seed = _largest(labels, area, number)
    about = corners.mean(axis=(0, 1)) if len(corners) else np.zeros(3)
    offset = np.vecdot(corners[seed, 0] - about, normals[seed])
    reach = float(np.abs(corners - about).max(initial=0.0)) * COPLANAR_RAD + FLAT_M
    planes = np.column_stack([normals[seed] / COPLANAR_RAD, offset / reach])
    near = near_planes(planes, planes, 1.0)
    near = near[near[:, 0] < near[:, 1]]
    keep = np.ones(len(near), dtype=bool)
    for one, other in (near.T, near.T[::-1]):
        off = np.einsum(
            "kij,kj->ki", corners[seed[one]] - corners[seed[other], :1], normals[seed[other]]
        )
        keep &= np.abs(off).max(axis=1, initial=0.0) <= FLAT_M
    near, whose = near[keep], np.arange(number)
    of = {int(one): list[int]() for one in near.ravel()}
    for one, other in near.tolist():
        of[one].append(other)
        of[other].append(one)
    size, merged = np.bincount(labels, weights=area, minlength=number), set[int]()
    for one in sorted(of, key=lambda group: (-size[group], group)):
        if one not in merged:
            members = [one, *(other for other in of[one] if other not in merged)]
            whose[members] = min(members)
            merged.update(members)
    return np.asarray(whose[labels])


def near_planes(planes: Array, others: Array, within: float) -> NDArray[np.int_]:
    """Pairs of either that are no farther apart than that, shapes (·, 4) → (K, 2)."""
    shapely = shapely_module()
    places, wanted = (shapely.points(each[:, [0, 3]]) for each in (planes, others))
    pairs = shapely.STRtree(places).query(wanted, "dwithin", 1.01 * within).T[:, ::-1]
    away = np.linalg.norm(planes[pairs[:, 0]] - others[pairs[:, 1]], axis=1)
    return np.asarray(pairs[away <= within])


def edge_pairs(triangles: NDArray[np.int_]) -> NDArray[np.int_]:
    """Pairs of triangles that share an edge, neighbours in the order of each edge's triangles,
    shape (K, 2).
    """
    edges = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(edges.T)
    same = np.all(edges[order[1:]] == edges[order[:-1]], axis=1)
    return np.stack([owner[order[:-1]][same], owner[order[1:]][same]], axis=1)


def _largest(group: NDArray[np.int_], area: Array, number: int) -> NDArray[np.int_]:
    """Member of each group with the largest area."""
    order = np.lexsort((area, group))
    last = np.searchsorted(group[order], np.arange(number), side="right") - 1
    return np.asarray(order[last])
