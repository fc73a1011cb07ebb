"""Terrains of courses from files: meshes, grids and point clouds, with footholds on them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, PrivateAttr, ValidationError

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import KEYS
from ..files.documents import validation_errors
from ..robot.model import Robot
from ..robot.robot_file import BUILT_IN, named_robot
from ..terrain.footholds import FRICTION, FootholdLimits, Footholds
from ..terrain.import_options import MOST_TRIANGLES, ImportOptions
from ..terrain.terrain import Terrain
from .terrain_spec import MOST_PATCHES, Length, Point, Positive, TerrainSpec

if TYPE_CHECKING:
    from ..terrain.heightfield import HeightField


def footholds_for(
    robot: Robot | str | Path | None,
    source: HeightField | str | Path,
    *,
    options: ImportOptions = ImportOptions(),
    limits: FootholdLimits = FootholdLimits(),
    friction: float = FRICTION,
) -> Footholds:
    """The footholds of a terrain for a robot: what the limits leave open follows its feet.

    Every door of a terrain, or of a course over one, asks here.

    Arguments:
        robot: a robot, its name or its file; None for feet of ``FOOT_M``, as the default hexapod.
        source: a height field, a file, or the name of a ground.

    Raises:
        InvalidInput: for what cannot be read, and a terrain without footholds.
    """
    from ..terrain.elevation import ElevationMap
    from ..terrain.foothold_search import check_unasked, footholds_of
    from ..terrain.heightfield import HeightField
    from ..terrain.reference import footholds_on  # splines are slow to import

    limits = limits.for_foot(*_foot(robot))
    if not isinstance(source, HeightField):
        return footholds_on(source, options, limits, friction)
    check_unasked(options, source.name)
    return footholds_of(ElevationMap.of_field(source), limits, friction)


def _foot(robot: Robot | str | Path | None) -> tuple[float, float]:
    """The largest radius of its feet, 0 where no file says it [m], and its size."""
    if robot is None or str(robot) in BUILT_IN:
        return 0.0, 1.0
    if isinstance(robot, Robot):
        return robot.source.known_radius_m, robot.size
    model = named_robot(robot)
    return max((leg.radius_m for leg in model.legs), default=0.0), model.size


class FileTerrain(TerrainSpec):
    """A file: a mesh, a grid of heights, or a point cloud, as ``kind`` says, or as its name does
    (``file``).

    Arguments:
        unit_m, up, offset_m, crop_m, spacing_m, height_m, holes, most_triangles: what its numbers
            mean, see ``ImportOptions``.
        footholds: limits of places where toes may stand; what is None follows the robot's feet.
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
    _given: Footholds | None = PrivateAttr(None)
    _read: dict[str, Footholds] = PrivateAttr(default_factory=dict)

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
        made._given = made._counted(footholds)
        return made

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """All of the file, wherever the path goes; read once."""
        footholds = self._given or self.read(folder)
        sources = [piece.found for piece in footholds.pieces]
        standing = [piece for piece in sources if piece is not None] or footholds.pieces
        pieces = tuple(piece.on(self.friction) for piece in standing)
        lines = [patch for patch, piece in zip(pieces, standing, strict=True) if piece.turn_rad]
        each = [*(patch.with_friction(self.friction) for patch in footholds.surfaces), *lines]
        return Terrain(tuple(each), (False,) * len(each), pieces, self.footholds.inset_m)

    @property
    def given(self) -> Footholds | None:
        """The footholds that it was made of; None of a file."""
        return self._given

    def for_robot(self, robot: Robot) -> Self:
        """The terrain whose footholds follow the feet of a robot where its limits leave that open."""
        limits = self.footholds.for_foot(*_foot(robot))
        return self if self._given else self.model_copy(update={"footholds": limits})

    def read(self, folder: Path) -> Footholds:
        """The footholds of the file, and its surfaces; read once.

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
        key = str((folder / self.file, options, self.footholds))
        if key not in self._read:
            from ..terrain.foothold_search import read_footholds  # scipy and trimesh

            self._read[key] = self._counted(
                read_footholds(folder / self.file, options, self.footholds)
            )
        return self._read[key]

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
