"""Footholds: the planar convex pieces of a terrain that a foot may be put on, each with how certain
it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from ..errors import InvalidInput, NoPlace
from ..files.arrays import Array, cross
from ..files.codec import Within, check_limits
from .import_options import ImportOptions, doubts
from .patch import FOUND_SD_M, Frame, Patch
from .polygon import clipped, shear_of

if TYPE_CHECKING:
    from .elevation import ElevationMap
    from .triangle_mesh import TriangleMesh


_HALF_WIDTH_M, SHARE = 6e-4, 0.05
"""Half the width of a rung's line: this, or this share of the radius where that is more [m]."""
_SIDES = np.array([0.0, 0.6, 1.2, 1.8])
"""Angles from the line at which the flat sides of a rung that limbs keep out of begin and end
[rad]."""


def held_on_both_sides(friction: float, turn_rad: float) -> float:
    """The friction that holds on both sides of a rung's line, of which the surface turns by so much
    to each side.
    """
    return float(np.tan(max(np.arctan(friction) - turn_rad, 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """A round bar.

    Arguments:
        axis: along it, shape (3,).
        upright: normal of its highest line, across the axis, shape (3,).
        middle_m: a point of that line, shape (3,) [m].
        radius_m: of its surface [m].
    """

    axis: Array
    upright: Array
    middle_m: Array
    radius_m: float

    @classmethod
    def between(cls, ends_m: Array, radius_m: float) -> Rung:
        """One whose axis goes from one end to the other, shape (2, 3) [m]."""
        axis = (ends_m[1] - ends_m[0]) / np.linalg.norm(ends_m[1] - ends_m[0])
        upright = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
        upright /= np.linalg.norm(upright)
        return cls(
            axis=axis,
            upright=upright,
            middle_m=ends_m.mean(axis=0) + radius_m * upright,
            radius_m=radius_m,
        )

    @property
    def half_width_m(self) -> float:
        """Half the width of the line that a toe may be on [m]."""
        return max(_HALF_WIDTH_M, SHARE * self.radius_m)

    @property
    def turn_rad(self) -> float:
        """Angle by which the surface turns from the middle of the line to its border."""
        return float(np.arcsin(min(self.half_width_m / self.radius_m, 1.0)))

    def line(self, low_m: float, high_m: float, friction: float) -> Patch:
        """The strip that feet may stand on, from one place along the axis to another, counted from
        the middle.

        Arguments:
            friction: of the rung's surface; the strip has that of both sides.
        """
        return self._patch(
            0.0, self.half_width_m, low_m, high_m, held_on_both_sides(friction, self.turn_rad)
        )

    def sides(self, low_m: float, high_m: float, friction: float) -> tuple[Patch, ...]:
        """The upper half and some more of the surface as flat patches, which limbs keep out of."""
        patches = []
        for begin, end in pairwise(_SIDES):
            middle, half = 0.5 * (begin + end), self.radius_m * np.sin(0.5 * (end - begin))
            patches += [
                self._patch(sign * middle, half, low_m, high_m, friction) for sign in (-1.0, 1.0)
            ]
        return tuple(patches)

    def _patch(
        self, angle: float, half_m: float, low_m: float, high_m: float, friction: float
    ) -> Patch:
        """A rectangle along the axis that touches the surface from within at its long borders, at
        an angle about it.
        """
        normal = np.cos(angle) * self.upright + np.sin(angle) * cross(self.upright, self.axis)
        aside = cross(normal, self.axis)
        inner = self.radius_m if angle == 0.0 else float(np.sqrt(self.radius_m**2 - half_m**2))
        centre = self.middle_m - self.radius_m * self.upright + inner * normal
        corners = [
            centre + along * self.axis + way * half_m * aside
            for along, way in ((low_m, -1.0), (high_m, -1.0), (high_m, 1.0), (low_m, 1.0))
        ]
        return Patch(
            vertices_m=np.array(corners),
            normal=normal,
            shear_reference=shear_of(normal),
            friction=friction,
        )


_SLOPE_RAD = 0.6
"""About the friction cone of μ = .68."""
_FOOT_M = 0.02
"""Radius of a foot where no robot says otherwise [m]."""
FRICTION = 0.8
"""Coefficient of a terrain unless another is given."""
_CLEARANCE_M, ROUGHNESS_M = 0.10, 0.006
REASONS = ("steep", "covered", "inside", "rough", "edge", "small", "round", "hole")
"""Why a surface is no foothold: its slope; something else within the clearance above it; a solid
around it; off every plane; nearer to a border than the margin; narrower than a foot; beside the
line of a rung; not measured."""


_Length = Annotated[float, Within(least=0.0, most=10.0)]


@dataclass(frozen=True, kw_only=True)
class FootholdLimits:
    """Limits on what counts as a foothold.

    Arguments:
        slope_rad: largest angle between the surface's normal and the vertical [rad].
        clearance_m: free space above the surface, along its normal; None for ``_CLEARANCE_M`` times
            the robot's size [m].
        margin_m: distance of every foothold from the borders of its surface; None for the radius of
            the robot's foot, or ``_FOOT_M`` by its size where that is unknown [m].
        width_m: least width of the rest; None likewise [m].
        roughness_m: largest rms of heights off the plane of a foothold in a map [m].
        noise_m: deviation of the heights of a map or a cloud by its sensor, allowed for beside the
            roughness; None estimates it from the heights [m].

    Raises:
        InvalidInput: for a value out of range.
    Source:
        None: what a foot needs.

    Example:
        >>> from stancekit import FootholdLimits
        >>> FootholdLimits(slope_rad=0.4).for_foot(0.03).margin_m
        0.03
    """

    slope_rad: Annotated[float, Within(least=0.0, most=np.pi)] = _SLOPE_RAD
    clearance_m: _Length | None = None
    margin_m: _Length | None = None
    width_m: _Length | None = None
    roughness_m: Annotated[float, Within(above=0.0, most=1.0)] = ROUGHNESS_M
    noise_m: _Length | None = None

    def __post_init__(self) -> None:
        check_limits(self)

    def for_foot(self, radius_m: float, size: float = 1.0) -> FootholdLimits:
        """These limits with every None filled in for a foot of this radius, 0 if unknown, and a
        robot of this size.
        """
        foot = radius_m or _FOOT_M * size
        usual = {"margin_m": foot, "width_m": foot, "clearance_m": _CLEARANCE_M * size}
        return replace(self, **{k: v for k, v in usual.items() if getattr(self, k) is None})

    @property
    def inset_m(self) -> float:
        """The margin, of ``_FOOT_M`` where it is None [m]."""
        return _FOOT_M if self.margin_m is None else self.margin_m

    @property
    def least_m(self) -> float:
        """The least width likewise [m]."""
        return _FOOT_M if self.width_m is None else self.width_m

    @property
    def headroom_m(self) -> float:
        """The free height above, likewise [m]."""
        return _CLEARANCE_M if self.clearance_m is None else self.clearance_m

    @property
    def rms_m(self) -> float:
        """Largest rms of measured heights off a foothold's plane, of a map whose noise is known or
        nothing [m].
        """
        return float(np.hypot(self.roughness_m, self.noise_m or 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainPatch:
    """A convex piece of a surface and how certain it is.

    Arguments:
        rms_m: of the corners (mesh) or the heights (map) off its surface's plane [m].
        samples: how many triangles or heights that is of.
        surface: number of the surface that it is a piece of.
        turn_rad: how far the surface of a rung turns from the middle of its line to the border, 0
            of what is flat: forces are held on both sides.
    """

    patch: Patch
    rms_m: float
    samples: int
    surface: int
    turn_rad: float = 0.0

    def on(self, friction: float) -> Patch:
        """The patch on a surface with this friction; a rung has less of it on both sides of its
        line.
        """
        return self.patch.with_friction(
            held_on_both_sides(friction, self.turn_rad) if self.turn_rad else friction
        )

    @property
    def found(self) -> TerrainPatch | None:
        """The part of the piece whose height is known well enough for a foot that comes down to find
        the ground there; None where there is none.
        """
        sure = self.patch.certainty
        if sure is None or self.turn_rad:
            return self
        if (places := sure.known_within(FOUND_SD_M)) is None:
            return None
        corners, (origin, normal) = self.patch.vertices_m, (self.patch.centre_m, self.patch.normal)
        left = clipped(corners[:, :2], *places)
        if not len(left):
            return None
        heights = origin[2] - (left - origin[:2]) @ normal[:2] / normal[2]
        return replace(self, patch=self.patch.with_vertices(np.column_stack([left, heights])))

    @property
    def area_m2(self) -> float:
        """Area of the piece [m²]."""
        about = self.patch.vertices_m - self.patch.vertices_m[0]
        return 0.5 * float(np.linalg.norm(cross(about, np.roll(about, -1, axis=0)).sum(axis=0)))

    @property
    def slope_rad(self) -> float:
        """Between its normal and the vertical [rad]."""
        return float(np.arccos(np.clip(self.patch.normal[2], -1.0, 1.0)))

    @property
    def height_sd_m(self) -> float | None:
        """Standard deviation of its plane's height, the largest at its corners; None where it was
        not measured [m].
        """
        sure = self.patch.certainty
        return None if sure is None else float(sure.height_sd_m(self.patch.vertices_m[:, :2]).max())

    @property
    def tilt_sd_rad(self) -> float | None:
        """Standard deviation of its plane's tilt [rad]."""
        sure = self.patch.certainty
        return None if sure is None else sure.tilt_sd_rad

    @property
    def edge_sd_m(self) -> float | None:
        """Standard deviation of the place of its surface's edges [m]."""
        sure = self.patch.certainty
        return None if sure is None else sure.edge_sd_m

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "vertices_m": self.patch.vertices_m.tolist(),
            "normal": self.patch.normal.tolist(),
            "area_m2": self.area_m2,
            "slope_rad": self.slope_rad,
            "rms_m": self.rms_m,
            "samples": self.samples,
            "surface": self.surface,
            "turn_rad": self.turn_rad,
            "height_sd_m": self.height_sd_m,
            "tilt_sd_rad": self.tilt_sd_rad,
            "edge_sd_m": self.edge_sd_m,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Footholds:
    """The footholds of a terrain, as ``stancekit.terrain`` finds them.

    Arguments:
        name: name of the terrain.
        pieces: what may be stood on; a place may be in several pieces of one surface.
        area_m2: area that they cover [m²].
        refused_m2: the area of what else there is, by reason (``REASONS``) [m²].
        surfaces: the whole terrain as patches, for bodies to keep out of and for pictures.
        limits: limits that they keep.
        noise_m: deviation of a map's or a cloud's heights, as given or as they show it; None
            of a mesh [m].
        noise_length_m: distance at which the correlation of that noise is 1/e, 0 where it is white
            [m].
        doubts: what the reader of the file mended or left out, one line each.
    Source:
        None: planar convex pieces with a margin.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.05)
        >>> len(stancekit.terrain(level).pieces)
        1
    """

    name: str
    pieces: tuple[TerrainPatch, ...]
    area_m2: float
    refused_m2: dict[str, float]
    surfaces: tuple[Patch, ...]
    limits: FootholdLimits
    noise_m: float | None = None
    noise_length_m: float = 0.0
    doubts: tuple[str, ...] = ()

    def moved(self, frame: Frame) -> Footholds:
        """The footholds moved with the world, with its shear references."""
        pieces = (replace(one, patch=one.patch.moved(frame, shear_of)) for one in self.pieces)
        surfaces = (patch.moved(frame, shear_of) for patch in self.surfaces)
        return replace(self, pieces=tuple(pieces), surfaces=tuple(surfaces))

    @property
    def extent_m(self) -> Array:
        """The least and the largest x, y and z of the terrain, shape (3, 2) [m]."""
        patches = [*self.surfaces, *(piece.patch for piece in self.pieces)]
        corners = np.concatenate([patch.vertices_m for patch in patches])
        return np.column_stack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def noise_source(self) -> str:
        """Words for the source of the noise: given, or estimated; and for its correlation."""
        estimated = self.limits.noise_m is None
        source = "estimated from the heights" if estimated else "as given"
        if not self.noise_length_m:
            return source
        alike = f"{source}, correlated over {100.0 * self.noise_length_m:.2g} cm"
        return f"{alike}, or bumps: noise_m tells" if estimated else alike

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "terrain": self.name,
            "extent_m": dict(zip("xyz", self.extent_m.tolist(), strict=True)),
            "array": "x by the first index, y by the second, the origin in the middle",
            "area_m2": self.area_m2,
            "refused_m2": self.refused_m2,
            "doubts": list(self.doubts),
            "noise_m": self.noise_m,
            "noise": None if self.noise_m is None else self.noise_source,
            "noise_length_m": None if self.noise_m is None else self.noise_length_m,
            "patches": [piece.to_json() for piece in self.pieces],
        }


_SINGLE = 0.8
"""Surfaces of a mesh by its triangles, where most triangles are alone in their planes."""


def footholds_of(
    terrain: TriangleMesh | ElevationMap,
    limits: FootholdLimits = FootholdLimits(),
    friction: float = 1.0,
    *,
    none: bool = False,
) -> Footholds:
    """The footholds of a mesh or a map.

    Raises NoPlace, with the reasons, where there is none, unless ``none`` says that there may
    be none.
    """
    from .facets import shapely_module
    from .triangle_mesh import TriangleMesh

    broken = shapely_module().errors.ShapelyError
    try:
        if isinstance(terrain, TriangleMesh):
            from .mesh_footholds import mesh_footholds

            footholds = mesh_footholds(terrain, limits, friction)
        else:
            from .map_footholds import map_footholds

            footholds = map_footholds(terrain, limits, friction)
    except broken as error:  # outlines that cross themselves within the last digits
        raise InvalidInput(
            f"{terrain.name}: expected surfaces with outlines, got some that cross themselves; "
            "another spacing_m or "
            f"offset_m may help: {' '.join(str(error).split()):.100}"
        ) from None
    if not footholds.pieces and not none:
        refused = ", ".join(
            f"{area:.3g} m² {name}" for name, area in footholds.refused_m2.items() if area > 0.0
        )
        hint = ""
        if footholds.refused_m2["edge"] + footholds.refused_m2["small"] > 0.0:
            hint = f"; no surface has room for a foot that is {2e3 * limits.inset_m:.3g} mm wide (margin_m)"
            if isinstance(terrain, TriangleMesh) and len(footholds.surfaces) > _SINGLE * len(
                terrain.triangles
            ):
                hint = "; triangles of a scan that lean by its noise have no planes: make it a map"
        raise NoPlace(f"{terrain.name}: expected footholds, got none: {refused or 'no area'}{hint}")
    return footholds


def read_footholds(
    path: str | Path,
    options: ImportOptions = ImportOptions(),
    limits: FootholdLimits = FootholdLimits(),
    friction: float = 1.0,
) -> Footholds:
    """The footholds of a terrain's file.

    Raises InvalidInput for a file of another kind, and one without footholds.
    """
    from .terrain_file import (
        read_terrain,
    )  # scipy and trimesh are no part of a course without a file
    from .triangle_mesh import TriangleMesh

    with doubts() as heard:
        terrain = read_terrain(path, options)
        if isinstance(terrain, TriangleMesh):
            terrain.check_size()
        found = footholds_of(terrain, limits, friction)
    return replace(found, doubts=tuple(heard))
