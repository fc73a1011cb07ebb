"""Height fields from files: grids as .npy, .npz, .csv and .png, and meshes seen from above."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from ..errors import InvalidInput
from ..files.archive import array_of, unpacked
from ..files.arrays import Array, checked
from ..files.documents import decoded, read_bytes
from ..files.validation import shown
from .heightfield import MOST_POINTS, WIDEST_M, HeightField
from .mesh_file import read_corners

MESHES = (".stl", ".obj", ".ply", ".off", ".glb")
KINDS = (".npy", ".npz", ".csv", ".png", *MESHES)
MOST_COVERED = 2e8
"""Grid points under all triangles of a mesh together, as each has to be looked at."""
ROWS_POINTS = 200_000
"""Points at which a spline is looked at in one go."""
TOLERANCE_M = 0.025
"""How far a spline may swing beyond the heights about a cell; beyond, the terrain is too fine for it [m]."""


def read_heights(
    path: str | Path,
    *,
    spacing_m: float = 0.05,
    unit_m: float = 1.0,
    height_m: tuple[float, float] | None = None,
    smooth_m: float = 0.0,
    tolerance_m: float = TOLERANCE_M,
    name: str = "",
) -> HeightField:
    """Read a terrain, and smooth it by a Gaussian of deviation smooth_m where that is above 0.

    .npy and .csv: heights by row (x) and column (y); .png: seen from above, x to the right and y upwards, black at
    height_m[0], white at height_m[1] [m]; all of these on a square grid of ``spacing_m`` with its middle at the origin.
    .npz: what ``HeightField.to_arrays`` gave. Meshes (``pip install 'stancekit[viz]'``): their upper side, sampled
    every ``spacing_m``. unit_m: what one unit of lengths in a grid or mesh means [m]; 0.001 for millimetres.
    Raises InvalidInput for what is no such file, holes, fewer than four grid lines, sizes no robot walks on, and for a
    terrain that is finer than its spline can hold: in a cell it swings by more than tolerance_m beyond its corners.
    """
    field = _read(Path(path), spacing_m, unit_m, height_m, name)
    smoothed = field.smoothed(smooth_m) if checked(smooth_m, "smooth_m", least=0.0, most=WIDEST_M) else field
    _check_held(smoothed, checked(tolerance_m, "tolerance_m", above=0.0))
    return smoothed


def _read(path: Path, spacing_m: float, unit_m: float, height_m: tuple[float, float] | None, name: str) -> HeightField:
    label = name or path.name
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        raise InvalidInput(f"{path}: expected a terrain that ends in {', '.join(KINDS)}, got {suffix or 'no suffix'}")
    if suffix != ".png" and height_m is not None:
        raise InvalidInput(f"height_m: expected a .png with it, got {path}")
    spacing = checked(spacing_m, "spacing_m", above=0.0, most=WIDEST_M)
    unit = checked(unit_m, "unit_m", above=0.0)
    if suffix in MESHES:
        corners, triangles = read_corners(path)
        return _seen_from_above(unit * corners[triangles], spacing, label)
    content = read_bytes(path)
    if not content:
        raise InvalidInput(f"{path}: expected a terrain, the file is empty")
    if suffix == ".png":
        return HeightField.from_array(_picture(content, path, height_m), spacing, name=label)
    if suffix == ".npz":
        return HeightField.from_arrays(unpacked(content, str(path)), label)
    heights = _table(content, path) if suffix == ".csv" else array_of(content, str(path))
    if heights.dtype.kind not in "fiu":
        raise InvalidInput(f"{path}: expected numbers, got an array of {heights.dtype}")
    if heights.ndim != 2:
        raise InvalidInput(f"{path}: expected heights of shape (n, m), got shape {heights.shape}")
    return HeightField.from_array(unit * np.asarray(heights, dtype=np.float64), spacing, name=label)


def _check_held(field: HeightField, tolerance_m: float) -> None:
    """Raise InvalidInput where the spline between grid points is far above or below all that are about."""
    h = field.heights_m
    corners = np.stack([h[:-1, :-1], h[1:, :-1], h[:-1, 1:], h[1:, 1:]])
    x, y = (0.5 * (line[1:] + line[:-1]) for line in (field.x_m, field.y_m))
    rows = max(1, ROWS_POINTS // len(y))
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
            f"{field.name}: finer than its spline can hold: between grid points it swings {1e3 * beyond[i, j]:.0f} mm "
            f"beyond the heights about ({x[i]:.2f}, {y[j]:.2f}) m, expected {1e3 * tolerance_m:g} mm or less; "
            f"take a finer grid, or smooth it, e.g. smooth_m={field.x_m[1] - field.x_m[0]:g}"
        )


def _table(content: bytes, path: Path) -> Array:
    """Rows of numbers with commas, semicolons or blanks between them; an empty field is a hole."""
    if sum(map(content.count, (b",", b";", b"\t", b" ", b"\n"))) > 4 * MOST_POINTS:
        raise InvalidInput(f"{path}: expected {MOST_POINTS} numbers or fewer, got more")
    rows: list[list[float]] = []
    for number, line in enumerate(decoded(content, str(path)).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        mark = next((sign for sign in (";", ",", "\t") if sign in text), None)
        fields = [field.strip() for field in text.split(mark)]
        try:
            rows.append([float(field) if field else float("nan") for field in fields])
        except ValueError:
            raise InvalidInput(f"{path} line {number}: expected numbers, got {shown(text)}") from None
        if len(rows[-1]) != len(rows[0]):
            raise InvalidInput(f"{path} line {number}: expected {len(rows[0])} numbers, got {len(rows[-1])}")
    if not rows:
        raise InvalidInput(f"{path}: expected rows of numbers, got none")
    return np.array(rows)


def _picture(content: bytes, path: Path, height_m: tuple[float, float] | None) -> Array:
    """Grey values as heights, shape (columns, rows): x to the right, y upwards."""
    try:
        from PIL import Image
    except ImportError:
        raise InvalidInput(f"{path}: .png terrains need Pillow: pip install 'stancekit[viz]'") from None
    if height_m is None:
        raise InvalidInput(f"{path}: expected height_m with a .png, the heights of black and white [m], got none")
    low, high = (checked(value, "height_m") for value in height_m)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow, on pictures that are refused below
            image = Image.open(io.BytesIO(content), formats=["PNG"])
        with image:
            if image.width * image.height > MOST_POINTS:
                raise InvalidInput(f"{path}: expected {MOST_POINTS} pixels or fewer, got {image.width * image.height}")
            if "A" in image.getbands() and np.asarray(image.getchannel("A")).min() < 255:
                raise InvalidInput(f"{path}: expected a picture without holes, got transparent pixels")
            deep = image.mode.startswith("I")
            grey = np.asarray(image if deep else image.convert("L"), dtype=np.float64)
    except InvalidInput:
        raise
    except Exception as error:  # Pillow raises many kinds on broken files
        raise InvalidInput(f"{path}: expected a .png picture, cannot read it: {error!s:.120}") from None
    return np.asarray(low + (high - low) * grey[::-1].T / (65535.0 if deep else 255.0))


def _seen_from_above(triangles: Array, spacing: float, label: str) -> HeightField:
    """The upper side of triangles, shape (T, 3, 3) [m], on the largest grid within their extent."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for axis in range(2):
        if high[axis] - low[axis] > WIDEST_M:
            raise InvalidInput(
                f"{label}: expected {WIDEST_M:g} m or less along {'xy'[axis]}, got {high[axis] - low[axis]:g} m; "
                "a mesh in millimetres is read with unit_m=0.001"
            )
    edge = 1e-9 * (high - low)  # the outermost nodes lie just within the mesh
    counts = np.floor((high - low - 2.0 * edge)[:2] / spacing + 1e-6).astype(int) + 1
    if counts[0] * counts[1] > MOST_POINTS:
        raise InvalidInput(f"{label}: expected {MOST_POINTS} grid points or fewer, got {counts[0] * counts[1]}")
    if counts.min() < 4:
        raise InvalidInput(
            f"{label}: expected {4 * spacing:g} m or more at spacing_m={spacing:g}, "
            f"got {high[0] - low[0]:g} x {high[1] - low[1]:g} m"
        )
    lines = [np.linspace(low[k] + edge[k], low[k] + edge[k] + (n - 1) * spacing, n) for k, n in enumerate(counts)]
    lines = [np.minimum(line, high[k] - edge[k]) for k, line in enumerate(lines)]
    _check_cover(triangles, spacing, label)
    heights = np.full(tuple(counts), -np.inf)
    for corners in triangles:
        _raise_to(heights, lines[0], lines[1], corners)
    holes = np.argwhere(~np.isfinite(heights))
    if len(holes):
        i, j = holes[0]
        raise InvalidInput(
            f"{label}: expected a surface over the whole of its extent, got a hole at "
            f"({lines[0][i]:.3f}, {lines[1][j]:.3f}) m, {len(holes)} of {heights.size} grid points"
        )
    return HeightField(lines[0], lines[1], heights, label)


def _check_cover(triangles: Array, spacing: float, label: str) -> None:
    """Raise InvalidInput for triangles that lie over one another so often that reading them takes minutes."""
    spans = np.ptp(triangles[:, :, :2], axis=1) / spacing + 1.0
    covered = float(np.prod(spans, axis=1).sum())
    if covered > MOST_COVERED:
        raise InvalidInput(
            f"{label}: expected triangles over {MOST_COVERED:g} grid points in all or fewer, got {covered:.3g}"
        )


def _raise_to(heights: Array, x: Array, y: Array, corners: Array) -> None:
    """Raise the grid to one triangle, shape (3, 3), where it lies higher."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners.tolist()
    double = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(double) < 1e-14:
        return
    i = slice(*np.searchsorted(x, (min(ax, bx, cx) - 1e-6, max(ax, bx, cx) + 1e-6)))
    j = slice(*np.searchsorted(y, (min(ay, by, cy) - 1e-6, max(ay, by, cy) + 1e-6)))
    if i.start == i.stop or j.start == j.stop:
        return
    u, v = x[i, None] - ax, y[None, j] - ay
    second = (u * (cy - ay) - v * (cx - ax)) / double
    third = (v * (bx - ax) - u * (by - ay)) / double
    edge = 1e-5  # of the triangle: corners are often in single precision
    inside = (second > -edge) & (third > -edge) & (second + third < 1.0 + edge)
    found = np.where(inside, az + second * (bz - az) + third * (cz - az), -np.inf)
    heights[i, j] = np.maximum(heights[i, j], found)
