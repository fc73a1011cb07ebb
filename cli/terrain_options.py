"""Terrains as the command line names them: a reference, a draw, FILE.py:NAME, or a file with its
numbers' meaning.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import tyro

from stancekit.planners.errors import InvalidInput

from .options import OptionalFloat, OptionalInt, OptionalText

if TYPE_CHECKING:
    from stancekit.planners.terrain.footholds import FootholdLimits
    from stancekit.planners.terrain.heightfield import HeightField
    from stancekit.planners.terrain.import_options import ImportOptions

OF_FILES = (
    "kind",
    "spacing_m",
    "unit_m",
    "up",
    "offset_m",
    "crop_m",
    "holes",
    "most_triangles",
    "smooth_m",
    "grid_m",
)

OF_FILE = (tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="terrain's file"))
"""How the options of a ``TerrainFile`` are shown."""


@dataclass
class FileMeaning:
    """Options that say what the numbers of a terrain's file mean, but for a grid's spacing."""

    kind: Annotated[
        Optional[Literal["mesh", "grid", "cloud"]],  # noqa: UP045
        tyro.conf.arg(metavar="{mesh,grid,cloud}"),
    ] = None
    """What the file holds, where its name does not say: a .npy or .csv of three columns may be a
    cloud or a grid. A mesh that is called a grid is the map of its upper side."""
    unit_m: float = 1.0
    """What one unit of lengths in a file means [m]; 0.001 for millimetres."""
    up: Literal["x", "y", "z"] = "z"
    """Which axis of a mesh or cloud points up. With y, the file's z becomes x and its x becomes y;
    with x, its y becomes x and its z becomes y."""
    offset_m: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y,Z")] = None
    """Added to every point, after unit and axis [m]; before a negative number the sign =, as in
    --offset-m=-1,0,0."""
    crop_m: Annotated[OptionalText, tyro.conf.arg(metavar="X,X,Y,Y[,Z,Z]")] = None
    """What is kept, from and to along each axis, after the offset [m]."""
    holes: Literal["no-go", "fill"] = "no-go"
    """What has no height (NaN, transparent pixels, cells without points): no terrain, or a membrane
    over it."""
    most_triangles: OptionalInt = None
    """A mesh with more is refused by its header; 200,000 unless given."""
    heights_m: Annotated[OptionalText, tyro.conf.arg(metavar="BLACK,WHITE")] = None
    """Heights of black and white in a .png [m]."""

    def options(self, spacing_m: float = 0.05) -> ImportOptions:
        """Import options that the reader wants, with a grid's spacing.

        Raises InvalidInput.
        """
        from stancekit.planners.terrain.import_options import ImportOptions

        import_settings: dict[str, Any] = {
            name: getattr(self, name) for name in ("kind", "unit_m", "up", "holes")
        } | {"spacing_m": spacing_m}
        if self.heights_m is not None:
            import_settings["height_m"] = numbers(self.heights_m, "--heights-m", float, 2)
        if self.offset_m is not None:
            import_settings["offset_m"] = numbers(self.offset_m, "--offset-m", float, 3)
        if self.crop_m is not None:
            import_settings["crop_m"] = numbers(
                self.crop_m, "--crop-m", float, 6 if self.crop_m.count(",") > 3 else 4
            )
        if self.most_triangles is not None:
            import_settings["most_triangles"] = self.most_triangles
        with in_options():
            return ImportOptions(**import_settings)


@dataclass
class TerrainFile(FileMeaning):
    """Options that say what the numbers of a terrain's file mean."""

    spacing_m: float = 0.05
    """Grid spacing of a file, of the map that a cloud becomes, and at which a mesh is sampled for
    walks [m]."""
    smooth_m: float = 0.0
    """Deviation of a Gaussian that smooths heights for walks; a wall has to be wider than the
    grid's spacing [m]."""

    def read(self, name: str) -> HeightField:
        """The terrain of a name as one height at every place.

        Raises InvalidInput.
        """
        from stancekit.terrains import heights

        with in_options():
            return heights(name, smooth_m=self.smooth_m, **vars(self.asked()))

    def asked(self) -> ImportOptions:
        """Import options that the reader wants.

        Raises InvalidInput.
        """
        return self.options(self.spacing_m)


@dataclass
class FootholdOptions:
    """Options that say what counts as a foothold."""

    slope_rad: float = 0.6
    """Steepest ground to stand on [rad]."""
    headroom_m: OptionalFloat = None
    """What is free above a foothold, along its normal [m]; unless given, 0.1 of a robot of the
    default hexapod's size, and in proportion."""
    margin_m: OptionalFloat = None
    """Margin of footholds from the borders of their surface [m]; unless given, the radius of the
    robot's foot, else 0.02."""
    width_m: OptionalFloat = None
    """Least width of a foothold inside the margin [m]; unless given, likewise."""
    roughness_m: float = 0.006
    """How far heights of a map may be off a foothold's plane, rms [m]."""
    noise_m: OptionalFloat = None
    """Deviation of the sensor that made a map or a cloud, allowed for beside the roughness; unless
    given, it is estimated from the heights [m]."""

    def limits(self) -> FootholdLimits:
        """Limits of footholds.

        Raises InvalidInput.
        """
        from stancekit.planners.terrain.footholds import FootholdLimits

        settings = {k: v for k, v in vars(self).items() if k != "headroom_m"}
        with in_options():
            return FootholdLimits(clearance_m=self.headroom_m, **settings)


@contextmanager
def in_options() -> Iterator[None]:
    """Let a reader's message name its settings as the options that give them."""
    try:
        yield
    except InvalidInput as error:
        message = re.sub(r"\bheight_m\b", "--heights-m", str(error))
        names = "|".join(
            (*OF_FILES, "slope_rad", "clearance_m", "margin_m", "width_m", "roughness_m", "noise_m")
        )
        text = re.sub(rf"(?<![-\w])({names})\b(=|: (?=\w+ ?))?", _as_option, message)
        raise InvalidInput(text) from None


def _as_option(found: re.Match[str]) -> str:
    """A setting as its option; ``kind`` and the like only where a value is set."""
    name, sign = found[1], found[2] or ""
    if not name.endswith(("_m", "_rad", "_triangles")) and not sign:
        return name
    return f"--{name.replace('_', '-')}{' ' if sign == '=' else sign}"


def numbers(text: str, option: str, kind: type, count: int) -> tuple[Any, ...]:
    """Read the numbers of an option, which are separated by commas.

    Raises InvalidInput.
    """
    try:
        parts = tuple(kind(part) for part in text.split(","))
    except ValueError:
        parts = ()
    if len(parts) != count:
        from stancekit.planners.files.validation import shown  # slow to import

        raise InvalidInput(
            f"{option}: expected {count} numbers with commas between them, got {shown(text)}"
        )
    return parts
