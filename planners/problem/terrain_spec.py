"""Base of all terrains of courses in a file: friction, and the answer to a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    field_validator,
)

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from ..files.codec import KEYS
from ..files.documents import validation_errors
from ..robot.leg import FOOT_RADIUS_M
from ..robot.model import BUILT_IN, Robot
from ..terrain.families import TERRAIN_FAMILIES, Terrain, family_terrain, read_draw
from ..terrain.footholds import FRICTION, FootholdLimits, Footholds
from ..terrain.import_options import MOST_TRIANGLES, ImportOptions, check_unasked
from ..terrain.patch import Patch
from ..terrain.polygon import checked_sole

if TYPE_CHECKING:
    from ..terrain.heightfield import HeightField


MOST_PATCHES = 5000
ROOM_M = 0.002
"""Between a foot and what rises beside its surface [m]."""
Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0.0, le=LARGEST)]
Friction = Annotated[float, Field(ge=0.0, le=10.0)]
Point = tuple[Length, Length, Length]


def _sole(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    try:
        checked_sole(np.array(points).reshape(-1, 2), "")
    except InvalidInput as error:
        raise InvalidInput(str(error).removeprefix(": ")) from None
    return points


SolePoints = Annotated[list[tuple[Length, Length]], AfterValidator(_sole)]
"""Corners of a sole about its toe [m], see ``sole.checked_sole``."""


class TerrainSpec(BaseModel, ABC):
    """Base of all kinds of terrain: friction μ, and the answer to a path."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    friction: Friction = 1.0

    def for_robot(self, robot: Robot) -> Self:
        """The terrain with what follows the robot's feet."""
        return self

    @abstractmethod
    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The terrain along a path, shape (L, 3) [m].

        Arguments:
            folder: folder from which relative paths start.
        """


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
    from ..terrain.footholds import footholds_of
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
        soles = any(limb.sole_m is not None for limb in robot.limbs)
        return _EDGE_M if soles else robot.known_radius_m, robot.size
    from ..robot.robot_file import named_robot  # loads all that reads robots

    model = named_robot(robot)
    radii = (leg.radius_m if leg.sole is None else _EDGE_M for leg in model.legs)
    return max(radii, default=0.0), model.size


_EDGE_M = 0.01
"""Distance of a sole, all of which is on the ground, from borders, where a riser may be [m]."""


class FileTerrain(TerrainSpec):
    """A file: a mesh, a grid of heights, or a point cloud, as ``kind`` says, or as its name does
    (``file``).

    Arguments:
        unit_m, up, offset_m, crop_m, spacing_m, height_m, holes, most_triangles: what its numbers
            mean, see ``ImportOptions``.
        footholds: limits of places where toes may stand; what is None follows the robot's feet.
    """

    kind: Literal["mesh", "grid", "cloud", "file"] = "file"
    friction: Friction = FRICTION
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
        made = Terrain(tuple(each), (False,) * len(each), pieces, self.footholds.inset_m)
        return replace(made, doubts=footholds.doubts)

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
            from ..terrain.footholds import read_footholds  # scipy and trimesh

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


_FRAMES, _STRIDE_M, _HEIGHT_M = 4, 0.08, 0.20
"""Numbers of the courses, see ``family_keys``."""


class FamilyScene(TerrainSpec):
    """A scene of a family, see ``terrain.families``, about the origin.

    Arguments:
        friction: a factor on what is drawn.
    """

    kind: Literal["family"] = "family"
    family: str
    level: Annotated[float, Field(ge=0.0, le=1.0)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @field_validator("family")
    @classmethod
    def _is_family(cls, family: str) -> str:
        if (
            family not in TERRAIN_FAMILIES.names()
        ):  # none of a FILE.py: reading a course runs nothing
            raise InvalidInput(
                f"expected one of {', '.join(TERRAIN_FAMILIES.names())}, got {family!r}"
            )
        return family

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The scene, wherever the path goes."""
        return family_terrain(self.family, self.level, self.seed).with_friction(self.friction)


def family_keys(name: str) -> dict[str, Any]:
    """The course of a name FAMILY:LEVEL or FAMILY:LEVEL:SEED, in keys as YAML has them.

    Raises InvalidInput.

    The default hexapod walks FRAMES key frames of a tripod gait, STRIDE_M each, in the mean
    HEIGHT_M above the ground and along it; between walls it climbs. A toe is offered all that it
    could reach.
    """
    family, level, seed = read_draw(name, "course")
    scene = family_terrain(family, level, seed)
    rise = scene.rise
    far = _STRIDE_M * (_FRAMES - 1)
    along = 1.0 if rise is None else float((1.0 + rise**2) ** 0.5)
    x, y, z = scene.begin_m
    start = [x, y, z + _HEIGHT_M]
    goal = (
        [x, y, start[2] + far]
        if rise is None
        else [x + far / along, y, start[2] + far * rise / along]
    )
    stance = {"outward_m": 0.13, "down_m": 0.0 if rise is None else _HEIGHT_M}
    return {
        "name": Path(name).name.replace(":", "-"),
        "frames": _FRAMES,
        "gait": "tripod",
        "start_m": start,
        "goal_m": goal,
        "stride_m": _STRIDE_M,
        "stance": stance,
        "body": {"com_radius_m": 0.06, "first_radius_m": 0.02},
        "steps": {"com_m": 0.15, "toe_m": 0.40, "rotation_rad": 0.15, "progress_m": 0.02},
        "candidates": {"everywhere": True, "margin_m": FOOT_RADIUS_M + ROOM_M},
        "terrain": polygon_keys(*zip(*scene.surfaces, strict=True))
        if ".py:" in family
        else {"kind": "family", "family": family, "level": level, "seed": seed},
    }


def polygon_keys(patches: Sequence[Patch], footing: Sequence[bool]) -> dict[str, Any]:
    """A terrain in keys, surface by surface.

    Arguments:
        footing: truth values, True for patches that toes may stand on.
    """
    polygons = [
        {
            "vertices_m": patch.vertices_m.tolist(),
            "normal": patch.normal.tolist(),
            "friction": patch.friction,
            "shear_reference": patch.shear_reference.tolist(),
            "footing": footing,
        }
        for patch, footing in zip(patches, footing, strict=True)
    ]
    return {"kind": "polygons", "polygons": polygons}
