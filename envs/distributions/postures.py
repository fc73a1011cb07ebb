"""Distributions of posture problems (paper E §IV-A): what terrains look like to limbs about to stand on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, cross
from stancekit.planners.files.documents import read_yaml
from stancekit.planners.files.refusals import validated
from stancekit.planners.plugins import Registry, made_or_class
from stancekit.planners.problem import Contact, PostureBatch, PostureProblem
from stancekit.planners.problem.posture import MAX_TILT_RAD, THREE_LEGS
from stancekit.planners.robot import Limb, Robot, hexapod
from stancekit.planners.terrain import Patch

FIVE_LEGS = ("RF", "RM", "RR", "LF", "LR")
CIRCUMRADIUS_M = (0.03, 0.08)
COM_RADIUS_M = 0.08


class Distribution(Protocol):
    """Anything that draws posture problems, G(θ)."""

    @property
    def name(self) -> str:
        """By which it is asked for."""
        ...

    @property
    def terrain(self) -> str:
        """What the mode of a course is called over such terrain."""
        ...

    @property
    def legs(self) -> tuple[str, ...]:
        """The limbs of every problem."""
        ...

    def sample(self, rng: np.random.Generator) -> PostureProblem:
        """Draw one posture problem."""
        ...

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many: those that as many calls of ``sample`` draw."""
        ...


@dataclass(frozen=True, kw_only=True)
class PostureDistribution:
    """G(θ) of paper E: one random triangle a limb, on the ground or on two facing walls.

    Each normal leans by up to 30° from the nominal one in a random direction. ``sample`` draws one problem.
    """

    name: str
    terrain: Literal["ground", "wall"]
    legs: tuple[str, ...]
    friction: tuple[float, float]
    robot: Robot = field(default_factory=hexapod)

    def sample(self, rng: np.random.Generator) -> PostureProblem:
        """Draw one posture problem."""
        return self.batch(rng, 1).problem(0)

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many problems: bit for bit those that as many calls of ``sample`` draw."""
        centre, nominal, low, high = self._places
        drawn = low + (high - low) * rng.random((count, *low.shape))
        offset, (lean, towards, radius, turn, friction) = drawn[..., :3], np.moveaxis(drawn[..., 3:], -1, 0)
        normals = _lean(nominal, lean, towards)
        triangles = _triangles(normals, radius, turn)
        return PostureBatch(
            like=self._plain, vertices_m=(centre + offset)[:, :, None] + triangles, normals=normals, friction=friction
        )

    @cached_property
    def _places(self) -> tuple[Array, Array, Array, Array]:
        """Of each limb: nominal centre and normal, shape (N, 3) each, and the bounds of what is drawn, shape (N, 8)."""
        limbs, placed = self.robot.select(self.legs), _ground if self.terrain == "ground" else _wall
        centre, nominal, width = zip(*(placed(limb) for limb in limbs), strict=True)
        of_all = np.array([(0.0, MAX_TILT_RAD), (0.0, 2.0 * np.pi), CIRCUMRADIUS_M, (0.0, 2.0 * np.pi), self.friction])
        low, high = (np.tile(of_all[:, k], (len(limbs), 1)) for k in (0, 1))
        low, high = np.hstack([-np.array(width), low]), np.hstack([width, high])
        return np.array(centre), np.array(nominal), low, high

    @cached_property
    def _plain(self) -> PostureProblem:
        """The problem with every patch in its nominal place."""
        centre, nominal, low, _ = self._places
        triangles = centre[:, None] + _triangles(nominal, low[:, 5], low[:, 6])
        shear = np.array([1.0, 0.0, 0.0] if self.terrain == "ground" else [0.0, 0.0, 1.0])
        contacts = tuple(
            Contact(
                leg=limb.name,
                shoulder_m=limb.shoulder_m,
                reach_m=limb.reach_m,
                patch=Patch(vertices_m=triangle, normal=normal, shear_reference=shear, friction=self.friction[0]),
                force_min=np.array([0.0, -1.0, -1.0]),
                force_max=np.ones(3),
            )
            for limb, triangle, normal in zip(self.robot.select(self.legs), triangles, nominal, strict=True)
        )
        return PostureProblem(
            contacts=contacts, mass_kg=self.robot.mass_kg, com_nominal_m=np.zeros(3), com_radius_m=COM_RADIUS_M
        )


def _ground(limb: Limb) -> tuple[Array, Array, Array]:
    """Centre and normal of a patch on the ground beside and below the shoulder, and how far off it may be [m]."""
    outward = limb.shoulder_m / np.linalg.norm(limb.shoulder_m)
    centre = limb.shoulder_m + 0.15 * outward + np.array([0.0, 0.0, -0.20])
    return centre, np.array([0.0, 0.0, 1.0]), np.array([0.20, 0.20, 0.10])


def _wall(limb: Limb) -> tuple[Array, Array, Array]:
    """Centre and normal of a patch on the wall at the limb's side, and how far off it may be [m], outwards positive."""
    side = 1.0 if limb.shoulder_m[1] >= 0.0 else -1.0
    centre = np.array([limb.shoulder_m[0], side * 0.40, limb.shoulder_m[2]])
    return centre, np.array([0.0, -side, 0.0]), np.array([0.15, side * 0.06, 0.15])


def _lean(axis: Array, angle_rad: Array, azimuth_rad: Array) -> Array:
    """Unit vectors at these angles from axes of shape (..., 3), leaning towards these azimuths."""
    first, second = _plane(axis)
    angle, azimuth = angle_rad[..., None], azimuth_rad[..., None]
    sideways = np.cos(azimuth) * first + np.sin(azimuth) * second
    return _unit(np.cos(angle) * axis + np.sin(angle) * sideways)


def _triangles(normals: Array, radius_m: Array, turn_rad: Array) -> Array:
    """Equilateral triangles about the origin in the planes of these normals, shape (..., 3, 3) [m]."""
    angles = (turn_rad[..., None] + 2.0 * np.pi / 3.0 * np.arange(3))[..., None]
    first, second = (axis[..., None, :] for axis in _plane(normals))
    return np.asarray(radius_m[..., None, None] * (np.cos(angles) * first + np.sin(angles) * second))


def _plane(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with each normal, shape (..., 3)."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=-1)]
    first = _unit(cross(normals, helper))
    return first, cross(normals, first)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.vecdot(vectors, vectors))[..., None])


GROUND_3 = PostureDistribution(name="ground-3", terrain="ground", legs=THREE_LEGS, friction=(0.1, 0.8))
WALL_3 = PostureDistribution(name="wall-3", terrain="wall", legs=THREE_LEGS, friction=(0.1, 1.2))
WALL_5 = PostureDistribution(name="wall-5", terrain="wall", legs=FIVE_LEGS, friction=(0.1, 1.2))
DISTRIBUTIONS: Mapping[str, PostureDistribution] = MappingProxyType({d.name: d for d in (GROUND_3, WALL_3, WALL_5)})
"""Paper E's three problem classes by name."""
REGISTRY: Registry[Any] = Registry(
    "distribution", "stancekit.distributions",
    {name: f"{__name__}:{name.upper().replace('-', '_')}" for name in DISTRIBUTIONS},
    expected="something with sample(rng), or a class of it that is made without arguments",
    accepts=lambda it: made_or_class(it, "sample"),
)  # fmt: skip
"""All distributions."""


class OwnDistribution:
    """A distribution from elsewhere: something with ``sample(rng)``, or its class, which is made without arguments.

    name: by which it was asked for. Its ``terrain`` counts where it has one. To other processes it goes
    by its name, or as it is where no registry has it.
    """

    def __init__(self, thing: Any, name: str) -> None:
        self._thing, self.name = thing() if isinstance(thing, type) else thing, name
        self.terrain = str(getattr(self._thing, "terrain", name))
        self.legs = self.sample(np.random.default_rng(0)).legs

    def sample(self, rng: np.random.Generator) -> PostureProblem:
        """Draw one posture problem. Raises InvalidInput where something else comes."""
        found = self._thing.sample(rng)
        if not isinstance(found, PostureProblem):
            raise InvalidInput(f"distribution {self.name}: expected a PostureProblem, got a {type(found).__name__}")
        return found

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many. Raises InvalidInput where they differ in more than their patches."""
        try:
            return PostureBatch.stacked([self.sample(rng) for _ in range(count)])
        except InvalidInput as error:
            raise InvalidInput(f"distribution {self.name}: {error}") from None

    def __reduce__(self) -> tuple[Any, ...]:
        path, colon, attribute = self.name.rpartition(":")
        if self.name not in REGISTRY.names() and not path.endswith(".py"):
            return OwnDistribution, (self._thing, self.name)
        return _again, (f"{Path(path).resolve()}:{attribute}" if colon else self.name, self.name)


def _again(reference: str, name: str) -> OwnDistribution:
    return OwnDistribution(REGISTRY.get(reference), name)


class _Yaml(BaseModel):
    """A distribution's file: a ``PostureDistribution`` of the default robot."""

    model_config = ConfigDict(extra="forbid", strict=True)
    terrain: Literal["ground", "wall"]
    legs: list[str] = Field(min_length=1)
    friction: tuple[float, float] = Field(strict=False)


def distribution(name: str) -> Distribution:
    """A distribution by name, from "FILE.py:NAME", or from a YAML file with terrain, legs and friction.

    Raises InvalidInput that lists the names there are.
    """
    if not isinstance(name, str):
        known = ", ".join(REGISTRY.names())
        raise InvalidInput(f"distribution: expected one of {known}, or FILE.py:NAME, got {name!r}")
    if name in DISTRIBUTIONS:
        return DISTRIBUTIONS[name]
    if name.endswith((".yaml", ".yml")):
        return _from_yaml(name)
    return OwnDistribution(REGISTRY.get(name), name)


def _from_yaml(path: str) -> PostureDistribution:
    try:
        raw = validated(_Yaml, read_yaml(path))
        low, high = raw.friction
        if not 0.0 <= low <= high < float("inf"):
            raise InvalidInput(f"friction: expected 0 ≤ low ≤ high, got {low:g} and {high:g}")
        hexapod().select(raw.legs)
        return PostureDistribution(name=path, terrain=raw.terrain, legs=tuple(raw.legs), friction=raw.friction)
    except InvalidInput as error:
        raise InvalidInput(str(error) if str(error).startswith(path) else f"{path}: {error}") from None
