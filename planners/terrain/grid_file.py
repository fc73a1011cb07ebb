"""Elevation maps from files of heights: .npy, .npz, .csv and .png."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path

import numpy as np

from ..errors import InvalidInput, not_installed
from ..files.arrays import Array, array_of, checked, unpacked
from ..files.documents import decoded, read_bytes, shown
from .elevation import ElevationMap
from .heightfield import MOST_POINTS
from .import_options import ImportOptions


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
            f"{path}: expected to be told what an array of shape {heights.shape} holds, kind cloud "
            "(points x, y, z) or "
            "grid (heights), got no kind"
        )
    scaled_heights = options.unit_m * np.asarray(heights, dtype=np.float64)
    return _shifted(ElevationMap.of_heights(scaled_heights, options.spacing_m, name), options)


def _shifted(found: ElevationMap, options: ImportOptions) -> ElevationMap:
    """The map moved by the offset, and cropped."""
    x, y, z = options.offset_m
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
    try:
        from PIL import Image
    except ImportError:
        raise not_installed(str(path), "Pillow", ".png terrains", "terrain") from None
    if height_m is None:
        raise InvalidInput(
            f"{path}: expected height_m with a .png, the heights of black and white [m], got none"
        )
    low, high = (checked(value, "height_m") for value in height_m)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow, on pictures that are refused below
            image = Image.open(io.BytesIO(content), formats=["PNG"])
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
