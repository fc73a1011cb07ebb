"""Convex hulls of meshes: all that is known of a mesh as a body, and what travels in files in its
place.

A hull is of all corners of its mesh, to a micrometre; a mesh that is much smaller than its hull has
convex parts beside it. They are read once, when a robot's own files are read; a robot out of a
plan's file has those that were written, and looks for no mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, read_only, unpacked
from ..files.codec import embedded, extracted
from ..files.documents import read_bytes, shown
from ..terrain.mesh_file import MOST_BYTES
from .meshes import kept, read_mesh
from .shapes import Shape
from .solids import solid_shapes

VERSION = "parts/1"
"""Part of every digest of kept parts: a change of method changes it, and older ones are no longer
found."""
DIGITS = 6
"""Decimals of a corner [m]."""
ROOM_M = 3e-5
"""Parts are as near to their hull: corners are rounded, and what is flat is a little thick [m]."""
MOST_CORNERS = 1_000_000
"""Corners of all hulls in one file."""


def hull_corners(points_m: Array) -> Array | None:
    """Corners of the convex hull of points, shape (V, 3) to (K, 3) [m]; None where they span no
    volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(np.round(np.asarray(points_m, dtype=np.float64), DIGITS) + 0.0, axis=0)
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    try:
        return np.asarray(points[np.sort(ConvexHull(points).vertices)])
    except QhullError:
        return None


def with_hulls(shapes: Sequence[Shape]) -> tuple[tuple[Shape, ...], list[tuple[str, str]]]:
    """The shapes, every mesh that is a link's body with the corners of its hull; and the links
    whose mesh is there but has no hull, with why.
    """
    bodies, known = (
        {id(shape) for shape in solid_shapes(shapes)},
        dict[tuple[str, bytes], tuple[Array, tuple[Array, ...]] | str](),
    )
    shapes_with_hulls, doubts = list[Shape](), dict[tuple[str, str], None]()
    for shape in shapes:
        if shape.kind == "mesh" and shape.mesh is not None and id(shape) in bodies:
            key = str(shape.mesh), shape.size_m.tobytes()
            if key not in known:
                known[key] = _read_hull(shape.mesh, shape.size_m)
            if isinstance(hull := known[key], str):
                doubts[
                    f"link {shape.link}", f"has no body, mesh {shown(shape.mesh.name)}: {hull}"
                ] = None
            else:
                shape = replace(shape, corners_m=hull[0], parts_m=hull[1])
        shapes_with_hulls.append(shape)
    return tuple(shapes_with_hulls), list(doubts)


def with_same_hulls(shapes: Sequence[Shape], read: Sequence[Shape]) -> tuple[Shape, ...]:
    """The shapes of a URDF that was rewritten, its links' bodies with the hulls of the same meshes
    as they were read.

    A mesh is often both a link's body and what the link looks like; only the body has a hull.
    """
    hulls = {
        _place(shape): (shape.corners_m, shape.parts_m)
        for shape in read
        if shape.corners_m is not None
    }
    bodies, shapes_with_hulls = {id(shape) for shape in solid_shapes(shapes)}, list[Shape]()
    for shape in shapes:
        corners, parts = hulls.get(_place(shape), (None, ()))
        shapes_with_hulls.append(
            replace(shape, corners_m=corners, parts_m=parts) if id(shape) in bodies else shape
        )
    return tuple(shapes_with_hulls)


def _place(shape: Shape) -> tuple[str, str, bytes]:
    """The key of a mesh's hull: its link, its file, and how it is scaled and placed."""
    numbers = np.concatenate([shape.size_m, shape.origin_m, shape.rotation.ravel()])
    return shape.link, str(shape.mesh), numbers.tobytes()


def _read_hull(path: Path, scale: Array) -> tuple[Array, tuple[Array, ...]] | str:
    """The corners of a mesh's hull and of its parts, or why it has none."""
    try:
        mesh = read_mesh(path, scale)
        key = f"{VERSION}\0{scale.tolist()}\0".encode() + read_bytes(path, MOST_BYTES)
    except InvalidInput as error:
        return str(error).removeprefix(f"{path}: ")
    corners = hull_corners(mesh.vertices_m)
    if corners is None:
        return "expected corners around a volume, got a flat one"

    def made() -> dict[str, Any]:
        from .convex_parts import convex_parts  # loads scipy

        parts = [hull_corners(part) for part in convex_parts(mesh.vertices_m, mesh.faces)]
        whole = [part for part in parts if part is not None]
        return (
            {str(k): part for k, part in enumerate(whole)} if len(whole) == len(parts) else {}
        )  # all, or none

    parts = kept(key, made, lambda arrays: _parts_of(arrays, corners))
    return corners, parts or ()


def _parts_of(arrays: Mapping[str, Array], corners: Array) -> tuple[Array, ...]:
    """Parts of a hull out of arrays by number, none where they do not fill the hull, as of a sheet.

    Raises InvalidInput and KeyError for what is no array of points.
    """
    parts = tuple(read_only(arrays[str(k)], (None, 3), f"part {k}") for k in range(len(arrays)))
    return parts if parts and _fills(parts, corners) else ()


def hulls_to_text(shapes: Sequence[Shape]) -> str:
    """The hulls of a robot's meshes as text, by the number of the shape, and their parts as
    NUMBER_PART; empty where it has none.
    """
    hulls = dict[str, Array]()
    for i, shape in enumerate(shapes):
        if shape.corners_m is not None:
            hulls[str(i)] = shape.corners_m
            hulls |= {f"{i}_{k}": part for k, part in enumerate(shape.parts_m)}
    return embedded(hulls) if hulls else ""


def hulls_of_text(text: str) -> dict[int, list[Array]]:
    """The hulls that ``hulls_to_text`` wrote, by the number of the shape, each with its parts after
    it. Raises InvalidInput for what is none.
    """
    if not text:
        return {}
    result = dict[int, dict[int, Array]]()
    for name, corners in unpacked(extracted(text, "model: hulls"), "model: hulls").items():
        shape, line, part = name.partition("_")
        if not shape.isdecimal() or (line and not part.isdecimal()):
            raise InvalidInput(f"model: hulls: expected numbers of shapes, got {name:.40}")
        points = read_only(corners, (None, 3), f"model: hulls: {name}")
        result.setdefault(int(shape), {})[int(part) if part else -1] = points
    if sum(len(corners) for hulls in result.values() for corners in hulls.values()) > MOST_CORNERS:
        raise InvalidInput(f"model: hulls: expected {MOST_CORNERS} corners or fewer, got more")
    for number, parts in result.items():
        if -1 not in parts:
            raise InvalidInput(
                f"model: hulls: expected the hull of shape {number} beside its parts, got parts "
                "alone"
            )
    return {shape: [hulls[k] for k in sorted(hulls)] for shape, hulls in result.items()}


def with_known_hulls(
    shapes: Sequence[Shape], hulls: Mapping[int, Sequence[Array]]
) -> tuple[Shape, ...]:
    """The shapes with hulls and their parts, by their number.

    Raises InvalidInput for a hull of what is no mesh, or is flat, and for parts that are not inside
    their hull.
    """
    for number, (corners, *parts) in hulls.items():
        if number >= len(shapes) or shapes[number].kind != "mesh":
            raise InvalidInput(f"model: hulls: expected hulls of meshes, got one of shape {number}")
        for each in (corners, *parts):
            if (known_corners := hull_corners(each)) is None or not np.array_equal(
                known_corners, each
            ):
                raise InvalidInput(
                    f"model: hulls: expected the corners of a convex hull for shape {number}, got "
                    "points that are not the corners of their own hull"
                )
        if parts and not _fills(parts, corners):
            raise InvalidInput(
                f"model: hulls: expected parts whose hull is that of shape {number}, got others"
            )
    return tuple(
        replace(shape, corners_m=hulls[i][0], parts_m=tuple(hulls[i][1:])) if i in hulls else shape
        for i, shape in enumerate(shapes)
    )


def _fills(parts: Sequence[Array], corners: Array) -> bool:
    """Tell whether parts are inside a hull and have all of its corners, as nearly as they are
    known.
    """
    from scipy.spatial import ConvexHull

    def outside(points: Array, of: Array) -> Array:
        """Distance of points outside a hull, shape (P,) [m]."""
        faces = ConvexHull(of).equations
        return np.asarray((points @ faces[:, :3].T + faces[:, 3]).max(axis=1))

    if outside(np.concatenate(parts), corners).max() > ROOM_M:
        return False
    return bool(np.min([outside(corners, part) for part in parts], axis=0).max() <= ROOM_M)
