"""Footholds of an elevation map: its cells grouped into planes, each plane's cells cut into convex
pieces.

1. Cells are grouped into surfaces by their noise, of which none is one (``noisy_surfaces``).
2. The outline of each surface, less the margin, is cut into convex pieces.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_closing,
    binary_erosion,
    binary_opening,
    distance_transform_edt,
    find_objects,
    label,
    maximum,
    maximum_filter,
    minimum_filter,
)
from scipy.spatial import Delaunay

from ..errors import InvalidInput
from ..files.arrays import Array
from .correlation import (
    GroundCells,
    Labels,
    Noise,
    boxed,
    correlated_noise,
    fitted,
    inside,
    mean_square,
    noise_of_residuals,
    renumbered,
)
from .elevation import ElevationMap
from .facets import FlatPiece, Plane, shapely_module
from .footholds import REASONS, FootholdLimits, Footholds, TerrainPatch
from .map_certainty import (
    certainties,
    excess_squares,
    roughnesses,
    with_largest,
    with_local,
)
from .map_rungs import MapRung, map_rungs
from .map_solids import ROOM, Overhead, box_patches, on_surfaces, standing_boxes
from .mesh_footholds import standing_pieces
from .noisy_surfaces import (
    COARSE_SD_M,
    LARGEST_M,
    NEIGHBOURS,
    QUIET,
    apart,
    correlated_surfaces,
    noisy_surfaces,
    on_creases,
)
from .patch import FOR_BODIES_M, Certainty, Patch
from .polygon import SMALLEST_M

_HIDDEN = 0.5
"""A step that is not seen is this many of its deviations high, from place to place."""
_EXACT = 0.04
"""Heights without noise are looked at as if they had so little, in shares of the roughness."""
_FLATTEST = 0.02
"""Heights without noise are off a narrow strip by no more than this share of the roughness."""
_ROUNDED_M, _ON_PLANES, _BY_CHANCE = 1e-4, 0.98, 4.0
"""Points of a cloud without noise are off planes by no more [m], in files of four digits, in this
share of the cells within surfaces. So many of 3 × 3 cells have no point by chance. Cells of such a
cloud have three points instead of two."""
_STRAIGHT = 0.25
"""The outline that bodies keep out of is made simpler by no more than this, in cells."""
_OWN = 1.0 - 1e-3
"""Share of a surface's cells in the ground between them, as rounded."""
_DEEP = 0.4
"""Foreign cells so deep within that outline, in cells, are in gaps that it closes over; beside a
straight edge they are less deep."""
_WIDEST, _WIDER, _BAY, _USUAL, _CLOSED = 1.3, 1.8, 1.35, 0.9, 0.6
"""Of an exact cloud: the radius of the widest circle about three points between which its ground
goes on, in cells, and in the radius that this share of such circles have at the most; in the same,
that of a circle without points in the hull of a surface that is not all ground; and half the width
of gaps that are closed where nothing is seen in them, in cells."""
_FINER, _EMPTY, _MISSING, _LOST = 3, 2.7, 18.0, 6.0
"""In squares so many times finer than cells, points are missing where circles are empty that should
have so many, and so many are missing together, or from one circle that is so many times as large as
usual: by chance in three of ten clouds of 24 000 points, which lose 3 % of their ground by it."""
_POCKET = 1.0
"""An outline that leaves out so much of its convex hull in depth counts as convex, in cells."""


def map_footholds(terrain: ElevationMap, limits: FootholdLimits, friction: float) -> Footholds:
    """The footholds of a map, or of the cloud behind it, including ground below overhangs; walls,
    poles and bars are surfaces, too (``map_solids``).
    """
    over = None if terrain.points_m is None else Overhead.of(terrain.points_m, terrain.spacing_m)
    if over is None:
        footholds, rungs, _ = _planes_of(terrain, limits, friction)
        return _with_boxes(footholds, _standing(terrain, footholds, rungs))
    ground, beside = (
        ElevationMap.of_points(points, terrain.spacing_m, terrain.name)
        for points in (over.ground_m, over.beside_m)
    )
    main, whole = (terrain, True) if over.share <= ROOM else (ground, False)
    footholds, rungs, noise = _planes_of(main, limits, friction, whole=whole)
    if whole:
        below, _, _ = _planes_of(beside, limits, friction, noise, whole=False)
        most = max((piece.surface for piece in footholds.pieces), default=-1) + 1
        more = [replace(piece, surface=piece.surface + most) for piece in below.pieces]
        footholds = replace(
            footholds,
            pieces=(*footholds.pieces, *more),
            surfaces=(*footholds.surfaces, *below.surfaces),
        )
    boxes_m = np.concatenate([_standing(ground, footholds, rungs), over.boxes_m])
    return _with_boxes(footholds, boxes_m)


def _standing(terrain: ElevationMap, found: Footholds, rungs: list[MapRung]) -> Array:
    """Boxes of what stands on a map's surfaces and is no rung, shape (B, 6) [m]."""
    noise_m, level = found.noise_m or 0.0, terrain
    if noise_m > QUIET * found.limits.roughness_m:
        level = on_surfaces(terrain, found.surfaces, noise_m)
    if rungs:
        shapely, heights = shapely_module(), np.array(level.heights_m)
        bars = shapely.union_all(
            shapely.polygons([rung.footprint_m(level.spacing_m) for rung in rungs])
        )
        places = np.meshgrid(level.x_m, level.y_m, indexing="ij")
        heights[
            shapely.contains_xy(bars, *(each.ravel() for each in places)).reshape(heights.shape)
        ] = np.nan
        level = replace(level, heights_m=heights)
    return standing_boxes(level, noise_m)


def _with_boxes(found: Footholds, boxes_m: Array) -> Footholds:
    """Footholds whose terrain has these boxes, too."""
    if not len(boxes_m):
        return found
    friction = next((patch.friction for patch in found.surfaces), 1.0)
    return replace(found, surfaces=(*found.surfaces, *box_patches(boxes_m, friction)))


def _planes_of(
    terrain: ElevationMap,
    limits: FootholdLimits,
    friction: float,
    heard: Noise | None = None,
    *,
    whole: bool = True,
) -> tuple[Footholds, list[MapRung], Noise]:
    """The footholds of the upper side of a map or a cloud, whose surfaces are those of the
    footholds; its rungs; and its noise, as ``heard`` in more of it where that is given.

    Arguments:
        whole: whether no points of a cloud are left out, which show where ground ends.
    """
    cells, noise = _cells_of(terrain, limits, heard)
    noise_m = noise.deviation_m
    spacing, heights, known = cells.spacing_m, cells.heights, cells.known
    _check_noise(terrain.name, cells, limits)
    noisy = cells.sparse or noise_m > QUIET * limits.roughness_m
    labels, unseen_m = _labelled(cells, limits, noise)
    if noisy and noise_m <= _ROUNDED_M:
        labels, noisy = _exact(labels, cells)
    white_m = noise_m if noisy else 0.0
    rungs = [] if noise.correlated else map_rungs(labels, cells, white_m, limits.slope_rad)
    barred = np.any([rung.cells for rung in rungs], axis=0) if rungs else np.zeros_like(known)
    if noisy and not noise.correlated:
        noise = noise_of_residuals(np.where(barred, -1, labels), cells, noise_m)
        cells = _counted(cells, noise)
        if noise.correlated:  # bumps are as wide as a rung, and as round
            rungs, barred = [], np.zeros_like(known)
    if rungs:
        known = known & ~barred
        labels = renumbered(np.where(barred, -1, labels))
    planes, rms, count = fitted(labels, cells)
    normal_z = 1.0 / np.sqrt(1.0 + (planes[:, :2] ** 2).sum(axis=1) / spacing**2)
    area_m2 = np.bincount(labels[labels >= 0], minlength=len(planes)) * (spacing**2 / normal_z)
    most = np.hypot(limits.roughness_m, noise_m if noisy else limits.noise_m or 0.0) * (
        1.0 + 3.0 / np.sqrt(2.0 * np.maximum(count, 1.0))  # by three of its own deviations
    )
    strips = rms <= (most if noisy else _FLATTEST * limits.roughness_m)
    within = _inner_rms(labels, cells, rms) if cells.sparse else rms
    level, flat = normal_z >= np.cos(limits.slope_rad), within <= most
    refused = dict.fromkeys(REASONS, 0.0)
    free = labels < 0
    narrow = _narrow(heights, known & free, np.hypot(limits.roughness_m, noise_m))
    rise = np.hypot(*np.gradient(np.where(known, heights, np.nan), spacing))
    steep = narrow & (rise > np.tan(limits.slope_rad))
    steep_m2 = spacing**2 * np.hypot(1.0, rise[steep])
    refused["steep"] = float(area_m2[flat & ~level].sum() + steep_m2.sum())
    refused["small"] = float(spacing**2 * (narrow & ~steep).sum())
    refused["rough"] = float(spacing**2 * (known & free & ~narrow).sum() + area_m2[~flat].sum())
    refused["hole"] = float(spacing**2 * (~known & ~barred & free).sum())
    if noisy:
        bumps_m = np.sqrt(noise.correlated) * noise_m if limits.noise_m is None else 0.0
        shape_m, looked = float(np.hypot(bumps_m, _HIDDEN * unseen_m)), unseen_m > 0.0
        sure = certainties(labels, cells, noise_m, limits.inset_m, shape_m, looked=looked)
        excess_m2 = excess_squares(labels, cells, noise_m, looked=looked)
    else:
        sure = roughnesses(labels, cells, limits.inset_m, planes, rms)
    counted = cells.moments[0] if terrain.samples is None or cells.sparse else terrain.samples
    pieces, surfaces = list[TerrainPatch](), list[Patch]()
    padded, inset = np.pad(labels, 1, constant_values=-1), 0.5 + 0.5 * (cells.sparse and not noisy)
    gapped = set[int]()  # the surfaces to both sides of a cell that is not of them
    for ahead, back in () if noisy else _both_sides(padded):
        gapped.update(np.unique(ahead[(ahead == back) & (ahead != labels)]).tolist())
    points_m = terrain.points_m if whole and len(planes) and not noisy else None
    shown = {} if points_m is None else _shown(points_m, cells, padded, planes)
    places = find_objects(labels + 1, max_label=len(planes))
    reached, beside = dict[int, Any](), dict[int, set[int]]()
    if not (noisy or cells.sparse):
        exact = flat & level & (rms <= _ROUNDED_M)
        second = np.pad(on_creases(labels, cells, planes, exact, _ROUNDED_M), 1, constant_values=-1)
        reached, beside = _to_creases(padded, second, places)
    for number, where in enumerate(places):
        if where is None or not (flat[number] and level[number]):
            continue
        a, b, c = planes[number]
        normal = normal_z[number] * np.array([-a / spacing, -b / spacing, 1.0])
        plane = Plane.through(cells.corner_m + np.array([0.0, 0.0, c]), normal)
        mask, first = reached.get(number) or _mask(padded, number, where)
        simple, inner = _outline(mask, first, inset)
        outline = _on_plane(shown.get(number, simple), plane, spacing)
        samples = round(float(counted[where][labels[where] == number].sum()) / cells.weight)
        kept = sure[number]  # of its inset, the outline keeps half a cell
        facet = FlatPiece(
            plane=plane,
            polygon=outline,
            triangles=np.arange(samples),
            rms_m=float(rms[number]),
            certainty=kept,
        )
        margin_m = None if kept is None else kept.inset_m - 0.5 * spacing
        standing = standing_pieces(
            facet, outline, number, limits, friction, refused, margin_m, bool(strips[number])
        )
        if noisy:
            standing = with_local(standing, labels, cells, excess_m2)
        elif kept is not None:
            standing = with_largest(standing, labels, cells, planes[number])
        pieces += standing
        row = where[0].start
        own = row, np.argmax(labels[row] == number)
        wider, widest = _widest(kept, cells, limits, noisy, own)
        outer = inner.buffer(wider, join_style="mitre").simplify(_STRAIGHT)
        outlines, between = [(outer, widest)], shown.get(number)
        if between is None and number in gapped:
            between = _between(mask, first, outer)
        if number in beside:
            between = outer.buffer(-1.0, join_style="mitre") if between is None else between
        for other in beside.get(number, ()):
            ground = _ground(*(reached.get(other) or _mask(padded, other, places[other])))
            outer = (outer - ground).simplify(0.05)
        if between is not None:
            carries = replace(widest, about_m=widest.about_m + 0.5 * spacing, wider_m=0.0)
            outlines = [(between, carries), (outer, replace(widest, wider_m=FOR_BODIES_M))]
        for polygon, known_so in outlines:
            around = replace(facet, polygon=_on_plane(polygon, plane, spacing))
            surfaces += [
                each.with_certainty(known_so) for each in around.patches(SMALLEST_M, friction)
            ]
        refused["edge"] += max(float(area_m2[number]) - outline.area, 0.0)
    for number, rung in enumerate(rungs, len(planes)):
        lines = rung.pieces(number, limits, friction)
        pieces += lines
        surfaces += rung.sides(friction)
        covered_m2 = sum(line.area_m2 for line in lines)
        refused["round"] += max(float(spacing**2 * rung.cells.sum()) - covered_m2, 0.0)
    footholds = Footholds(
        name=terrain.name,
        pieces=tuple(pieces),
        area_m2=sum(piece.area_m2 for piece in pieces),
        refused_m2=refused,
        surfaces=tuple(surfaces),
        limits=limits,
        noise_m=noise_m,
        noise_length_m=noise.length_m,
    )
    return footholds, rungs, noise


def _labelled(cells: GroundCells, limits: FootholdLimits, noise: Noise) -> tuple[Labels, float]:
    """The surface of each cell, -1 where there is none, and how far bumps that are not seen may
    reach out of one [m].
    """
    if noise.correlated:
        quiet_m = QUIET * limits.roughness_m
        heard = [max(each, quiet_m) for each in (noise.deviation_m, noise.near_m)]
        least = replace(noise, deviation_m=heard[0], near_m=heard[1])
        return correlated_surfaces(cells, limits, least)
    exact_m = _EXACT * limits.roughness_m
    return noisy_surfaces(cells, limits, max(noise.deviation_m, exact_m)), 0.0


def _exact(labels: Labels, cells: GroundCells) -> tuple[Labels, bool]:
    """Labels of a cloud whose points are on planes but for rounding, without the cells that have
    others, and False; else the labels, and True.
    """
    within, empty = inside(labels), np.array([~cells.known], dtype=np.float64)
    planes = np.pad(fitted(np.where(within, labels, -1), cells)[0], ((0, labels.max() + 2), (0, 0)))
    off_m2 = mean_square(planes.T[:, labels], cells.moments)
    on, seen = off_m2 <= _ROUNDED_M**2, cells.known | (boxed(empty, 3)[0] <= _BY_CHANCE)
    exact = on[within].sum() > _ON_PLANES * within.sum()
    return (apart(np.where(on & seen, labels, -1)), False) if exact else (labels, True)


def _widest(
    certainty: Certainty | None,
    cells: GroundCells,
    limits: FootholdLimits,
    noisy: bool,
    own: tuple[int, Any],
) -> tuple[float, Certainty]:
    """How far out of its cells a surface may be, in cells, and how surely: bodies keep out of all
    that it may be, and of exact heights an edge is anywhere between two.

    Arguments:
        own: a cell of the surface, by which an exact one is told from others of its plane.
    """
    if certainty is not None and noisy:
        wider = (certainty.inset_m - limits.inset_m) / cells.spacing_m + _STRAIGHT
        return wider, replace(certainty, wider_m=wider * cells.spacing_m)
    about = cells.corner_m[:2] + cells.spacing_m * np.array(own)
    known = certainty or Certainty(about_m=about, covariance=np.zeros((3, 3)))
    return 0.5, replace(known, about_m=about, wider_m=cells.spacing_m)


def _inner_rms(labels: Labels, cells: GroundCells, rms: Array) -> Array:
    """The rms of points off each surface without its outermost cells, which have points of what is beside, shape (S,)
    [m]; that of all where these are most of it.
    """
    _, without, count = fitted(np.where(inside(labels), labels, -1), cells)
    without, count = (np.pad(each, (0, len(rms) - len(each))) for each in (without, count))
    whole = np.bincount(labels[labels >= 0], cells.moments[0][labels >= 0], minlength=len(rms))
    return np.where(count >= 0.5 * whole, without, rms)


def _check_noise(name: str, cells: GroundCells, limits: FootholdLimits) -> None:
    """Raise InvalidInput for noise with which no square that may be looked at has a plane that feet
    can use.
    """
    dense = max(float(np.mean(cells.moments[0][cells.known])) / cells.weight, 1.0)
    side = max(LARGEST_M, 3.0 * cells.spacing_m)
    most = COARSE_SD_M * np.sqrt(dense) * side / cells.spacing_m
    if limits.noise_m is not None and limits.noise_m > most:
        raise InvalidInput(
            f"{name}: noise_m: expected {most:.2g} m or less, with which a plane over {100.0 * side:.0f} cm of samples "
            f"is known within {1e3 * COARSE_SD_M:g} mm, got {limits.noise_m:g} m"
        )


def _narrow(heights: Array, left: NDArray[np.bool_], within_m: float) -> NDArray[np.bool_]:
    """Cells without a fitted surface whose ground goes on straight to both sides along a line: strips
    that are too narrow to fit a plane to.
    """
    padded = np.pad(np.where(left, heights, np.nan), 1, constant_values=np.nan)
    narrow = np.zeros(heights.shape, dtype=bool)
    for ahead, back in _both_sides(padded):
        with np.errstate(invalid="ignore"):
            narrow |= left & (np.abs(ahead + back - 2.0 * heights) <= 2.0 * within_m)
    return narrow


def _both_sides(padded: NDArray[Any]) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """What is of the cells to both sides of each along a row, a column and the diagonals."""
    n, m = np.subtract(padded.shape, 2)
    for u, v in ((0, 1), (1, 0), (1, 1), (1, -1)):
        ahead = padded[1 + u : 1 + u + n, 1 + v : 1 + v + m]
        yield ahead, padded[1 - u : 1 - u + n, 1 - v : 1 - v + m]


def _cells_of(
    terrain: ElevationMap, limits: FootholdLimits, heard: Noise | None
) -> tuple[GroundCells, Noise]:
    """The samples of a map or of its cloud, which count for less where their noise is correlated,
    and their noise: as given, else as they show it.
    """
    stated_m = limits.noise_m if heard is None else heard.deviation_m
    if terrain.points_m is None:
        cells = GroundCells.of_map(terrain)
        noise_m = cells.noise_m() if stated_m is None else stated_m
    else:
        spacing, noise_m = terrain.spacing_m, stated_m or 0.0
        if stated_m is None:  # the upper side is cut by the noise, so that it is estimated twice
            noise_m = GroundCells.of_points(terrain.points_m, spacing, 0.0).noise_m()
            if noise_m > _ROUNDED_M:
                noise_m = GroundCells.of_points(terrain.points_m, spacing, noise_m).noise_m()
        cells = GroundCells.of_points(
            terrain.points_m, spacing, noise_m, 2.0 + (noise_m <= _ROUNDED_M)
        )
    noise = heard
    if noise is None and stated_m != 0.0:
        noise = correlated_noise(cells, stated_m)
    if noise is None or noise.deviation_m < 2.0 * QUIET * limits.roughness_m:
        return cells, Noise(deviation_m=noise_m)
    return _counted(cells, noise), noise


def _counted(cells: GroundCells, noise: Noise) -> GroundCells:
    """Samples that count for as little as their noise is alike."""
    per_m2 = float(np.mean(cells.moments[0][cells.known])) / cells.weight / cells.spacing_m**2
    return cells.weighed(1.0 / noise.samples_alike(per_m2))


def _shown(points_m: Array, cells: GroundCells, padded: Labels, planes: Array) -> dict[int, Any]:
    """What is between points of each surface of a cloud without noise, in cells: all of it where
    nothing else and no bay is, else triangles of its points that no wide circle goes around.

    Arguments:
        padded: the surface of each cell, −1 for none, and −1 about them all.
        planes: of the surfaces, shape (S, 3).
    """
    shapely, shown = shapely_module(), dict[int, Any]()
    x, y, z = ((points_m - cells.corner_m) / [cells.spacing_m, cells.spacing_m, 1.0]).T
    i, j = np.round([x, y]).astype(np.int_) + 1
    voids, marked = _voids(x, y, padded, cells), padded.copy()
    off = _off(planes, padded[i, j], x, y, z) > _ROUNDED_M
    marked[i[off], j[off]] = -1
    marked[tuple(np.round(voids + 1.0).astype(np.int_).T)] = -1
    deep = (marked >= 0) & (maximum_filter(marked, 5) == minimum_filter(marked, 5))
    x, y, z, i, j = (each[~deep[i, j]] for each in (x, y, z, i, j))
    near = np.stack([padded[i + u, j + v] for u, v in ((0, 0), *NEIGHBOURS)])
    near = np.where(_off(planes, near, x, y, z) <= _ROUNDED_M, near, -1)
    alone = np.all((near < 0) | (near == near.max(axis=0)), axis=0)  # no other of the same plane
    own = np.where(near[0] >= 0, near[0], np.where(alone, near.max(axis=0), -1))
    owner = np.append(own, np.full(len(voids), -1))
    places = np.concatenate([np.column_stack([x, y]), voids])
    points = shapely.points(places)
    tree = shapely.STRtree(points)
    for number in np.unique(own[own >= 0]).tolist():
        hull = shapely.convex_hull(shapely.multipoints(points[owner == number]))
        some = tree.query(hull, predicate="dwithin", distance=_WIDEST)
        triangles = some[Delaunay(places[some]).simplices]
        corners = places[triangles[np.all(owner[triangles] == number, axis=1)]]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        areas = 0.5 * np.abs(np.linalg.det(np.diff(corners, axis=1)))
        radii = 0.25 * sides.prod(axis=1) / np.maximum(areas, SMALLEST_M)
        usual = float(np.quantile(np.append(radii[radii < _WIDEST], 0.0), _USUAL))
        wide = radii >= min(_WIDEST, _WIDER * usual)
        shape = shapely.union_all(
            [
                shapely.coverage_union_all(shapely.polygons(corners[~wide])),
                *_filled(deep & (padded == number), 0.5, -np.ones(2)),
            ]
        )
        closed = shape.buffer(_CLOSED, quad_segs=2).buffer(-_CLOSED, quad_segs=2)
        pockets = shapely.get_parts(closed - shape)
        k, at = tree.query(pockets, predicate="contains")
        shape = shapely.union_all([shape, *np.delete(pockets, k[owner[at] != number])])
        bays, others = (hull - shape).buffer(-_BAY * usual), some[owner[some] != number]
        if bays.is_empty and not shapely.contains_xy(hull, places[others[others < len(z)]]).any():
            shown[number] = hull.simplify(0.05)
        else:
            shown[number] = shape.simplify(_STRAIGHT).buffer(-_STRAIGHT, join_style="mitre")
    return shown


def _off(planes: Array, number: Labels, x: Array, y: Array, z: Array) -> Array:
    """Distance of points along z from the planes of these numbers [m]."""
    a, b, c = planes.T[:, number]
    return np.asarray(np.abs(a * x + b * y + c - z))


def _voids(x: Array, y: Array, padded: Labels, cells: GroundCells) -> Array:
    """Places where a cloud has no points by no chance, shape (K, 2), in cells: cells without a
    surface, and the borders of what else many points are missing from.

    Arguments:
        x, y: of the points, in cells.
        padded: the surface of each cell, −1 for none, and −1 about them all.
    """
    square, known = np.full((3, 3), True), np.full(_FINER * np.array(padded.shape), False)
    known[tuple((_FINER * (np.array([x, y]) + 1.5)).astype(np.int_))] = True
    per_place = float(cells.moments[0][padded[1:-1, 1:-1] >= 0].mean()) / _FINER**2
    ground = binary_erosion(binary_closing(np.pad(padded >= 0, 3), square, 2), square)[3:-3, 3:-3]
    ground = ground.repeat(_FINER, axis=0).repeat(_FINER, axis=1)
    lost = np.where(ground, np.pi * per_place * np.square(distance_transform_edt(~known)), 0.0)
    empty = lost > _EMPTY
    part, count = label(empty, square)
    missing = np.bincount(part.ravel()) * per_place > _MISSING
    missing |= maximum(lost, part, range(count + 1)) > _LOST * np.quantile(
        np.append(lost[ground], 0.0), _USUAL
    )
    empty &= missing[part]
    border = np.argwhere(empty & ~binary_erosion(empty, square)) + 0.5
    bare = np.pad(~cells.known, 1, constant_values=True) & (padded < 0)
    return np.concatenate([border / _FINER - 1.5, np.argwhere(bare) - 1.0])


def _to_creases(
    padded: Labels, second: Labels, places: list[Any]
) -> tuple[dict[int, Any], dict[int, set[int]]]:
    """The cells of surfaces that go up to those of two, as of ``_mask``, of which these add nothing
    to the polygon but what is between samples; and the surfaces that each of them and of the others
    meets there.

    Arguments:
        padded, second: the first and the second surface of each cell, −1 for none, and −1 about
            them all.
        places: the cells among which each surface is.
    """
    square = np.ones((2, 2), dtype=bool)
    reached, beside = dict[int, Any](), dict[int, set[int]]()
    for number in np.unique(second[second >= 0]).tolist():
        window = tuple(slice(max(side.start - 1, 0), side.stop + 3) for side in places[number])
        own, first = padded[window] == number, np.array([side.start for side in window]) - 1.0
        every = own | binary_opening(own | (second[window] == number), square)
        simple, up_to = (_outline(mask, first, 0.5)[0] for mask in (own, every))
        added = up_to - simple - _ground(every, first)
        if up_to.area > simple.area and added.area < 1e-3:  # in cells, no more than rounding
            reached[number] = every, first
            for other in np.unique(padded[window][second[window] == number]).tolist():
                beside.setdefault(number, set()).add(other)
                beside.setdefault(other, set()).add(number)
    return reached, beside


def _outline(mask: NDArray[np.bool_], first: Array, inset: float) -> tuple[Any, Any]:
    """A surface's cells as polygons, in cells: what is so far inside of the line half way to
    foreign cells, which is straightened by as much; and what is within that line.

    Arguments:
        mask: which cells are of it, with one more about them all.
        first: of these cells.
        inset: half a cell, and one where samples may be half a cell inside of the last cells.
    """
    shapely, whole = shapely_module(), _filled(mask, 0.5, first)
    return shapely.union_all([_inner(each, inset) for each in whole]), shapely.MultiPolygon(whole)


def _between(mask: NDArray[np.bool_], first: Array, outer: Any) -> Any:
    """What is between cells of a surface, in cells; None unless an outline closes over foreign
    cells in its gaps.
    """
    shapely = shapely_module()
    places = np.argwhere(binary_closing(mask, np.ones((3, 3), dtype=bool)) > mask) + first
    gaps = shapely.points(places[shapely.contains_xy(outer, *places.T)])
    if not np.any(shapely.distance(outer.boundary, gaps) > _DEEP):
        return None
    return _ground(mask, first).simplify(_STRAIGHT)


def _ground(mask: NDArray[np.bool_], first: Array) -> Any:
    """What is between cells of a surface, in cells."""
    return shapely_module().MultiPolygon(_filled(mask, _OWN, first))


def _mask(padded: Labels, number: int, where: tuple[slice, ...]) -> tuple[NDArray[np.bool_], Array]:
    """Which cells are of a surface, with one more about them all, and the first of them."""
    first = np.array([side.start for side in where]) - 1.0
    return padded[tuple(slice(side.start, side.stop + 2) for side in where)] == number, first


def _filled(mask: NDArray[np.bool_], share: float, first: Array) -> list[Any]:
    """The polygons of which so large a share at the least is of some cells."""
    polygons = list[Any]()
    lines = contour_generator(z=mask.T.astype(np.float64), fill_type="OuterOffset")
    for points, offsets in zip(*lines.filled(share, 1.5), strict=True):
        outer, *holes = (points[a:b] + first for a, b in pairwise(offsets.tolist()))
        polygons.append(shapely_module().Polygon(outer, holes))
    return polygons


def _on_plane(polygon: Any, plane: Plane, spacing: float) -> Any:
    """A polygon in cells from the plane's origin on as one in the plane [m]."""
    slopes = -plane.normal[:2] / plane.normal[2]

    def moved(cells: Array) -> Array:
        xy = spacing * cells
        return plane.flat(plane.origin_m + np.column_stack([xy, xy @ slopes]))

    return shapely_module().transform(polygon, moved)


def _inner(polygon: Any, inset: float) -> Any:
    """An outline in cells made simpler, so far inside of itself at the least:
    convex where it nearly is.
    """
    shapely, hull = shapely_module(), polygon.convex_hull
    pocket = shapely.hausdorff_distance(polygon.boundary, hull.boundary)
    if pocket <= _POCKET:
        return hull.buffer(-max(pocket, inset), join_style="mitre").simplify(0.05)
    return (
        polygon.buffer(-inset, join_style="mitre")
        .simplify(_POCKET)
        .buffer(-_POCKET, join_style="mitre")
    )
