"""Patches from a mesh file (STL, OBJ, PLY; read by trimesh): neighbouring coplanar triangles become convex polygons."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from .mesh_file import read_corners
from .patch import Patch
from .polygon import SMALLEST_M, shear_of, width

COPLANAR_RAD = 1e-3
"""Triangles whose normals differ by less are of one facet [rad]."""
WELD_M = 1e-6
"""Corners closer than this are one [m]: STL files have no others."""
LARGEST_M, SMALLEST_MESH_M = 50.0, 0.01
"""A terrain is no larger and no smaller than this from end to end [m]: what is, is in another unit."""
MOST_TRIANGLES = 50_000
FORMATS = (".stl", ".obj", ".ply")

Loop = list[int]


def read_mesh(
    path: str | Path, *, friction: float, unit_m: float = 1.0, offset_m: Iterable[float] = (0.0, 0.0, 0.0)
) -> tuple[Patch, ...]:
    """The patches of a mesh, their normals outward by the order of its triangles.

    unit_m: length of the file's unit; offset_m: added to every corner, after the unit, shape (3,) [m].
    A facet that is convex becomes one patch; one that is not, or has holes, as few as merging its triangles pair by
    pair gives. Facets narrower than a millimetre, or than a thousandth of their length, are left out.
    Raises InvalidInput for a file that is missing or no mesh, for an empty mesh, for one that is not a surface (an edge
    of three triangles, or of two that face opposite ways) and for one of an unlikely size.
    """
    if Path(path).suffix.lower() not in FORMATS:
        raise InvalidInput(f"{path}: expected a mesh file, {', '.join(FORMATS)}")
    corners, triangles = read_corners(path)
    with np.errstate(all="ignore"):  # absurd magnitudes end as no area
        corners, triangles = _welded(corners * unit_m, triangles)
    if len(triangles) == 0:
        raise InvalidInput(f"{path}: expected a mesh with triangles, got an empty one")
    if len(triangles) > MOST_TRIANGLES:
        raise InvalidInput(f"{path}: expected at most {MOST_TRIANGLES} triangles, got {len(triangles)}; simplify it")
    _check_size(path, corners, unit_m)
    neighbours = _neighbours(path, triangles, corners)
    normals = _normals(corners, triangles)
    patches = []
    for facet in _facets(normals, neighbours):
        patches += _facet_patches(facet, corners, triangles, normals, friction, np.array([*offset_m]))
    if not patches:
        raise InvalidInput(f"{path}: expected facets to stand on, got none wider than {1e3 * SMALLEST_M:g} mm")
    return tuple(patches)


def _welded(corners: Array, triangles: NDArray[np.int_]) -> tuple[Array, NDArray[np.int_]]:
    """Corners and triangles without corners given twice and triangles without an area."""
    _, first, name = np.unique(np.round(corners / WELD_M), axis=0, return_index=True, return_inverse=True)
    corners, triangles = corners[first], name.reshape(-1)[triangles]
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return corners, triangles[area > WELD_M**2]


def _check_size(path: str | Path, corners: Array, unit_m: float) -> None:
    size = float(np.ptp(corners, axis=0).max())
    if size > LARGEST_M:
        raise InvalidInput(
            f"{path}: expected a terrain of at most {LARGEST_M:g} m from end to end, got {size:g} m; a file in "
            f"millimetres is read with unit_m: {0.001 * unit_m:g}"
        )
    if size < SMALLEST_MESH_M:
        raise InvalidInput(
            f"{path}: expected a terrain of at least {SMALLEST_MESH_M:g} m from end to end, got {size:g} m; see unit_m"
        )


def _neighbours(path: str | Path, triangles: NDArray[np.int_], corners: Array) -> list[list[int]]:
    """The triangles across the edges of each. Raises InvalidInput where the triangles are no surface."""
    across = defaultdict[tuple[int, int], list[tuple[int, bool]]](list)
    for index, (a, b, c) in enumerate(triangles.tolist()):
        for start, end in ((a, b), (b, c), (c, a)):
            across[min(start, end), max(start, end)].append((index, start < end))
    found = list[list[int]]([[] for _ in triangles])
    for (start, end), sides in across.items():
        message = ""
        if len(sides) > 2:
            message = f"{len(sides)} triangles share an edge"
        elif len(sides) == 2 and sides[0][1] == sides[1][1]:
            message = "two neighbouring triangles face opposite ways"
        if message:
            place = ", ".join(f"{value:.4g}" for value in 0.5 * (corners[start] + corners[end]))
            raise InvalidInput(f"{path}: expected a manifold mesh, but {message} at ({place}) m")
        if len(sides) == 2:
            found[sides[0][0]].append(sides[1][0])
            found[sides[1][0]].append(sides[0][0])
    return found


def _normals(corners: Array, triangles: NDArray[np.int_]) -> Array:
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def _facets(normals: Array, neighbours: list[list[int]]) -> list[list[int]]:
    """Connected triangles with the normal of the facet's first one, facet by facet in the file's order."""
    least, facets = np.cos(COPLANAR_RAD), list[list[int]]()
    seen = np.zeros(len(normals), dtype=bool)
    for first in range(len(normals)):
        if seen[first]:
            continue
        seen[first], facet = True, [first]
        for index in facet:  # grows as it is gone through
            for other in neighbours[index]:
                if not seen[other] and normals[other] @ normals[first] > least:
                    seen[other] = True
                    facet.append(other)
        facets.append(facet)
    return facets


def _facet_patches(
    facet: list[int], corners: Array, triangles: NDArray[np.int_], normals: Array, friction: float, offset: Array
) -> list[Patch]:
    """One patch a convex piece of a facet."""
    normal = normals[facet[0]]
    shear = shear_of(normal)
    up = shear - (shear @ normal) * normal
    up /= np.linalg.norm(up)
    axes = np.stack([np.cross(up, normal), up], axis=1)
    flat = {int(corner): corners[corner] @ axes for index in facet for corner in triangles[index]}
    loops = _convex_pieces([triangles[index].tolist() for index in facet], flat)
    return [
        Patch(vertices_m=corners[loop] + offset, normal=normal, shear_reference=shear, friction=friction)
        for loop in loops
        if len(loop) > 2 and _stands(np.array([flat[corner] for corner in loop]))
    ]


def _stands(polygon: Array) -> bool:
    """Whether a convex polygon is wide enough to stand on, and no mere sliver of its length."""
    return width(polygon) > max(SMALLEST_M, 1e-3 * float(np.ptp(polygon, axis=0).max()))


def _convex_pieces(loops: list[Loop], flat: dict[int, Array]) -> list[Loop]:
    """The facet's border where it is one convex loop; else its triangles, merged while the pieces stay convex."""
    border = _border(loops)
    if border is not None and _convex(border, flat):
        return [_straightened(border, flat)]
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
    """The border of pieces that touch along edges, as one loop; None where it is not one (holes, pinched corners)."""
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
    owner = {(a, b): key for key, loop in pieces.items() for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)}
    pairs = Counter[tuple[int, int]]()
    for (a, b), key in owner.items():
        other = owner.get((b, a))
        if other is not None and key < other:
            pairs[key, other] += 1
    return [pair for pair, _ in pairs.most_common()]


def _turns(loop: Loop, flat: dict[int, Array]) -> Array:
    """Sine of the turn at every corner, positive to the left, shape (len(loop),)."""
    points = np.array([flat[corner] for corner in loop])
    into, out = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    return np.asarray(turns / (np.hypot(*into.T) * np.hypot(*out.T)))


def _convex(loop: Loop, flat: dict[int, Array]) -> bool:
    return bool(np.all(_turns(loop, flat) > -COPLANAR_RAD))


def _straightened(loop: Loop, flat: dict[int, Array]) -> Loop:
    """The loop without corners on a straight line."""
    return [corner for corner, turn in zip(loop, _turns(loop, flat), strict=True) if turn > COPLANAR_RAD]
