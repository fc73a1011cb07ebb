"""Scenes cut from a terrain: a body somewhere over it, heading anywhere, and its feet on patches of
the terrain.

The terrain is a mesh, whose facets are flat, or a grid, which is flat enough for a patch where it
keeps to its tangent plane. Places to stand are looked for once: points of a lattice, each with the
normal there and the circle about it that is free. A scene takes one of them for the ground under
the body, a heading, and for every leg one that is as near to its nominal toe as a patch of
``ground-k`` would be drawn; the patch is a triangle in the free circle. Scenes are in the
body's axes, heading forward.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import read_bytes
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.robot import Robot
from stancekit.planners.robot.robot_model import IDENTITY_DIGITS
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.footholds import FootholdLimits, Footholds, footholds_of
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.import_options import doubts
from stancekit.planners.terrain.mesh_formats.numbers import MOST_BYTES
from stancekit.planners.terrain.polygon import STEEP, half_planes
from stancekit.planners.terrain.reference import named_surface, names_ground
from stancekit.planners.terrain.terrain_file import read_heights, read_terrain
from stancekit.planners.terrain.triangle_mesh import TriangleMesh

from .postures import FORWARD, NominalStance, plain_problem, triangle

_SPACING = 0.5
"""Spacing of the lattice, in radii of the smallest patch."""
SMALLER = 0.4
"""The smallest patch of a terrain, in circumradii of the smallest that is drawn."""
_MOST_PLACES = 200_000
_FLAT_M = 0.003
"""Distance of a grid from the tangent plane within a patch [m]."""
_AROUND = np.stack([np.cos(np.arange(8) * np.pi / 4.0), np.sin(np.arange(8) * np.pi / 4.0)], axis=1)
_TRIES = 20_000
"""Bodies until one has a place for every leg."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places where a foot may stand: points, shape (K, 3) [m], normals, (K, 3), and free radii
    about them, (K,) [m].
    """

    points_m: Array
    normals: Array
    free_m: Array

    @classmethod
    def of(cls, path: str | Path, least_m: float) -> Places:
        """Places of a terrain's file or name that have room for a circle of this radius.

        Raises InvalidInput for a file that is no terrain, and for one without any such place.
        """
        spacing, named = _SPACING * least_m, names_ground(str(path))
        terrain = named_surface(str(path)) if named else read_terrain(path)
        if isinstance(terrain, TriangleMesh):
            terrain.check_size()
            limits = FootholdLimits(
                slope_rad=float(np.arccos(STEEP)), margin_m=0.0, width_m=2.0 * least_m
            )
            pieces = footholds_of(terrain, limits, friction=0.0).pieces
            parts = [_of_patch(piece.patch, least_m, spacing) for piece in pieces]
        else:
            parts = [_of_grid(terrain.field() if named else read_heights(path), least_m, spacing)]
        return cls._of(parts, f"{path}: expected a terrain", least_m, float(np.arccos(STEEP)))

    @classmethod
    def of_footholds(cls, footholds: Footholds, least_m: float) -> Places:
        """Places of footholds that have room for a circle of this radius; rungs have none.

        Raises InvalidInput where there is no such place.
        """
        flat = [piece.patch for piece in footholds.pieces if not piece.turn_rad]
        parts = [_of_patch(patch, least_m, _SPACING * least_m) for patch in flat]
        limits = footholds.limits
        return cls._of(parts, f"{footholds.name}: expected a terrain", least_m, limits.slope_rad)

    @classmethod
    def _of(
        cls, parts: list[tuple[Array, Array, Array]], what: str, least: float, slope: float
    ) -> Places:
        result = (
            [np.concatenate(part) for part in zip(*parts, strict=True)] if parts else [np.zeros(0)]
        )
        if not len(result[0]):
            raise InvalidInput(
                f"{what} with footholds, flat places {2e3 * least:.0f} mm wide and less steep "
                f"than {np.degrees(slope):.0f}°, found none"
            )
        return cls(*result)


def _of_patch(patch: Patch, least_m: float, spacing_m: float) -> tuple[Array, Array, Array]:
    """Points of a lattice over a facet, and its middle."""
    axes, origin = patch.frame[:, 1:], patch.centre_m
    flat = (patch.vertices_m - origin) @ axes
    normals, offsets = half_planes(flat)
    points = np.vstack([_lattice(flat.min(axis=0), flat.max(axis=0), spacing_m), [[0.0, 0.0]]])
    free = (offsets - points @ normals.T).min(axis=1)
    roomy = free >= least_m
    points = origin + points[roomy] @ axes.T
    return points, np.tile(patch.normal, (len(points), 1)), free[roomy]


def _of_grid(field_: HeightField, least_m: float, spacing_m: float) -> tuple[Array, Array, Array]:
    """Points of a lattice over a height field; free as far as it keeps to its tangent plane."""
    low, high = np.array(field_.domain_m).T
    xy = _lattice(low, high, spacing_m)
    heights, slopes = field_.height_and_gradient(xy)
    free = np.zeros(len(xy))
    flat = np.ones(len(xy), dtype=np.bool_)
    for radius in least_m * np.array([1.0, 2.0, 4.0, 8.0]):
        ring = xy[:, None] + radius * _AROUND
        off = (
            field_.height(np.clip(ring, low, high)) - heights[:, None] - radius * slopes @ _AROUND.T
        )
        flat &= np.all((ring >= low) & (ring <= high), axis=(1, 2)) & (
            np.abs(off).max(axis=1) <= _FLAT_M
        )
        free[flat] = radius
    normals = np.column_stack([-slopes, np.ones(len(xy))])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    roomy = (free >= least_m) & (normals[:, 2] >= STEEP)
    return np.column_stack([xy, heights])[roomy], normals[roomy], free[roomy]


def _lattice(low: Array, high: Array, spacing_m: float) -> Array:
    """Points a spacing apart, or farther where there would be too many, shape (K, 2) [m]."""
    spacing = max(spacing_m, float(np.sqrt(np.prod(high - low) / _MOST_PLACES)))
    lines = (np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)


def identity_of(path: str | Path) -> str:
    """A terrain's name and the beginning of its file's digest; a ground's name with dashes, which
    says all of it.

    Raises InvalidInput for a file that cannot be read.
    """
    name = str(path)
    file, separator, rest = name.partition(".py:")
    if names_ground(name) and not separator:
        return name.replace(":", "-")
    digest = hashlib.sha256(read_bytes(f"{file}.py" if separator else path, MOST_BYTES)).hexdigest()
    text = f"{Path(file).stem}-{rest.replace(':', '-')}" if separator else Path(path).stem
    return f"{text}-{digest[:IDENTITY_DIGITS]}"


@dataclass(frozen=True, kw_only=True, eq=False)
class CutDistribution:
    """Scenes on these legs of a robot, cut from a terrain.

    Arguments:
        stance: nominal stance about which scenes are drawn.
        friction: lowest and highest friction, drawn uniformly.
        doubts: what the terrain's reader mended or left out, one line each.
    """

    name: str
    legs: tuple[str, ...]
    friction: tuple[float, float]
    robot: Robot
    stance: NominalStance
    places: Places
    terrain: str = "ground"
    doubts: tuple[str, ...] = ()

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one posture problem.

        Raises InvalidInput where the terrain has no place for all legs.
        """
        return self.batch(rng, 1).problem(0)

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many problems: bit for bit those that as many calls of ``sample`` draw."""
        vertices, normals, friction = zip(*(self._drawn(rng) for _ in range(count)), strict=True)
        return PostureBatch(
            like=self._plain,
            vertices_m=np.array(vertices),
            normals=np.array(normals),
            friction=np.array(friction),
        )

    def skip(self, rng: np.random.Generator, count: int) -> None:
        """Leave the generator as ``batch`` of so many leaves it."""
        for _ in range(count):
            self._drawn(rng)

    def _drawn(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Vertices, normals and friction of one scene's patches in the body's axes."""
        for _ in range(_TRIES):
            under, turn = (
                self.places.points_m[rng.integers(len(self.places.points_m))],
                rng.uniform(0.0, 2.0 * np.pi),
            )
            axes = np.array(
                [
                    [np.cos(turn), -np.sin(turn), 0.0],
                    [np.sin(turn), np.cos(turn), 0.0],
                    [0.0, 0.0, 1.0],
                ]
            )
            body = under - [0.0, 0.0, float(self.stance.centre_m[:, 2].mean())]
            chosen = self._feet(body, axes, rng)
            if chosen is not None:
                break
        else:
            raise InvalidInput(
                f"{self.name}: expected footholds for {', '.join(self.legs)} about some body over "
                "the terrain, "
                f"found none in {_TRIES} tries"
            )
        low, high = self.stance.circumradius_m
        smallest, largest = SMALLER * low, np.minimum(high, self.places.free_m[chosen])
        radius = smallest + (largest - smallest) * rng.random(len(chosen))
        normals = self.places.normals[chosen] @ axes
        centres = (self.places.points_m[chosen] - body) @ axes
        corners = centres[:, None] + triangle(
            normals, radius, 2.0 * np.pi * rng.random(len(chosen))
        )
        return corners, normals, rng.uniform(*self.friction, len(chosen))

    def _feet(self, body: Array, axes: Array, rng: np.random.Generator) -> list[int] | None:
        """A place for every leg within its room, by number; None where one leg has none."""
        feet = []
        toes = body + self.stance.centre_m @ axes.T
        rooms = np.abs(self.stance.room_m)
        around = self._tree.query_ball_point(
            toes, np.linalg.norm(rooms, axis=1), return_sorted=True
        )
        for toe, room, numbers in zip(toes, rooms, around, strict=True):
            near = np.array(numbers, dtype=np.intp)
            within = near[np.all(np.abs((self.places.points_m[near] - toe) @ axes) <= room, axis=1)]
            if not len(within):
                return None
            feet.append(int(within[rng.integers(len(within))]))
        return feet

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.places.points_m)

    @cached_property
    def _plain(self) -> Problem:
        return plain_problem(self.robot, self.legs, self.stance, shear=FORWARD)


def cut(
    path: str | Path,
    name: str,
    robot: Robot,
    legs: Sequence[str],
    stance: NominalStance,
    friction: tuple[float, float],
) -> CutDistribution:
    """Scenes of a terrain's file or name.

    Raises InvalidInput for one that is none, or has no footholds.
    """
    with doubts() as heard:
        places = Places.of(path, SMALLER * stance.circumradius_m[0])
    return CutDistribution(
        name=f"{name}-on-{identity_of(path)}",
        legs=tuple(legs),
        friction=friction,
        robot=robot,
        stance=stance,
        places=places,
        doubts=tuple(heard),
    )
