"""Meaning of the numbers in a terrain file: kind, unit, axis up, place, extent, grid, holes. Asked,
never guessed.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Literal

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_int, read_only

Kind = Literal["mesh", "grid", "cloud"]
Holes = Literal["no-go", "fill"]
_UPS = ("x", "y", "z")
_KINDS: tuple[Kind, ...] = ("mesh", "grid", "cloud")
SUFFIXES_OF: Mapping[Kind, tuple[str, ...]] = MappingProxyType(
    {
        "grid": (".npy", ".npz", ".csv", ".png"),
        "mesh": (".stl", ".obj", ".ply", ".dae", ".off", ".glb", ".xml"),
        "cloud": (".pcd", ".xyz"),
    }
)
"""Endings of files that say by their name what they hold, but for a .ply."""
SUFFIXES = tuple(suffix for suffixes in SUFFIXES_OF.values() for suffix in suffixes)
_HOLES: tuple[Holes, ...] = ("no-go", "fill")
MOST_TRIANGLES = 200_000
"""Most triangles of a mesh, unless it is said otherwise."""
_WIDEST_M = 200.0
"""No terrain of a legged robot spans more [m]; one that does is a file in millimetres."""
OTHER_UNIT = "see unit_m, the length of the file's unit"
"""Hint for sizes that no terrain has: which unit it is they do not tell."""
_HEARD: ContextVar[list[str] | None] = ContextVar("doubts of a ground", default=None)
"""Doubts of the reading that goes on."""


def doubt(text: str) -> str:
    """Warn of something that a reader mended or left out, and keep it for whoever asked."""
    if (heard := _HEARD.get()) is not None and text not in heard:
        heard.append(text)
    warnings.warn(text, stacklevel=3)
    return text


@contextmanager
def doubts() -> Iterator[list[str]]:
    """Hear what readers doubt meanwhile; whoever listens already hears it, too."""
    heard, outer = list[str](), _HEARD.get()
    token = _HEARD.set(heard)
    try:
        yield heard
    finally:
        _HEARD.reset(token)
        if outer is not None:
            outer += [text for text in heard if text not in outer]


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Options that turn a file into a terrain in the world's frame, in metres, z up.

    Arguments:
        kind: what the file holds, "mesh", "grid" or "cloud"; None where its name says so. A mesh
            that is called a "grid" becomes the map of its upper side.
        unit_m: length of the file's unit [m]; 0.001 for millimetres.
        up: the file's axis that points up, "x", "y" or "z"; of meshes and clouds.
        offset_m: added to every point, after unit and axis, shape (3,) [m].
        crop_m: what is kept, in the world's frame: x from, to, y from, to, or with z from, to
            besides [m].
        spacing_m: spacing of a grid, of the map that a cloud becomes, and at which a mesh is
            sampled for walks [m].
        height_m: heights of black and white in a .png [m].
        holes: what has no height: "no-go" is no terrain, "fill" lies on a membrane over its border.
        most_triangles: a mesh with more is refused before it is read.

    Raises:
        InvalidInput: for a value out of range.
    """

    kind: Kind | None = None
    unit_m: float = 1.0
    up: Literal["x", "y", "z"] = "z"
    offset_m: Sequence[float] = (0.0, 0.0, 0.0)
    crop_m: Sequence[float] | None = None
    spacing_m: float = 0.05
    height_m: tuple[float, float] | None = None
    holes: Holes = "no-go"
    most_triangles: int = MOST_TRIANGLES

    def __post_init__(self) -> None:
        for name, known in (("kind", (None, *_KINDS)), ("up", _UPS), ("holes", _HOLES)):
            if getattr(self, name) not in known:
                words = ", ".join(word for word in known if word)
                raise InvalidInput(f"{name}: expected one of {words}, got {getattr(self, name)!r}")
        checked(self.unit_m, "unit_m", above=0.0)
        checked(self.spacing_m, "spacing_m", above=0.0, most=_WIDEST_M)
        checked_int(self.most_triangles, "most_triangles", least=1)
        read_only(self.offset_m, (3,), "offset_m")
        crop = self.crop_m
        if crop is not None and (
            len(crop) not in (4, 6)
            or not np.all(np.isfinite(crop))
            or np.any(np.diff(crop)[::2] <= 0.0)
        ):
            raise InvalidInput(
                "crop_m: expected x from, x to, y from, y to, and z if wanted, each to beyond its "
                "from, got "
                f"{list(crop)}"
            )

    def placed(self, points: Array) -> Array:
        """Points of the file, shape (K, 3), in the world's frame [m]: unit, then axis, then
        offset.
        """
        turn = [_UPS.index(axis) for axis in self.axes]
        with np.errstate(over="ignore"):  # what is too far away is refused by its readers
            return np.asarray(
                self.unit_m * points[:, turn] + np.asarray(self.offset_m, dtype=np.float64)
            )

    @property
    def axes(self) -> str:
        """The file's axes that become x, y and z of the world: they change places in a circle,
        which is no mirror.
        """
        return {"x": "yzx", "y": "zxy", "z": "xyz"}[self.up]

    @property
    def box_m(self) -> Array:
        """Lowest and highest corner of what is kept, shape (2, 3) [m]."""
        crop = np.array(
            [*(self.crop_m or (-np.inf, np.inf) * 3), -np.inf, np.inf][:6], dtype=np.float64
        )
        return crop.reshape(3, 2).T


def check_unasked(options: ImportOptions, name: str) -> None:
    """Raise InvalidInput for options of a file where there is none."""
    for field in fields(options):
        if getattr(options, field.name) != field.default:
            raise InvalidInput(
                f"{field.name}: expected none with {name or 'a height field'}, which is read from "
                "no file"
            )
