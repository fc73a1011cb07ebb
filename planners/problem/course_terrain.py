"""Terrains of courses: lists of polygons, meshes, and generators that follow the course's path.

A terrain is asked for its surfaces along a path, the straight lines between the points where the
body's centre of mass is to go. Generators reach far enough beyond both ends for every toe.
"""

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
from ..terrain.footholds import FRICTION, FootholdLimits, Footholds, Rung
from ..terrain.import_options import MOST_TRIANGLES, ImportOptions, check_unasked
from ..terrain.patch import Patch
from ..terrain.polygon import checked_sole, surface_patch, surface_patches

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


_BEYOND_M = 0.6
"""Length by which a generated terrain goes on beyond the ends of the path [m]."""

_INSIDE_M = 1.0
"""Footholds of bars are those inside of any margin of candidates [m]."""

_Lean = Annotated[float, Field(ge=-1.0, le=1.0)]
_PanelRow = Annotated[str, Field(pattern=r"^[#.]+$")]
_LEAST_RISE_M = 1e-3
"""A step lower than this has no riser [m]."""


class PolygonSpec(BaseModel):
    """One polygon: its corners in order; the normal by their order unless given; its own friction,
    where it has one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    vertices_m: Annotated[list[Point], Field(min_length=3)]
    normal: Point | None = None
    shear_reference: Point | None = None
    friction: Friction | None = None
    footing: bool = True


class Polygons(TerrainSpec):
    """A list of convex polygons."""

    kind: Literal["polygons"]
    polygons: Annotated[list[PolygonSpec], Field(min_length=1)]

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The polygons, wherever the path goes."""
        return Terrain(
            tuple(self._patch(index, polygon) for index, polygon in enumerate(self.polygons)),
            tuple(polygon.footing for polygon in self.polygons),
        )

    def _patch(self, index: int, polygon: PolygonSpec) -> Patch:
        friction = self.friction if polygon.friction is None else polygon.friction
        try:
            if polygon.normal is None:
                patch = surface_patch(np.array(polygon.vertices_m), friction)
            else:
                towards = np.mean(polygon.vertices_m, axis=0) + np.array(polygon.normal)
                patch = surface_patch(np.array(polygon.vertices_m), friction, towards_m=towards)
                patch = replace(patch, normal=np.array(polygon.normal))
            if polygon.shear_reference is not None:
                patch = replace(patch, shear_reference=np.array(polygon.shear_reference))
        except InvalidInput as error:
            raise InvalidInput(f"terrain.polygons[{index}].{error}") from None
        return patch


class Flat(TerrainSpec):
    """Level ground at z = 0.

    Arguments:
        width_m: width to each side of the path.
    """

    kind: Literal["flat"]
    width_m: Positive = 0.7

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """One level rectangle under the whole path."""
        low, high = path_m[:, 0].min() - _BEYOND_M, path_m[:, 0].max() + _BEYOND_M
        return Terrain(
            (_level(low, high, -self.width_m, self.width_m, 0.0, self.friction),), (True,)
        )


class Stairs(TerrainSpec):
    """Level ground, then steps up along x.

    Arguments:
        first_m: x of the first riser.
        rises_m: heights of the steps, repeated.
    """

    kind: Literal["stairs"]
    first_m: Length = 0.30
    run_m: Positive = 0.26
    rises_m: Annotated[list[Length], Field(min_length=1)] = [0.06]
    width_m: Positive = 0.5

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """Treads, on which to stand, and risers, in the way."""
        end = path_m[:, 0].max() + _BEYOND_M
        count = max(0, int(np.ceil(min((end - self.first_m) / self.run_m, MOST_PATCHES))))
        _check_size(2 * count)
        start = min(path_m[:, 0].min() - _BEYOND_M, self.first_m - 0.1)
        patches = [
            _level(
                start,
                self.first_m if count else end,
                -self.width_m,
                self.width_m,
                0.0,
                self.friction,
            )
        ]
        footing, height = [True], 0.0
        for step in range(count):
            x, rise = self.first_m + step * self.run_m, self.rises_m[step % len(self.rises_m)]
            if abs(rise) > _LEAST_RISE_M:
                patches.append(self._riser(x, height, height + rise))
                footing.append(False)
            height += rise
            patches.append(
                _level(x, x + self.run_m, -self.width_m, self.width_m, height, self.friction)
            )
            footing.append(True)
        return Terrain(tuple(patches), tuple(footing))

    def _riser(self, x: float, low: float, high: float) -> Patch:
        w, side = self.width_m, np.array([-1.0 if high > low else 1.0, 0.0, 0.0])
        corners = np.array([(x, -w, low), (x, w, low), (x, w, high), (x, -w, high)])
        return surface_patch(corners, self.friction, towards_m=corners.mean(axis=0) + side)


class Walls(TerrainSpec):
    """Two facing walls along x.

    Arguments:
        apart_m: distance of each wall from the middle.
        lean_rad: lean of the left and the right wall, positive if inward at the top.
        offset_m: further distance of the left and the right wall.
    """

    kind: Literal["walls"]
    apart_m: Positive = 0.38
    lean_rad: tuple[_Lean, _Lean] = (0.0, 0.0)
    offset_m: tuple[Length, Length] = (0.0, 0.0)

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """One tall rectangle a side."""
        (low, high), (bottom, top) = _span(path_m[:, 0]), _span(path_m[:, 2])
        panels = [(side, low, high, bottom, top) for side in (0, 1)]
        return Terrain(self._panels(panels, path_m[0], [self.friction] * 2), (True, True))

    def _panels(
        self,
        panels: Sequence[tuple[int, float, float, float, float]],
        about: Array,
        frictions: Sequence[float],
    ) -> tuple[Patch, ...]:
        """Rectangles of the walls, which lean about the height of the start.

        Arguments:
            panels: for each panel its side, its two ends along x and its two ends along z.
        """
        corners = np.array([self._corners(*panel, about) for panel in panels]).reshape(-1, 4, 3)
        middles = [
            (0.5 * (low + high), 0.0, 0.5 * (bottom + top)) for _, low, high, bottom, top in panels
        ]
        return surface_patches(corners, frictions, np.array(middles).reshape(-1, 3))

    def _corners(
        self, side: int, low: float, high: float, bottom: float, top: float, about: Array
    ) -> list[Point]:
        sign = (1.0, -1.0)[side]
        slope = np.tan(self.lean_rad[side])

        def corner(x: float, z: float) -> Point:
            return x, sign * (self.apart_m + self.offset_m[side] - slope * (z - about[2])), z

        return [corner(low, bottom), corner(high, bottom), corner(high, top), corner(low, top)]


class IcyWalls(Walls):
    """Two walls of square panels, some without friction.

    Arguments:
        left, right: rows from the bottom up, ``#`` grips and ``.`` is ice, one sign a panel along
            x; rows and signs are repeated. The panels' grid goes through the start.
    """

    kind: Literal["icy-walls"]  # type: ignore[assignment]
    panel_m: Positive = 0.30
    left: Annotated[list[_PanelRow], Field(min_length=1)]
    right: Annotated[list[_PanelRow], Field(min_length=1)]

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """Panels row by row, left wall first."""
        _check_size(2 * _count(path_m[:, 0], self.panel_m) * _count(path_m[:, 2], self.panel_m))
        panels, frictions = list[tuple[int, float, float, float, float]](), list[float]()
        columns, rows = (_grid(path_m[:, axis], path_m[0, axis], self.panel_m) for axis in (0, 2))
        for side, pattern in enumerate((self.left, self.right)):
            for row, bottom in enumerate(rows[:-1]):
                signs = pattern[row % len(pattern)]
                for column, low in enumerate(columns[:-1]):
                    grips = signs[column % len(signs)] == "#"
                    high, top = low + self.panel_m, bottom + self.panel_m
                    panels.append((side, low, high, bottom, top))
                    frictions.append(self.friction if grips else 0.0)
        return Terrain(self._panels(panels, path_m[0], frictions), (True,) * len(panels))


class Tube(TerrainSpec):
    """A vertical tube about the start, of rings of flat facets.

    Arguments:
        leans_rad: lean of the facets, in turn, positive if inward at the top.
    """

    kind: Literal["tube"]
    radius_m: Positive = 0.40
    sides: Annotated[int, Field(ge=3, le=64)] = 6
    ring_m: Positive = 0.25
    first_azimuth_rad: Length = np.pi / 6.0
    leans_rad: Annotated[list[_Lean], Field(min_length=1)] = [0.15, -0.1, 0.05, -0.15, 0.1]

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """Rings from the bottom up, each facet a rectangle tangent to the tube at its middle."""
        _check_size(self.sides * _count(path_m[:, 2], self.ring_m))
        levels = _grid(path_m[:, 2], path_m[0, 2], self.ring_m)
        facets, insides = list[Array](), list[Array]()
        for index in range(self.sides * (len(levels) - 1)):
            ring, side = divmod(index, self.sides)
            azimuth = self.first_azimuth_rad + 2.0 * np.pi * side / self.sides
            lean = self.leans_rad[index % len(self.leans_rad)]
            corners, inside = self._facet(
                path_m[0], azimuth, levels[ring] + 0.5 * self.ring_m, lean
            )
            facets.append(corners)
            insides.append(inside)
        patches = surface_patches(
            np.array(facets).reshape(-1, 4, 3),
            [self.friction] * len(facets),
            np.array(insides).reshape(-1, 3),
        )
        return Terrain(patches, (True,) * len(patches))

    def _facet(
        self, about: Array, azimuth: float, height: float, lean: float
    ) -> tuple[Array, Array]:
        """The corners of a facet, shape (4, 3), and a point inside the tube, shape (3,) [m]."""
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        along, up = np.array([-out[1], out[0], 0.0]), np.array([0.0, 0.0, 1.0])
        centre = np.array([about[0], about[1], height]) + self.radius_m * out
        half_width = self.radius_m * np.tan(np.pi / self.sides)
        rise = 0.5 * self.ring_m * (np.cos(lean) * up - np.sin(lean) * out)
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        corners = np.array([centre + s * half_width * along + t * rise for s, t in signs])
        return corners, centre - out


class Bars(TerrainSpec):
    """Level bars across the way, flat on top or round, as of a grating or a ladder that lies; one
    is under the start.

    Arguments:
        bar_m: width of a flat bar, diameter of a round one.
        margin_m: distance of feet from the borders of flat bars, and from the ends of all bars.
    """

    kind: Literal["bars"]
    apart_m: Positive = 0.12
    bar_m: Annotated[float, Field(ge=0.008, le=0.5)] = 0.03
    round: bool = False
    width_m: Positive = 0.5
    margin_m: Annotated[float, Field(ge=0.0, le=0.5)] = 0.012

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """Their tops at z = 0: of round ones the lines that feet stand on, and their sides."""
        low, high = _span(path_m[:, 0])
        _check_size(7 * int(min((high - low) / self.apart_m, MOST_PATCHES)))
        first, last = np.ceil(
            (np.array([low, -high]) - path_m[0, 0] * np.array([1.0, -1.0])) / self.apart_m
        )
        places = path_m[0, 0] + self.apart_m * np.arange(first, 1.0 - last)
        if self.round:
            return self._round(places)
        half = 0.5 * self.bar_m
        if half <= self.margin_m:
            raise InvalidInput(
                f"terrain.bar_m: expected more than {2.0 * self.margin_m:g} m, twice margin_m, got "
                f"{self.bar_m:g}"
            )
        bars = tuple(
            _level(x - half, x + half, -self.width_m, self.width_m, 0.0, self.friction)
            for x in places
        )
        inner, end = half - self.margin_m, self.width_m - self.margin_m
        tops = tuple(_level(x - inner, x + inner, -end, end, 0.0, self.friction) for x in places)
        return Terrain(bars, (False,) * len(bars), tops, _INSIDE_M)

    def _round(self, places: Array) -> Terrain:
        radius, end = 0.5 * self.bar_m, self.width_m - self.margin_m
        ends = np.array([[0.0, -self.width_m, -radius], [0.0, self.width_m, -radius]])
        rungs = [Rung.between(ends + np.array([x, 0.0, 0.0]), radius) for x in places]
        lines = tuple(rung.line(-end, end, self.friction) for rung in rungs)
        sides = tuple(
            side
            for rung in rungs
            for side in rung.sides(-self.width_m, self.width_m, self.friction)
        )
        return Terrain((*lines, *sides), (False,) * (len(lines) + len(sides)), lines, _INSIDE_M)


class GroundToWall(Walls):
    """Level ground at z = 0 between two walls that stand on it."""

    kind: Literal["ground-to-wall"]  # type: ignore[assignment]

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The ground, then the left wall, then the right one."""
        (low, high), (_, top) = _span(path_m[:, 0]), _span(path_m[:, 2])
        base = np.array([0.0, 0.0, 0.0])
        left, right = (self.apart_m + self.offset_m[side] for side in (0, 1))
        patches = [_level(low, high, -right, left, 0.0, self.friction)]
        panels = [(side, low, high, 0.0, top) for side in (0, 1)]
        patches += self._panels(panels, base, [self.friction] * 2)
        return Terrain(tuple(patches), (True,) * 3)


AnyTerrain = Annotated[
    Polygons
    | FileTerrain
    | Flat
    | Stairs
    | Walls
    | IcyWalls
    | Tube
    | Bars
    | GroundToWall
    | FamilyScene,
    Field(discriminator="kind"),
]


def _level(
    low: float, high: float, right: float, left: float, height: float, friction: float
) -> Patch:
    corners = np.array(
        [(low, right, height), (high, right, height), (high, left, height), (low, left, height)]
    )
    return surface_patch(corners, friction)


def _span(values: Array) -> tuple[float, float]:
    return float(values.min()) - _BEYOND_M, float(values.max()) + _BEYOND_M


def _grid(values: Array, through: float, spacing: float) -> Array:
    """Lines a spacing apart, one of them half a spacing off ``through``, from below the values to
    above them.
    """
    low, high = _span(values)
    first = np.floor((low - through) / spacing - 0.5)
    last = np.ceil((high - through) / spacing - 0.5)
    return np.asarray(through + (np.arange(first, last + 1) + 0.5) * spacing)


def _count(values: Array, spacing: float) -> int:
    """Number of pieces that such a grid has, or up to two fewer."""
    low, high = _span(values)
    return int(min((high - low) / spacing, MOST_PATCHES + 1.0))


def _check_size(patches: int) -> None:
    if patches > MOST_PATCHES:
        raise InvalidInput(
            f"terrain: expected at most {MOST_PATCHES} patches along the path, got more"
        )
