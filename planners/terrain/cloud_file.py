"""Point clouds from files: .ply and .pcd by the libraries that know them, .xyz, .csv and .npy as
rows of x, y, z.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from ..errors import InvalidInput, not_installed
from ..files.arrays import Array, array_of, told
from ..files.documents import read_bytes
from .grid_file import table
from .mesh_file import MOST_BYTES
from .mesh_formats.ply import read_ply

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
    try:
        from pypcd4.pypcd4 import PointCloud
    except ImportError:
        raise not_installed(str(path), "pypcd4", ".pcd clouds", "terrain") from None
    head = content[:4096]
    declared = re.search(rb"^POINTS\s+(\d{1,18})", head, re.MULTILINE)
    if declared and int(declared[1]) > min(_MOST_POINTS, 40 * len(content)):
        raise InvalidInput(
            f"{path}: expected points: its header declares {int(declared[1])} in {len(content)} "
            "bytes"
        )
    try:
        cloud = PointCloud.from_fileobj(io.BufferedReader(io.BytesIO(content)))
        with np.errstate(all="ignore"):  # of numbers that are none, which are left out below
            return np.asarray(cloud.numpy(("x", "y", "z")), dtype=np.float64)
    except Exception as error:  # as above
        raise InvalidInput(
            f"{path}: expected points, which pypcd4 cannot read: {told(error)}"
        ) from None
