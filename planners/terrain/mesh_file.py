"""Mesh files (STL, OBJ, PLY, DAE, OFF, GLB) of terrains and of robots' links, read in bounds of
size and time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InvalidInput
from ..files.documents import read_bytes
from .mesh_formats.collada import read_collada
from .mesh_formats.glb import read_glb
from .mesh_formats.numbers import MOST_TRIANGLES, Reader, Surface, TooMany
from .mesh_formats.ply import read_obj, read_off, read_ply, read_stl

READERS: dict[str, Reader] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".dae": read_collada,
    ".off": read_off,
    ".glb": read_glb,
}
"""The reader of each format, by the ending of a file's name."""

MOST_BYTES = 128_000_000
_LARGEST = 1e9
"""A coordinate of a file in any unit."""


def read_corners(
    path: str | Path, most_triangles: int = MOST_TRIANGLES, hint: str = "simplify it"
) -> Surface:
    """Corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners' numbers.

    Arguments:
        most_triangles: more are refused, before memory is asked for them.
        hint: what the message says to do then.

    Raises:
        InvalidInput: for a file that is missing or damaged, that declares more than it holds, whose
            triangles name corners that it does not have, and for one without triangles or with
            corners that are not finite.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        raise InvalidInput(
            f"{path}: expected a mesh that ends in {', '.join(READERS)}, got {suffix or 'none'}"
        )
    content = read_bytes(path, MOST_BYTES)
    try:
        with np.errstate(all="ignore"):  # absurd magnitudes end as corners that are not finite
            corners, triangles = READERS[suffix](content, most_triangles)
    except InvalidInput as error:
        then = f"; {hint}" if isinstance(error, TooMany) else ""
        raise InvalidInput(f"{path}: {error}{then}") from None
    if len(triangles) == 0:
        raise InvalidInput(f"{path}: expected a mesh with triangles, got an empty one")
    if not np.all((triangles >= 0) & (triangles < len(corners))):
        raise InvalidInput(
            f"{path}: expected a mesh whose triangles are of its {len(corners)} corners, got others"
        )
    sound = np.abs(corners) <= _LARGEST
    if not np.all(sound):
        raise InvalidInput(
            f"{path}: expected a mesh with finite corners up to {_LARGEST:g}, got {np.sum(~sound)} "
            "numbers that are not"
        )
    return corners, triangles
