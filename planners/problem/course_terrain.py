"""Terrains of courses: lists of polygons, meshes, and generators that follow the course's path.

A terrain is asked for its surfaces along a path, the straight lines between the points where the
body's centre of mass is to go. Generators reach far enough beyond both ends for every toe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import Array
from ..terrain.families import Terrain
from ..terrain.footholds import Rung
from ..terrain.patch import Patch
from ..terrain.polygon import surface_patch, surface_patches
from .terrain_spec import (
    MOST_PATCHES,
    FamilyScene as FamilyScene,
    FileTerrain as FileTerrain,
    Friction as Friction,
    Length as Length,
    Point as Point,
    Positive as Positive,
    TerrainSpec as TerrainSpec,
)

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
    rises_m: Annotated[list[Length], Field(min_length=1)] = [0.06]  # noqa: RUF012
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
    leans_rad: Annotated[list[_Lean], Field(min_length=1)] = [0.15, -0.1, 0.05, -0.15, 0.1]  # noqa: RUF012

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
