"""The one reader of terrain files: meshes, grids and point clouds, for postures, courses, walks and
environments.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import checked
from ..files.documents import read_bytes
from . import cloud_file, grid_file, mesh_file
from .elevation import ElevationMap
from .heightfield import WIDEST_M, HeightField
from .import_options import SUFFIXES, SUFFIXES_OF, ImportOptions, Kind
from .mesh_formats.numbers import Surface
from .mesh_formats.ply import HEAD_BYTES
from .scene_file import read_scene
from .triangle_mesh import TriangleMesh

_MAY_HOLD = SUFFIXES_OF | {
    "cloud": (*SUFFIXES_OF["cloud"], ".ply", ".npy", ".csv"),
    "grid": (*SUFFIXES_OF["grid"], *SUFFIXES_OF["mesh"]),
}
"""A mesh that is read as a grid is seen from above."""
_AS_MAP = "simplify it, or have its upper side read as a map with kind=grid and a spacing_m"
"""Advice about a mesh with more triangles than are wanted."""
_MOST_SEEN = 3_000_000
"""Triangles of such a mesh."""
_ROWS_POINTS = 200_000
"""Points at which a spline is looked at in one go."""
_TOLERANCE_M = 0.025
"""Height by which a spline may swing beyond the heights about a cell; beyond, the terrain is too
fine for it [m]."""


def read_terrain(
    path: str | Path, options: ImportOptions = ImportOptions(), *, name: str = ""
) -> TriangleMesh | ElevationMap:
    """A mesh, or the elevation map of a grid or a point cloud, in the world's frame; holes as
    ``options`` has them.

    A mesh of kind "grid" is the map of what is seen of it from above, at the options' spacing. A
    .ply without faces is a cloud. Raises InvalidInput, in one line, for anything that is no
    terrain.
    """
    path = Path(path)
    label = name or path.name
    kind = _kind(path, options.kind)
    if options.height_m is not None and path.suffix.lower() != ".png":
        raise InvalidInput(f"height_m: expected a .png with it, got {path}")
    if kind == "mesh":
        corners, triangles = _surface(path, options.most_triangles, _AS_MAP)
        return TriangleMesh.of(corners, triangles, options, label)
    if kind == "grid" and path.suffix.lower() in SUFFIXES_OF["mesh"]:
        seen = _surface(path, max(options.most_triangles, _MOST_SEEN))
        mesh = TriangleMesh.as_given(*seen, options, label)
        mesh.check_size()
        return mesh.from_above(options.spacing_m).with_holes(options.holes)
    if kind == "grid":
        return grid_file.read_grid(path, options, label).with_holes(options.holes)
    points = options.placed(cloud_file.read_points(path))
    low, high = options.box_m
    points = points[np.all((points >= low) & (points <= high), axis=1)]
    if not len(points):
        raise InvalidInput(f"{path}: crop_m: expected some points inside, got none")
    return ElevationMap.of_points(points, options.spacing_m, label).with_holes(options.holes)


def read_heights(
    path: str | Path,
    options: ImportOptions = ImportOptions(),
    *,
    smooth_m: float = 0.0,
    tolerance_m: float = _TOLERANCE_M,
    name: str = "",
) -> HeightField:
    """A terrain as one height at every place, smoothed by a Gaussian of deviation smooth_m where
    that is above 0; a mesh is seen from above.

    Raises InvalidInput for what is no terrain, holes that are not to be filled, fewer than four
    grid lines, sizes no robot walks on, and for a terrain that is finer than its spline can hold:
    in a cell it swings by more than tolerance_m beyond its corners.
    """
    terrain = read_terrain(path, options, name=name)
    if isinstance(terrain, TriangleMesh):
        terrain = terrain.from_above(options.spacing_m).with_holes(options.holes)
    field = terrain.field()
    smoothed = (
        field.smoothed(smooth_m)
        if checked(smooth_m, "smooth_m", least=0.0, most=WIDEST_M)
        else field
    )
    _check_held(smoothed, checked(tolerance_m, "tolerance_m", above=0.0))
    return smoothed


def _surface(path: Path, most_triangles: int, hint: str = "simplify it") -> Surface:
    """Corners and triangles of a mesh, or of a MuJoCo scene."""
    if path.suffix.lower() == ".xml":
        return read_scene(path, most_triangles, hint)
    return mesh_file.read_corners(path, most_triangles, hint)


def _kind(path: Path, wanted: Kind | None) -> Kind:
    """Kind of terrain that a file holds, as given or by its name where that leaves no doubt.

    Raises InvalidInput.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InvalidInput(
            f"{path}: expected a terrain that ends in {', '.join(SUFFIXES)}, got {suffix or 'none'}"
        )
    if wanted is not None:
        if suffix not in _MAY_HOLD[wanted]:
            raise InvalidInput(
                f"{path}: expected a {wanted} that ends in {', '.join(_MAY_HOLD[wanted])}, got "
                f"{suffix}"
            )
        return wanted
    if suffix == ".ply":
        head = read_bytes(path, mesh_file.MOST_BYTES)[:HEAD_BYTES].partition(b"end_header")[0]
        faces = re.search(rb"^element\s+face\s+(\d+)", head, re.MULTILINE)
        points = re.search(rb"^element\s+vertex\s+(\d+)", head, re.MULTILINE)
        return "cloud" if points and int(points[1]) and not (faces and int(faces[1])) else "mesh"
    return next(kind for kind in ("mesh", "grid", "cloud") if suffix in _MAY_HOLD[kind])


def _check_held(field: HeightField, tolerance_m: float) -> None:
    """Raise InvalidInput where the spline between grid points is far above or below all that are
    about.
    """
    h = field.heights_m
    corners = np.stack([h[:-1, :-1], h[1:, :-1], h[:-1, 1:], h[1:, 1:]])
    x, y = (0.5 * (line[1:] + line[:-1]) for line in (field.x_m, field.y_m))
    rows = max(1, _ROWS_POINTS // len(y))
    middles = np.concatenate(
        [
            field.height(np.stack(np.meshgrid(x[k : k + rows], y, indexing="ij"), axis=-1))
            for k in range(0, len(x), rows)
        ]
    )
    beyond = np.maximum(middles - corners.max(axis=0), corners.min(axis=0) - middles)
    i, j = np.unravel_index(int(beyond.argmax()), beyond.shape)
    if beyond[i, j] > tolerance_m:
        raise InvalidInput(
            f"{field.name}: finer than its spline can hold: between grid points it swings "
            f"{1e3 * beyond[i, j]:.0f} mm "
            f"beyond the heights about ({x[i]:.2f}, {y[j]:.2f}) m, expected {1e3 * tolerance_m:g} "
            "mm or less; "
            f"take a finer grid, or smooth it, e.g. smooth_m={field.x_m[1] - field.x_m[0]:g}"
        )
