"""Footholds of a mesh: its facets, less what is steep, covered by something close above, or inside
a solid.

In the plane of a facet other triangles are polygons: the part of a triangle between the plane and
the clearance above it, seen along the normal, covers what is under it. Whether a place is inside a
solid is asked of a ray: above a place that is outside as many triangles face up as down. That
changes only where a surface crosses the facet, and under edges at which a surface ends, so that one
ray is cast for each part of the facet between such lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array, flat_cross
from .facets import (
    COPLANAR_RAD,
    FLAT_M,
    MEASURED_M,
    FlatPiece,
    Plane,
    edge_pairs,
    facets_of,
    near_planes,
    parts_of,
    shapely_module,
    smoothed,
)
from .footholds import REASONS, FootholdLimits, Footholds, Rung, TerrainPatch, held_on_both_sides
from .import_options import doubt
from .patch import THICKNESS_M, Patch
from .polygon import SMALLEST_M
from .triangle_mesh import TriangleMesh, connected, doubled

_SLIMMEST_M, _WIDEST_M = 4e-3, 0.25
"""Radii of rungs [m]."""
TURN_RAD = 1.1
"""Neighbouring triangles of a rung turn by less: six sides are round, ends are apart [rad]."""
_FEWEST = 4
"""Triangles of a rung."""
_STRAIGHT, _BENT, _ROUND = 1e-5, 0.02, 0.02
"""The share that normals of a rung have along its axis, and the least that they have across, of
their squares; and how far corners may be off the circle, in radii."""
_ARC_RAD = 0.3
"""A rung's surface goes on to both sides of its highest line by this or more [rad]."""
_COARSE_RAD = 0.2
"""Sides of a mesh that lean by more where the line is are taken as they are; sixteen sides are
round [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _MeshRung:
    """A rung, the numbers of its triangles, and how far those at its highest line lean [rad]."""

    rung: Rung
    triangles: NDArray[np.int_]
    lean_rad: float

    @property
    def turn_rad(self) -> float:
        """Angle by which its surface turns from the middle of the line to the border."""
        return max(self.rung.turn_rad, self.lean_rad if self.lean_rad > _COARSE_RAD else 0.0)

    def line(self, corners_m: Array) -> FlatPiece:
        """Highest line of the rung as a strip, where triangles of it, with corners of shape (K, 3,
        3), are below.
        """
        shapely, rung = shapely_module(), self.rung
        axes = np.stack([rung.axis, np.cross(rung.upright, rung.axis)], axis=1)
        plane = Plane(origin_m=rung.middle_m, normal=rung.upright, axes=axes)
        flat = plane.flat(corners_m[doubled(corners_m) @ rung.upright > 0.0])
        half = rung.half_width_m
        strip = shapely.box(flat[..., 0].min(), -half, flat[..., 0].max(), half)
        on_it = strip.intersection(
            shapely.union_all(shapely.polygons(flat), grid_size=1e-7), grid_size=1e-7
        )
        sag = rung.radius_m * (1.0 - float(np.cos(rung.turn_rad)))
        return FlatPiece(plane=plane, polygon=on_it, triangles=self.triangles, rms_m=sag)

    def areas(self, corners_m: Array, steepest_rad: float) -> tuple[float, float]:
        """The area of its triangles, with corners of shape (K, 3, 3), that are steeper than this,
        and of the others.
        """
        doubles = doubled(corners_m)
        area = 0.5 * np.linalg.norm(doubles, axis=1)
        steep = 0.5 * doubles[:, 2] < np.cos(steepest_rad) * area - 1e-12
        return float(area[steep].sum()), float(area[~steep].sum())


def _rungs_of(mesh: TriangleMesh, steepest_rad: float, flat_m: float) -> list[_MeshRung]:
    """The round bars of a mesh whose axes are no steeper than this, and none of whose flat sides is
    wider than that.
    """
    corners = mesh.spread_m
    doubles = doubled(corners)
    size = np.linalg.norm(doubles, axis=1)
    normals = doubles / size[:, None]
    pairs = edge_pairs(mesh.triangles)
    smooth = np.vecdot(normals[pairs[:, 0]], normals[pairs[:, 1]]) > np.cos(TURN_RAD)
    count, label = connected(pairs[smooth, 0], pairs[smooth, 1], len(corners))
    spread = np.array(
        [
            [
                np.bincount(label, weights=size * normals[:, i] * normals[:, j], minlength=count)
                for i in range(3)
            ]
            for j in range(3)
        ]
    )
    values, vectors = np.linalg.eigh(np.moveaxis(spread, -1, 0))
    total = values.sum(axis=1)
    bent = (np.bincount(label, minlength=count) >= _FEWEST) & (values[:, 1] > _BENT * total)
    bent &= (values[:, 0] <= _STRAIGHT * total) & (np.abs(vectors[:, 2, 0]) <= np.sin(steepest_rad))
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(count + 1))
    groups = [
        (order[first[k] : first[k + 1]], vectors[k, :, 0]) for k in np.flatnonzero(bent).tolist()
    ]
    rungs = [(group, _rung(corners[group], normals[group], axis, flat_m)) for group, axis in groups]
    return [
        _MeshRung(rung=rung, triangles=group, lean_rad=_lean(rung, corners[group], normals[group]))
        for group, rung in rungs
        if rung is not None
    ]


def _lean(rung: Rung, corners: Array, normals: Array) -> float:
    """Angle by which triangles, shapes (K, 3, 3) and (K, 3), lean that are under a rung's line [rad]."""
    upward = normals @ rung.upright
    aside = (corners - rung.middle_m) @ np.cross(rung.upright, rung.axis)
    under = (
        (upward > 0.0)
        & (aside.min(axis=1) < rung.half_width_m)
        & (aside.max(axis=1) > -rung.half_width_m)
    )
    return float(np.arccos(np.clip(upward[under].min(initial=1.0), -1.0, 1.0)))


def _rung(corners: Array, normals: Array, axis: Array, flat_m: float) -> Rung | None:
    """The rung of triangles, shapes (K, 3, 3) and (K, 3), with normals across an axis; None where
    they are none.
    """
    upright = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    upright /= np.linalg.norm(upright)
    across = np.stack([np.cross(upright, axis), upright], axis=1)
    about = corners.mean(axis=(0, 1))
    points = (corners - about) @ across
    if np.linalg.norm(np.ptp(points, axis=1), axis=1).max() > flat_m:
        return None
    flat = points.reshape(-1, 2)
    table = np.column_stack([2.0 * flat, np.ones(len(flat))])
    (*middle, rest), *_ = np.linalg.lstsq(table, (flat**2).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(rest + np.dot(middle, middle), 0.0)))
    off = np.abs(np.linalg.norm(flat - middle, axis=1) - radius).max()
    if not (_SLIMMEST_M <= radius <= _WIDEST_M and off <= _ROUND * radius):
        return None
    outward = np.vecdot(points.mean(axis=1) - middle, normals @ across)
    angle = np.arctan2(flat[:, 0] - middle[0], flat[:, 1] - middle[1])
    about_top = [
        np.any((way * angle >= _ARC_RAD) & (way * angle <= _ARC_RAD + TURN_RAD))
        for way in (-1.0, 1.0)
    ]
    if outward.min() <= 0.0 or not all(about_top):
        return None
    highest = about + across @ np.array([middle[0], flat[:, 1].max()])
    return Rung(axis=axis, upright=upright, middle_m=highest, radius_m=radius)


_THINNEST_M = 0.008
"""What is behind a facet is no thinner [m]."""
_INWARD = 0.1
"""Depths are looked at in the middle of a patch and so far from its corners towards it."""
_BEGIN_M = 1e-4
"""Triangles that are no deeper are of the facet itself [m]."""
_PAIRS = 2_000_000
"""Rays and triangles that are looked at together, at most."""


def _with_depths(patches: Sequence[Patch], mesh: TriangleMesh) -> tuple[Patch, ...]:
    """Patches of a mesh, those as thin as their solid whose solid is thinner than usual."""
    if not patches:
        return ()
    places = [
        np.vstack([middle, patch.vertices_m + _INWARD * (middle - patch.vertices_m)])
        for patch in patches
        for middle in [patch.centre_m]
    ]
    owner = np.repeat(np.arange(len(patches)), [len(each) for each in places])
    ways = -np.array([patch.normal for patch in patches])[owner]
    depths = np.full(len(patches), np.inf)
    np.minimum.at(depths, owner, _depths(np.concatenate(places), ways, mesh.spread_m))
    return tuple(
        patch.with_thickness(max(depth, _THINNEST_M)) if depth < THICKNESS_M else patch
        for patch, depth in zip(patches, depths.tolist(), strict=True)
    )


def _depths(places: Array, ways: Array, corners: Array) -> Array:
    """Distance of places along unit vectors to the first triangle that faces the same way, inf where there is none
    within ``THICKNESS_M``, shape (K,) [m].
    """
    shapely = shapely_module()
    low, high = corners.min(axis=1), corners.max(axis=1)
    tree = shapely.STRtree(shapely.box(*low[:, :2].T, *high[:, :2].T))
    ends, depths = places + THICKNESS_M * ways, np.full(len(places), np.inf)
    least, most = np.minimum(places, ends), np.maximum(places, ends)
    boxes = shapely.box(*least[:, :2].T, *most[:, :2].T)
    step = max(1, min(len(places), _PAIRS // max(len(corners) // 50, 1)))
    for begin in range(0, len(places), step):
        ray, triangle = tree.query(boxes[begin : begin + step])
        ray = ray + begin
        near = (low[triangle, 2] <= most[ray, 2]) & (high[triangle, 2] >= least[ray, 2])
        ray, triangle = ray[near], triangle[near]
        a, b, c = np.moveaxis(corners[triangle], 1, 0)
        normal, way = np.cross(b - a, c - a), ways[ray]
        along = np.vecdot(normal, way)
        out = along > 1e-6 * np.sqrt(np.vecdot(normal, normal))
        ray, way, a, b, c, normal, along = (
            each[out] for each in (ray, way, a, b, c, normal, along)
        )
        depth = np.vecdot(normal, a - places[ray]) / along
        hit = places[ray] + depth[:, None] * way
        inside = (depth > _BEGIN_M) & (depth < THICKNESS_M)
        for one, other in ((a, b), (b, c), (c, a)):
            inside &= np.vecdot(np.cross(other - one, hit - one), normal) >= 0.0
        np.minimum.at(depths, ray[inside], depth[inside])
    return depths


_ABOVE_M = 1e-4
"""What is no higher above a facet is on it [m]."""
_THIN_M = 1e-5
"""Borders this close are one [m]."""
LONG = 4.0
"""A strip that is narrower than footholds else are is so many times as long as those are wide."""
_WHOLE = 0.97
"""Share of a rung's line over some length that is free where a foot may stand."""
_LEAN = (1.414e-3, 1.732e-3)
"""Rays lean by this along x and y, so that they hit no edge of a terrain that is drawn along the
axes."""


def mesh_footholds(mesh: TriangleMesh, limits: FootholdLimits, friction: float) -> Footholds:
    """The footholds of a mesh; its other facets are surfaces only."""
    rungs, corners = _rungs_of(mesh, limits.slope_rad, 2.0 * limits.inset_m), mesh.spread_m
    flat = np.ones(len(corners), dtype=bool)
    for rung in rungs:
        flat[rung.triangles] = False
    facets = facets_of(mesh, flat)
    around = _Around(mesh, limits.headroom_m)
    refused = dict.fromkeys(REASONS, 0.0)
    standing = list[tuple[int, FlatPiece]]()
    for number, facet in enumerate(facets):
        area = facet.polygon.area
        if facet.plane.normal[2] < np.cos(limits.slope_rad) - 1e-9:
            refused["steep"] += area
        elif area < 0.5 * limits.least_m**2:
            refused["small"] += area
        else:
            free = around.uncovered(facet)
            refused["covered"] += area - free.area
            standing.append((number, replace(facet, polygon=free)))
    outside = around.outside([facet for _, facet in standing])
    pieces, tops = list[TerrainPatch](), dict[int, FlatPiece]()
    for (number, facet), free in zip(standing, outside, strict=True):
        refused["inside"] += facet.polygon.area - free.area
        if facet.rms_m > MEASURED_M:
            free = shapely_module().union_all([smoothed(part) for part in parts_of(free)])
        tops[number] = replace(facet, polygon=free)
        pieces += standing_pieces(facet, free, number, limits, friction, refused)
    if rungs:
        pieces += _on_rungs(rungs, len(facets), mesh, around, limits, friction, refused)
    facets = _one_sided([*facets, *facets_of(mesh, ~flat)], tops)
    backs = [
        replace(facet, plane=replace(facet.plane, normal=-facet.plane.normal))
        for facet in facets
        if facet.plane.normal[2] < -0.8 and np.isfinite(around.lowest[facet.triangles[0]])
    ]
    bare = sum(
        back.area
        for back in around.outside(backs, roofs=False)
        if not back.buffer(
            -0.5 * limits.least_m
        ).is_empty  # as where a slanting look meets a border
    )
    if bare > 0.0:
        doubt(
            f"{mesh.name}: {bare:.3g} m² of open sheets face down, and are no ground: turn their "
            "normals, unless they are ceilings"
        )
    return Footholds(
        name=mesh.name,
        pieces=tuple(pieces),
        area_m2=sum(piece.area_m2 for piece in pieces),
        refused_m2=refused,
        surfaces=_with_depths(
            [patch for facet in facets for patch in facet.patches(SMALLEST_M, friction)], mesh
        ),
        limits=limits,
    )


def _on_rungs(
    rungs: list[_MeshRung],
    first: int,
    mesh: TriangleMesh,
    around: _Around,
    limits: FootholdLimits,
    friction: float,
    refused: dict[str, float],
) -> list[TerrainPatch]:
    """The lines of rungs that are free, the margin away from their ends; refused gets what else
    there is of rungs.

    Arguments:
        first: number of the first rung as a surface.
    """
    lines = [rung.line(mesh.spread_m[rung.triangles]) for rung in rungs]
    under = [replace(line, polygon=around.uncovered(line)) for line in lines]
    pieces = list[TerrainPatch]()
    for number, (each, line, free, outer) in enumerate(
        zip(rungs, lines, under, around.outside(under), strict=True)
    ):
        refused["covered"] += line.polygon.area - free.polygon.area
        refused["inside"] += free.polygon.area - outer.area
        rung = each.rung
        for part in parts_of(outer):
            low, _, high, _ = part.bounds
            whole = part.area >= _WHOLE * 2.0 * rung.half_width_m * (high - low)
            if not whole or high - low <= 2.0 * limits.inset_m + limits.least_m:
                refused["small" if whole else "covered"] += part.area
                continue
            patch = rung.line(low + limits.inset_m, high - limits.inset_m, friction)
            patch = patch.with_friction(held_on_both_sides(friction, each.turn_rad))
            pieces.append(
                TerrainPatch(
                    patch=patch,
                    rms_m=line.rms_m,
                    samples=len(each.triangles),
                    surface=first + number,
                    turn_rad=each.turn_rad,
                )
            )
            refused["edge"] += max(part.area - pieces[-1].area_m2, 0.0)
        steep, rest = each.areas(mesh.spread_m[each.triangles], limits.slope_rad)
        refused["steep"] += steep
        refused["round"] += max(rest - line.polygon.area, 0.0)
    return pieces


def _one_sided(facets: list[FlatPiece], free: dict[int, FlatPiece]) -> list[FlatPiece]:
    """Facets without what lies behind a foothold and looks the other way: of a sheet that a mesh
    has from both sides one is its surface, or what stands on it would be inside.

    Arguments:
        free: the footholds, by their facet's number.
    """
    if not free:
        return facets
    shapely, numbers = shapely_module(), np.array(list(free))
    planes = np.array(
        [[*facet.plane.normal, facet.plane.normal @ facet.plane.origin_m] for facet in facets]
    )
    behind, facets_left = near_planes(-planes, planes[numbers], COPLANAR_RAD), list[FlatPiece]()
    for number, facet in enumerate(facets):
        over = []
        behind_it = numbers[behind[behind[:, 0] == number, 1]].tolist()
        for top in (free[k] for k in behind_it if number not in free or k < number):
            corners = top.plane.world(shapely.get_coordinates(top.polygon))
            if len(corners) and np.abs(facet.plane.height(corners)).max() < FLAT_M:
                over.append(
                    shapely.set_coordinates(
                        shapely.force_2d(top.polygon), facet.plane.flat(corners)
                    )
                )
        left = (
            _difference(facet.polygon, shapely.union_all(over, grid_size=1e-7))
            if over
            else facet.polygon
        )
        facets_left.append(replace(facet, polygon=left))
    return facets_left


def standing_pieces(
    facet: FlatPiece,
    free: Any,
    surface: int,
    limits: FootholdLimits,
    friction: float,
    refused: dict[str, float],
    margin_m: float | None = None,
    strips: bool = True,
) -> list[TerrainPatch]:
    """The convex pieces of what is free of a facet, the margin away from its border; refused gets
    what is lost.

    Arguments:
        margin_m: another margin than that of the limits [m].
        strips: whether it is flat enough for narrow ones.
    """
    margin_m = limits.inset_m if margin_m is None else margin_m
    inner = free.buffer(-margin_m, join_style="mitre") if margin_m > 0.0 else free
    patches = [
        TerrainPatch(
            patch=patch.with_certainty(facet.certainty),
            rms_m=facet.rms_m,
            samples=len(facet.triangles),
            surface=surface,
        )
        for part in parts_of(inner)
        for patch in _standing(
            replace(facet, polygon=part), limits.least_m, friction, strips=strips
        )
    ]
    refused["edge"] += max(free.area - inner.area, 0.0)
    refused["small"] += max(inner.area - sum(piece.area_m2 for piece in patches), 0.0)
    return patches


def _standing(part: FlatPiece, width_m: float, friction: float, *, strips: bool) -> list[Patch]:
    """The convex pieces of a part inside of the margin that are wide enough; of a strip, which has
    none, those that are long enough: a foot fits on it, though there is little room beside it.
    """
    wide_enough = part.patches(max(width_m, SMALLEST_M), friction)
    if wide_enough or not strips:
        return wide_enough
    narrow = part.patches(SMALLEST_M, friction)
    return [strip for strip in narrow if np.ptp(strip.vertices_m, axis=0).max() > LONG * width_m]


class _Around:
    """The triangles of a mesh by where they are."""

    def __init__(self, mesh: TriangleMesh, headroom_m: float) -> None:
        self._shapely, self._headroom_m = shapely_module(), headroom_m
        self._corners, border = mesh.spread_m, _open_edges(mesh.triangles)
        self._open = mesh.corners_m[border]
        first, then = mesh.triangles[:, :2].ravel(), mesh.triangles[:, 1:].ravel()
        piece, lowest = (
            connected(first, then, len(mesh.corners_m))[1],
            np.full(len(mesh.corners_m), -np.inf),
        )
        lowest[piece[border]] = np.inf
        np.minimum.at(lowest, piece, mesh.corners_m[:, 2])
        self.lowest = lowest[piece[mesh.triangles[:, 0]]]
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)
        self._tree = self._shapely.STRtree(
            self._shapely.box(*self._low[:, :2].T, *self._high[:, :2].T)
        )

    def uncovered(self, facet: FlatPiece) -> Any:
        """Part of a facet that has nothing within the clearance above it."""
        corners = self._corners[self._near(facet, self._headroom_m)]
        heights = facet.plane.height(corners)
        within = (heights.max(axis=1) > _ABOVE_M) & (heights.min(axis=1) < self._headroom_m)
        corners, heights = corners[within], heights[within]
        flat = facet.plane.flat(corners)
        whole = (heights.min(axis=1) >= _ABOVE_M) & (heights.max(axis=1) <= self._headroom_m)
        shadows = flat[whole], _slabs(flat[~whole], heights[~whole], self._headroom_m)
        polygons = np.concatenate([self._shapely.polygons(_closed(each)) for each in shadows])
        # what shares a border with it covers nothing
        touching = polygons[self._shapely.intersects(facet.polygon.buffer(-_THIN_M), polygons)]
        if not len(touching):
            return facet.polygon
        return _difference(facet.polygon, self._shapely.union_all(touching, grid_size=1e-7))

    def outside(self, facets: list[FlatPiece], *, roofs: bool = True) -> list[Any]:
        """Part of each facet that is outside of all solids.

        Arguments:
            roofs: an open sheet all of which has headroom below it is a roof, and holds nothing.
        """
        parts = [self._parts(facet) for facet in facets]
        points = [
            facet.plane.world(
                np.array([part.representative_point().coords[0] for part in of]).reshape(-1, 2)
            )
            + _ABOVE_M * facet.plane.normal
            for facet, of in zip(facets, parts, strict=True)
        ]
        facet_of = np.repeat(np.arange(len(facets)), [len(of) for of in points])
        owners = np.full(len(self._corners), -1)
        for number, facet in enumerate(facets):
            owners[facet.triangles] = number
        free = iter(
            self._winding(np.concatenate([*points, np.zeros((0, 3))]), facet_of, owners, roofs) <= 0
        )
        parts_left = [[part for part in of if next(free)] for of in parts]
        return [
            facet.polygon if len(left) == len(of) else self._shapely.union_all(left, grid_size=1e-7)
            for facet, of, left in zip(facets, parts, parts_left, strict=True)
        ]

    def _near(self, facet: FlatPiece, above_m: float) -> NDArray[np.int_]:
        """Triangles whose boxes meet the facet moved up by as much as ``above_m``, its own left
        out.
        """
        corners = facet.plane.world(np.array(self._shapely.get_coordinates(facet.polygon)))
        corners = np.concatenate([corners, corners + above_m * facet.plane.normal])
        low, high = corners.min(axis=0) - _ABOVE_M, corners.max(axis=0) + _ABOVE_M
        near = np.asarray(self._tree.query(self._shapely.box(*low[:2], *high[:2])))
        near = near[(self._low[near, 2] <= high[2]) & (self._high[near, 2] >= low[2])]
        return np.setdiff1d(near, facet.triangles, assume_unique=True)

    def _parts(self, facet: FlatPiece) -> list[Any]:
        """The parts of a facet between the lines along which other triangles cross it."""
        parts = parts_of(facet.polygon)
        if not parts:
            return []
        corners = self._corners[self._near(facet, 2.0 * _ABOVE_M)]
        heights = facet.plane.height(corners) - _ABOVE_M
        across = (heights.min(axis=1) < 0.0) & (heights.max(axis=1) > 0.0)
        crossings = _crossings(facet.plane.flat(corners[across]), heights[across])
        lines = self._shapely.linestrings(np.concatenate([crossings, self._shadows(facet)]))
        core = facet.polygon.buffer(-_THIN_M)
        lines = lines[self._shapely.intersects(core, lines)]
        if not len(lines):
            return parts
        cut = self._shapely.get_parts(
            self._shapely.polygonize(
                [self._shapely.union_all([facet.polygon.boundary, *lines], grid_size=1e-7)]
            )
        )
        return [part for part in cut if core.intersects(part.representative_point())] or parts

    def _shadows(self, facet: FlatPiece) -> Array:
        """Crossings of rays from the plane of a facet with edges above that are open, shape (K, 2,
        2).
        """
        heights = facet.plane.height(self._open)
        over = heights.max(axis=1) > _ABOVE_M
        along = np.array([*_LEAN, 1.0])
        rise = facet.plane.normal @ along
        if abs(rise) < 1e-6:
            return np.zeros((0, 2, 2))
        return facet.plane.flat(self._open[over] - (heights[over] / rise)[..., None] * along)

    def _winding(
        self, points: Array, facet_of: NDArray[np.int_], own: NDArray[np.int_], roofs: bool
    ) -> NDArray[np.int_]:
        """Triangles that face up above each point less those that face down, shape (K,).

        A facet's own triangles are as far off its plane as flat things may be, and none of them is
        above it.

        Arguments:
            facet_of: number of the facet that each point is on.
            own: of each triangle, −1 for none.
            roofs: see ``outside``.
        """
        tops, lean = points[:, 2] + (self._headroom_m if roofs else np.inf), np.zeros((3, 3))
        lean[2, :2] = _LEAN
        corners, points = self._corners - self._corners @ lean, points - points @ lean
        a, b, c = np.moveaxis(corners, 1, 0)
        u, v = b - a, c - a
        double = flat_cross(u, v)
        low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
        tree = self._shapely.STRtree(self._shapely.box(*low.T, *high.T))
        point, triangle = tree.query(self._shapely.points(points[:, :2]))
        of, way = double[triangle], points[point] - a[triangle]
        with np.errstate(all="ignore"):
            s = flat_cross(way, v[triangle]) / of
            t = flat_cross(u[triangle], way) / of
            hit = (
                (s >= 0.0)
                & (t >= 0.0)
                & (s + t <= 1.0)
                & (s * u[triangle, 2] + t * v[triangle, 2] > way[:, 2])
            )
        hit &= (own[triangle] != facet_of[point]) & (self.lowest[triangle] <= tops[point])
        return np.bincount(point[hit], weights=np.sign(of[hit]), minlength=len(points)).astype(
            np.int_
        )


def _open_edges(triangles: NDArray[np.int_]) -> NDArray[np.int_]:
    """Edges that are not gone along as often one way as the other, shape (K, 2)."""
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    result, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    ways = np.bincount(number.reshape(-1), weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))
    return np.asarray(result[ways != 0.0])


def _difference(polygon: Any, covered: Any) -> Any:
    """Remainder of a polygon, without its cracks and threads."""
    free = polygon.difference(covered, grid_size=1e-7)
    for grow in (_THIN_M, -2.0 * _THIN_M, _THIN_M):
        free = free.buffer(grow, join_style="mitre")
    return free


def _closed(triangles: Array) -> Array:
    """Polygons seen along the normal that have an area, shape (K, U, 2)."""
    about = triangles - triangles[:, :1]
    area = flat_cross(about, np.roll(about, -1, axis=1)).sum(axis=1)
    return np.asarray(triangles[np.abs(area) > _THIN_M * np.ptp(triangles, axis=1).max(axis=1)])


def _slabs(flat: Array, heights: Array, top: float) -> Array:
    """The parts of triangles, shapes (K, 3, 2) and (K, 3), between just above the plane and
    ``top``, in the plane's coordinates, without those that have none, corners said several times,
    shape (L, 12, 2).
    """
    rows = np.concatenate([flat, heights[..., None]], axis=-1)
    for sign, level in ((-1.0, -_ABOVE_M), (1.0, top)):
        over = sign * rows[..., 2] - level
        ahead, after = np.roll(rows, -1, axis=1), np.roll(over, -1, axis=1)
        crosses = over * after < 0.0
        share = np.where(crosses, over / np.where(crosses, over - after, 1.0), 0.0)
        crossing = rows + share[..., None] * (ahead - rows)
        corners = np.stack([rows, crossing], axis=2).reshape(len(rows), 2 * over.shape[1], 3)
        within = np.stack([over <= 0.0, crosses], axis=2).reshape(len(rows), 2 * over.shape[1])
        some = within.any(axis=1)
        corners, within = corners[some], within[some]
        slot = np.where(within, np.arange(within.shape[1]), -1)
        last = np.maximum.accumulate(slot, axis=1)
        last = np.where(last < 0, slot.max(axis=1, keepdims=True), last)
        rows = np.take_along_axis(corners, last[..., None], axis=1)
    return rows[..., :2]


def _crossings(flat: Array, heights: Array) -> Array:
    """Lines in which triangles, shape (K, 3, 2), with corners on both sides of a plane cross it,
    shape (K, 2, 2).

    An edge is always gone down, so that the triangles on both sides of it give the same point to
    the last bit.
    """
    alone = np.where(
        (heights > 0.0).sum(axis=1) == 1, heights.argmax(axis=1), heights.argmin(axis=1)
    )
    rows = np.arange(len(flat))
    ends = []
    for turn in (1, 2):
        other = (alone + turn) % 3
        down = heights[rows, alone] > 0.0
        high, low = np.where(down, alone, other), np.where(down, other, alone)
        h, g = heights[rows, high], heights[rows, low]
        share = (h / np.where(h == g, 1.0, h - g))[:, None]
        ends.append(flat[rows, high] + share * (flat[rows, low] - flat[rows, high]))
    return np.stack(ends, axis=1)
