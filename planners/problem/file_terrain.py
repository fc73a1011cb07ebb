"""Terrains of courses from files: meshes, grids and point clouds, with footholds on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, ValidationError

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import KEYS
from ..files.validation import validation_errors
from ..terrain.foothold_search import read_footholds
from ..terrain.footholds import FootholdLimits, Footholds
from ..terrain.import_options import MOST_TRIANGLES, ImportOptions
from ..terrain.terrain import Terrain
from .terrain_spec import MOST_PATCHES, Length, Point, Positive, TerrainSpec


class FileTerrain(TerrainSpec):
    """A file: a mesh, a grid of heights, or a point cloud, as ``kind`` says, or as its name does
    (``file``).

    Arguments:
        unit_m, up, offset_m, crop_m, spacing_m, height_m, holes, most_triangles: what its numbers
            mean, see ``ImportOptions``.
        footholds: limits of places where toes may stand.
    """

    kind: Literal["mesh", "grid", "cloud", "file"] = "file"
    file: str
    unit_m: Positive = 1.0
    up: Literal["x", "y", "z"] = "z"
    offset_m: Point = (0.0, 0.0, 0.0)
    crop_m: Annotated[list[Length], Field(min_length=4, max_length=6)] | None = None
    spacing_m: Positive = 0.05
    height_m: tuple[Length, Length] | None = None
    holes: Literal["no-go", "fill"] = "no-go"
    most_triangles: Annotated[int, Field(ge=1)] = MOST_TRIANGLES
    footholds: Annotated[FootholdLimits, KEYS] = FootholdLimits()
    _found: Footholds | None = PrivateAttr(None)

    @classmethod
    def of(cls, footholds: Footholds) -> FileTerrain:
        """A terrain whose footholds were found before.

        Raises InvalidInput for one of several frictions, or of none.
        """
        if not footholds.pieces:
            raise InvalidInput(
                f"{footholds.name or 'terrain'}: expected some with footholds, got none"
            )
        flat = [piece.patch for piece in footholds.pieces if not piece.turn_rad]
        patches = (*footholds.surfaces, *flat)
        if frictions := sorted({patch.friction for patch in patches})[1:]:
            least = min(patch.friction for patch in patches)
            raise InvalidInput(
                f"{footholds.name or 'terrain'}: expected one friction for the whole terrain, got frictions "
                f"from {least:g} to {frictions[-1]:g}"
            )
        try:
            made = cls(
                file=footholds.name, friction=patches[0].friction, footholds=footholds.limits
            )
        except ValidationError as error:
            raise InvalidInput(
                f"{footholds.name}: {'; '.join(validation_errors(error, cls))}"
            ) from None
        made._found = made._counted(footholds)
        return made

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """All of the file, wherever the path goes; read once."""
        footholds = self._found
        if footholds is None:
            footholds = self._found = self.read(folder)
        sources = [piece.found for piece in footholds.pieces]
        standing = [piece for piece in sources if piece is not None] or footholds.pieces
        pieces = tuple(piece.on(self.friction) for piece in standing)
        lines = [patch for patch, piece in zip(pieces, standing, strict=True) if piece.turn_rad]
        each = [*(patch.with_friction(self.friction) for patch in footholds.surfaces), *lines]
        return Terrain(tuple(each), (False,) * len(each), pieces, self.footholds.margin_m)

    def read(self, folder: Path) -> Footholds:
        """The footholds of the file, and its surfaces.

        Raises InvalidInput.
        """
        keys = (
            "unit_m",
            "up",
            "offset_m",
            "crop_m",
            "spacing_m",
            "height_m",
            "holes",
            "most_triangles",
        )
        kind = None if self.kind == "file" else self.kind
        options = ImportOptions(kind=kind, **{key: getattr(self, key) for key in keys})
        return self._counted(read_footholds(folder / self.file, options, self.footholds))

    def _counted(self, found: Footholds) -> Footholds:
        """Check the number of footholds and return them.

        Raises InvalidInput for too many.
        """
        if len(found.surfaces) + len(found.pieces) > MOST_PATCHES:
            raise InvalidInput(
                f"{self.file}: expected at most {MOST_PATCHES} surfaces and footholds, got "
                f"{len(found.surfaces) + len(found.pieces)}; crop_m takes a part, spacing_m a "
                "coarser map"
            )
        return found
