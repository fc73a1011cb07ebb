"""The one reader of terrain files: meshes, grids and point clouds, for postures, courses, walks and
environments.
"""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InvalidInput, installed
from ..files.arrays import Array, array_of, checked, told, unpacked
from ..files.documents import decoded, read_bytes, shown
from .elevation import ElevationMap
from .heightfield import MOST_POINTS, WIDEST_M, HeightField
from .import_options import (
    OTHER_UNIT,
    SUFFIXES,
    SUFFIXES_OF,
    ImportOptions,
    Kind,
    doubt,
    doubts,
)
from .mesh_file import read_corners, read_scene
from .mesh_formats.numbers import MOST_BYTES, Surface
from .mesh_formats.ply import HEAD_BYTES, read_ply
from .triangle_mesh import TriangleMesh


def read_grid(path: Path, options: ImportOptions, name: str) -> ElevationMap:
    """The heights of a file on a square grid of ``spacing_m`` with its middle at the offset; NaN
    where there is none.

    .npy and .csv: heights by row (x) and column (y); .png: seen from above, x to the right and y
    upwards, transparent pixels are holes. .npz: what ``HeightField.to_arrays`` gave, where it lies.
    Raises InvalidInput for what is no such file, and for an array that may as well be one of
    points, unless ``kind`` says that it is a grid.
    """
    if options.up != "z":
        raise InvalidInput(
            f"up: expected z with a grid, whose numbers are heights, got {options.up} with {path}"
        )
    suffix = path.suffix.lower()
    content = read_bytes(path)
    if not content:
        raise InvalidInput(f"{path}: expected a terrain, the file is empty")
    if suffix == ".png":
        return _shifted(
            ElevationMap.of_heights(
                _picture(content, path, options.height_m), options.spacing_m, name
            ),
            options,
        )
    if suffix == ".npz":
        elevation = ElevationMap.from_arrays(unpacked(content, str(path)), name)
        unit = options.unit_m
        scaled = ElevationMap(
            x_m=unit * elevation.x_m,
            y_m=unit * elevation.y_m,
            heights_m=unit * elevation.heights_m,
            name=name,
        )
        return _shifted(scaled, options)
    heights = table(content, path) if suffix == ".csv" else array_of(content, str(path))
    if heights.dtype.kind not in "fiu":
        raise InvalidInput(f"{path}: expected numbers, got an array of {heights.dtype}")
    if heights.ndim != 2:
        raise InvalidInput(f"{path}: expected heights of shape (n, m), got shape {heights.shape}")
    if heights.shape[1] == 3 and options.kind is None:
        raise InvalidInput(
            f"{path}: expected kind cloud (points x, y, z) or grid (heights) for an array of shape "
            f"{heights.shape}, got no kind"
        )
    scaled_heights = options.unit_m * np.asarray(heights, dtype=np.float64)
    return _shifted(ElevationMap.of_heights(scaled_heights, options.spacing_m, name), options)


def _shifted(found: ElevationMap, options: ImportOptions) -> ElevationMap:
    """The map moved by the offset, and cropped; a doubt where it is higher than it is wide."""
    x, y, z = options.offset_m
    rises, wide = (
        np.nanmax(found.heights_m) - np.nanmin(found.heights_m),
        found.x_m[-1] - found.x_m[0],
    )
    if rises > max(wide, found.y_m[-1] - found.y_m[0]):
        doubt(f"{found.name}: heights span {rises:.4g} m over {wide:.4g} m of ground; {OTHER_UNIT}")
    moved = ElevationMap(
        x_m=found.x_m + x, y_m=found.y_m + y, heights_m=found.heights_m + z, name=found.name
    )
    return moved.cropped(options.box_m)


def _axis(name: str) -> str:
    """The axis that a column's name means, as ``x``, ``X [m]`` and ``x_m`` do; else the name."""
    word = name.strip("/\"' ").lower()
    found = re.fullmatch(r"([xyz])(_m)?(\s*[\[(].*)?", word)
    return word if found is None else found[1]


def table(content: bytes, path: Path, *, points: bool = False) -> Array:
    """Rows of numbers with commas, semicolons or blanks between them; an empty field is a hole.

    Arguments:
        points: a first line of names may say which columns are x, y and z, which then come first.
    """
    if sum(map(content.count, (b",", b";", b"\t", b" ", b"\n"))) > 4 * MOST_POINTS:
        raise InvalidInput(f"{path}: expected {MOST_POINTS} numbers or fewer, got more")
    rows, columns = list[list[float]](), list[int]()
    for number, line in enumerate(decoded(content, str(path)).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        mark = next((sign for sign in (";", ",", "\t") if sign in text), None)
        fields = [field.strip() for field in text.split(mark)]
        try:
            rows.append([float(field) if field else float("nan") for field in fields])
        except ValueError:
            names = [_axis(field) for field in fields]
            places = [names.index(axis) for axis in "xyz" if names.count(axis) == 1]
            if rows or columns or len(places) < 3 or not points:
                told = "numbers, or first the names x, y and z" if points else "numbers of a grid"
                raise InvalidInput(
                    f"{path} line {number}: expected {told}, got {shown(text)}"
                ) from None
            columns = places + [k for k in range(len(names)) if k not in places]
            continue
        wanted = len(columns) or len(rows[0])
        if len(rows[-1]) != wanted:
            raise InvalidInput(
                f"{path} line {number}: expected {wanted} numbers, got {len(rows[-1])}"
            )
    if not rows:
        raise InvalidInput(f"{path}: expected rows of numbers, got none")
    return np.array(rows)[:, columns] if columns else np.array(rows)


def _picture(content: bytes, path: Path, height_m: tuple[float, float] | None) -> Array:
    """Grey values as heights, shape (columns, rows): x to the right, y upwards."""
    reader = installed("PIL.Image", str(path), "Pillow", ".png terrains", "terrain")
    if height_m is None:
        raise InvalidInput(
            f"{path}: expected height_m with a .png, the heights of black and white [m], got none"
        )
    low, high = (checked(value, "height_m") for value in height_m)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow, on pictures that are refused below
            image = reader.open(io.BytesIO(content), formats=["PNG"])
        with image:
            if image.width * image.height > MOST_POINTS:
                raise InvalidInput(
                    f"{path}: expected {MOST_POINTS} pixels or fewer, got "
                    f"{image.width * image.height}"
                )
            deep, clear = image.mode.startswith("I"), image.info.get("transparency")
            bits, kind = content[24:26]
            if (bits == 16 and kind) or (bits in (2, 4) and not kind and clear is not None):
                raise InvalidInput(
                    f"{path}: expected heights of 16 bits in grey alone, and holes (tRNS) among 1, "
                    f"8 or 16 bits of grey, got {bits} bits of color type {kind}"
                )
            grey = np.asarray(image if deep else image.convert("L"), dtype=np.float64)
            if deep and clear is not None:
                grey = np.where(grey == clear, np.nan, grey)
            elif clear is not None or "A" in image.getbands():
                alpha = np.asarray(image.convert("RGBA").getchannel("A"))
                grey = np.where(alpha == 255, grey, np.nan)
    except InvalidInput:
        raise
    except Exception as error:  # Pillow raises many kinds on broken files
        raise InvalidInput(
            f"{path}: expected a .png picture, cannot read it: {error!s:.120}"
        ) from None
    return np.asarray(low + (high - low) * grey[::-1].T / (65535.0 if deep else 255.0))


_MOST_POINTS = 20_000_000


def read_points(path: Path) -> Array:
    """Points, shape (K, 3), in the file's unit; those that are not finite, as scanners write
    misses, are left out.

    Of an array or table with more than three columns the first three are x, y and z.
    Raises InvalidInput for what is no such file, and where no point is left.
    """
    suffix = path.suffix.lower()
    content = read_bytes(path, MOST_BYTES)
    if not content:
        raise InvalidInput(f"{path}: expected points, the file is empty")
    if suffix == ".ply":
        points = _of_ply(content, path)
    elif suffix == ".pcd":
        points = _of_pcd(content, path)
    else:
        points = (
            array_of(content, str(path)) if suffix == ".npy" else table(content, path, points=True)
        )
    if points.dtype.kind not in "fiu" or points.ndim != 2 or points.shape[1] < 3:
        raise InvalidInput(
            f"{path}: expected points of shape (K, 3), got {points.dtype} of shape {points.shape}"
        )
    points = np.asarray(points[:, :3], dtype=np.float64)
    finite = points[np.all(np.isfinite(points), axis=1)]
    if not len(finite):
        raise InvalidInput(f"{path}: expected points, got none of {len(points)} that is finite")
    return finite


def _of_ply(content: bytes, path: Path) -> Array:
    try:
        return read_ply(content)[0]
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None


def _of_pcd(content: bytes, path: Path) -> Array:
    reader = installed("pypcd4.pypcd4", str(path), "pypcd4", ".pcd clouds", "terrain")
    declared = re.search(rb"^POINTS\s+(\d{1,18})", content[:4096], re.MULTILINE)
    if declared and int(declared[1]) > min(_MOST_POINTS, 40 * len(content)):
        raise InvalidInput(
            f"{path}: expected points: its header declares {int(declared[1])} in {len(content)} "
            "bytes"
        )
    try:
        cloud = reader.PointCloud.from_fileobj(io.BufferedReader(io.BytesIO(content)))
        with np.errstate(all="ignore"):  # of numbers that are none, which are left out below
            return np.asarray(cloud.numpy(("x", "y", "z")), dtype=np.float64)
    except Exception as error:  # as above
        raise InvalidInput(
            f"{path}: expected points, which pypcd4 cannot read: {told(error)}"
        ) from None


_MAY_HOLD = {
    **SUFFIXES_OF,
    "cloud": (*SUFFIXES_OF["cloud"], ".ply", ".npy", ".csv"),
    "grid": (*SUFFIXES_OF["grid"], *SUFFIXES_OF["mesh"]),
}
"""A mesh that is read as a grid is seen from above."""
_AS_MAP = "simplify it, or have its upper side read as a map with kind=grid and a spacing_m"
"""Advice about a mesh with more triangles than are wanted."""
_MOST_SEEN = 3_000_000
"""Triangles of such a mesh."""
_SAME_M = 1e-6
"""Points that are so near are one, which was written twice."""
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
        return read_grid(path, options, label).with_holes(options.holes)
    points = options.placed(read_points(path))
    low, high = options.box_m
    points = points[np.all((points >= low) & (points <= high), axis=1)]
    if not len(points):
        raise InvalidInput(f"{path}: crop_m: expected some points inside, got none")
    return ElevationMap.of_points(_distinct(points), options.spacing_m, label).with_holes(
        options.holes
    )


def _distinct(points: Array) -> Array:
    """A cloud, shape (K, 3), without points that are within ``_SAME_M`` of one before them: how many
    there are says how fine it is.
    """
    for shift in (
        0.25,
        0.75,
    ):  # away from decimals; what one grid's borders divide is one in the other
        cells = np.floor(points / _SAME_M + shift)
        order = np.lexsort(cells.T)
        new = np.append(True, np.any(np.diff(cells[order], axis=0), axis=1))
        points = points[np.sort(order[new])]
    return points


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
    with doubts() as heard:
        terrain = read_terrain(path, options, name=name)
    if isinstance(terrain, TriangleMesh):
        terrain = terrain.from_above(options.spacing_m).with_holes(options.holes)
    smooths = checked(smooth_m, "smooth_m", least=0.0, most=WIDEST_M) > 0.0
    field = replace(
        terrain.field().smoothed(smooth_m) if smooths else terrain.field(), doubts=tuple(heard)
    )
    _check_held(field, checked(tolerance_m, "tolerance_m", above=0.0))
    return field


def _surface(path: Path, most_triangles: int, hint: str = "simplify it") -> Surface:
    """Corners and triangles of a mesh, or of a MuJoCo scene."""
    if path.suffix.lower() == ".xml":
        return read_scene(path, most_triangles, hint)
    return read_corners(path, most_triangles, hint)


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
        head = read_bytes(path, MOST_BYTES)[:HEAD_BYTES].partition(b"end_header")[0]
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
