"""Terrains as the command line names them: a reference, a draw, FILE.py:NAME, or a file with its numbers' meaning."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown

if TYPE_CHECKING:
    from stancekit.planners.terrain.heightfield import HeightField


@dataclass
class TerrainFile:
    """What the numbers of a terrain's file mean."""

    spacing_m: float = 0.05
    """Grid spacing of a file, and at which a mesh is sampled [m]."""
    unit_m: float = 1.0
    """What one unit of lengths in a file means [m]; 0.001 for millimetres."""
    smooth_m: float = 0.0
    """Deviation of a Gaussian that smooths a file's heights; a wall has to be wider than the grid's spacing [m]."""
    heights_m: Annotated[str | None, tyro.conf.arg(metavar="BLACK,WHITE")] = None
    """Heights of black and white in a .png [m]."""

    def read(self, name: str) -> HeightField:
        """The terrain of a name. Raises InvalidInput."""
        from stancekit.planners.terrain.reference import named_terrain

        options: dict[str, Any] = {"spacing_m": self.spacing_m, "unit_m": self.unit_m, "smooth_m": self.smooth_m}
        if self.heights_m is not None:
            options["height_m"] = numbers(self.heights_m, "--heights-m", float, 2)
        try:
            return named_terrain(name, **options)
        except InvalidInput as error:
            raise InvalidInput(_as_options(str(error))) from None


def _as_options(message: str) -> str:
    """A reader's message with its settings as the options that give them."""
    message = re.sub(r"\bheight_m\b", "--heights-m", message)
    return re.sub(r"\b(spacing|unit|smooth)_m\b=?", r"--\1-m ", message).replace("-m :", "-m:")


def numbers(text: str, option: str, kind: type, count: int) -> tuple[Any, ...]:
    """As many numbers as an option wants, with commas between them. Raises InvalidInput."""
    try:
        found = tuple(kind(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count:
        raise InvalidInput(f"{option}: expected {count} numbers with commas between them, got {shown(text)}")
    return found
