"""Convex hulls of meshes: all that is known of a mesh as a body, and what travels in files in its place.

A hull is of all corners of its mesh, to a micrometre. It is read once, when a robot's own files are read; a robot out
of a plan's file has the hulls that were written, and looks for no mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InvalidInput
from ..files.archive import unpacked
from ..files.arrays import Array, read_only
from ..files.embedded import embedded, extracted
from ..files.validation import shown
from .meshes import read_mesh
from .shapes import Shape
from .solids import solid_shapes

DIGITS = 6
"""Decimals of a corner [m]."""
MOST_CORNERS = 1_000_000
"""Corners of all hulls in one file."""


def hull_corners(points_m: Array) -> Array | None:
    """Corners of the convex hull of points, shape (V, 3) to (K, 3) [m]; None where they span no volume."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(np.round(np.asarray(points_m, dtype=np.float64), DIGITS) + 0.0, axis=0)
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    try:
        return np.asarray(points[np.sort(ConvexHull(points).vertices)])
    except QhullError:
        return None


def with_hulls(shapes: Sequence[Shape]) -> tuple[tuple[Shape, ...], list[tuple[str, str]]]:
    """The shapes, every mesh that is a link's body with the corners of its hull; and the links whose mesh is there but
    has no hull, with why."""
    bodies, known = (
        {id(shape) for shape in solid_shapes(shapes)},
        dict[tuple[str, bytes], Array | str](),
    )
    found, doubts = list[Shape](), dict[tuple[str, str], None]()
    for shape in shapes:
        if shape.kind == "mesh" and shape.mesh is not None and id(shape) in bodies:
            key = str(shape.mesh), shape.size_m.tobytes()
            if key not in known:
                known[key] = _read_hull(shape.mesh, shape.size_m)
            if isinstance(hull := known[key], str):
                doubts[f"link {shape.link}", f"has no body, mesh {shown(shape.mesh.name)}: {hull}"] = None
            else:
                shape = replace(shape, corners_m=hull)
        found.append(shape)
    return tuple(found), list(doubts)


def with_same_hulls(shapes: Sequence[Shape], read: Sequence[Shape]) -> tuple[Shape, ...]:
    """The shapes of a URDF that was rewritten, its links' bodies with the hulls of the same meshes as they were read.

    A mesh is often both a link's body and what the link looks like; only the body has a hull.
    """
    hulls = {_place(shape): shape.corners_m for shape in read if shape.corners_m is not None}
    bodies = {id(shape) for shape in solid_shapes(shapes)}
    return tuple(
        replace(shape, corners_m=hulls.get(_place(shape))) if id(shape) in bodies else shape for shape in shapes
    )


def _place(shape: Shape) -> tuple[str, str, bytes]:
    """The key of a mesh's hull: its link, its file, and how it is scaled and placed."""
    numbers = np.concatenate([shape.size_m, shape.origin_m, shape.rotation.ravel()])
    return shape.link, str(shape.mesh), numbers.tobytes()


def _read_hull(path: Path, scale: Array) -> Array | str:
    """The corners of a mesh's hull, or why it has none."""
    try:
        corners = hull_corners(read_mesh(path, scale).vertices_m)
    except InvalidInput as error:
        return str(error).removeprefix(f"{path}: ")
    return "expected corners around a volume, got a flat one" if corners is None else corners


def hulls_to_text(shapes: Sequence[Shape]) -> str:
    """The hulls of a robot's meshes as text, by the number of the shape; empty where it has none."""
    hulls = {
        str(i): shape.corners_m for i, shape in enumerate(shapes) if shape.corners_m is not None
    }
    return embedded(hulls) if hulls else ""


def hulls_of_text(text: str) -> dict[int, Array]:
    """The hulls that ``hulls_to_text`` wrote, by the number of the shape. Raises InvalidInput for what is none."""
    if not text:
        return {}
    found = dict[int, Array]()
    for name, corners in unpacked(extracted(text, "model: hulls"), "model: hulls").items():
        if not name.isdecimal():
            raise InvalidInput(f"model: hulls: expected numbers of shapes, got {name:.40}")
        found[int(name)] = read_only(corners, (None, 3), f"model: hulls: {name}")
    if sum(map(len, found.values())) > MOST_CORNERS:
        raise InvalidInput(f"model: hulls: expected {MOST_CORNERS} corners or fewer, got more")
    return found


def with_known_hulls(shapes: Sequence[Shape], hulls: Mapping[int, Array]) -> tuple[Shape, ...]:
    """The shapes with hulls by their number. Raises InvalidInput for a hull of what is no mesh, or is flat."""
    for number, corners in hulls.items():
        if number >= len(shapes) or shapes[number].kind != "mesh":
            raise InvalidInput(f"model: hulls: expected hulls of meshes, got one of shape {number}")
        if (own := hull_corners(corners)) is None or not np.array_equal(own, corners):
            raise InvalidInput(
                f"model: hulls: expected the corners of a convex hull, got others for shape {number}"
            )
    return tuple(
        replace(shape, corners_m=hulls[i]) if i in hulls else shape
        for i, shape in enumerate(shapes)
    )
