"""Distributions of posture problems (paper E §IV-A): what terrains look like to limbs about to stand on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from stancekit.planners.arrays import Array, cross
from stancekit.planners.outcome import InvalidInput
from stancekit.planners.scene import Contact, Limb, Patch, PostureProblem, Robot, hexapod

THREE_LEGS = ("RF", "RR", "LM")
FIVE_LEGS = ("RF", "RM", "RR", "LF", "LR")
MAX_TILT_RAD = np.deg2rad(30.0)
CIRCUMRADIUS_M = (0.03, 0.08)
COM_RADIUS_M = 0.08


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
        contacts = tuple(self._contact(limb, rng) for limb in self.robot.select(self.legs))
        return PostureProblem(
            contacts=contacts, mass_kg=self.robot.mass_kg, com_nominal_m=np.zeros(3), com_radius_m=COM_RADIUS_M
        )

    def _contact(self, limb: Limb, rng: np.random.Generator) -> Contact:
        centre, nominal, shear = _ground(limb, rng) if self.terrain == "ground" else _wall(limb, rng)
        normal = _lean(nominal, rng.uniform(0.0, MAX_TILT_RAD), rng.uniform(0.0, 2.0 * np.pi))
        vertices = centre + _triangle(normal, rng)
        patch = Patch(vertices_m=vertices, normal=normal, shear_reference=shear, friction=rng.uniform(*self.friction))
        return Contact(
            leg=limb.name,
            shoulder_m=limb.shoulder_m,
            reach_m=limb.reach_m,
            patch=patch,
            force_min=np.array([0.0, -1.0, -1.0]),
            force_max=np.ones(3),
        )


def _ground(limb: Limb, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Centre, nominal normal and shear reference of a patch on the ground beside and below the shoulder."""
    outward = limb.shoulder_m / np.linalg.norm(limb.shoulder_m)
    centre = limb.shoulder_m + 0.15 * outward + np.array([0.0, 0.0, -0.20])
    centre = centre + rng.uniform([-0.20, -0.20, -0.10], [0.20, 0.20, 0.10])
    return centre, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def _wall(limb: Limb, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Centre, nominal normal and shear reference of a patch on the wall at the limb's side."""
    side = 1.0 if limb.shoulder_m[1] >= 0.0 else -1.0
    offset = rng.uniform([-0.15, -0.06, -0.15], [0.15, 0.06, 0.15])
    centre = np.array([limb.shoulder_m[0] + offset[0], side * (0.40 + offset[1]), limb.shoulder_m[2] + offset[2]])
    return centre, np.array([0.0, -side, 0.0]), np.array([0.0, 0.0, 1.0])


def _lean(axis: Array, angle_rad: float, azimuth_rad: float) -> Array:
    """The unit vector at this angle from ``axis``, leaning towards this azimuth."""
    first, second = _plane(axis)
    sideways = np.cos(azimuth_rad) * first + np.sin(azimuth_rad) * second
    leant: Array = np.cos(angle_rad) * axis + np.sin(angle_rad) * sideways
    return leant / np.linalg.norm(leant)


def _triangle(normal: Array, rng: np.random.Generator) -> Array:
    """An equilateral triangle about the origin, turned at random in its plane, shape (3, 3) [m]."""
    radius_m = rng.uniform(*CIRCUMRADIUS_M)
    angles = rng.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi / 3.0 * np.arange(3)
    first, second = _plane(normal)
    return np.asarray(radius_m * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)))


def _plane(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with ``normal``."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = cross(normal, helper)
    first = first / np.sqrt(first @ first)
    return first, cross(normal, first)


DISTRIBUTIONS: Mapping[str, PostureDistribution] = MappingProxyType(
    {
        "ground-3": PostureDistribution(name="ground-3", terrain="ground", legs=THREE_LEGS, friction=(0.1, 0.8)),
        "wall-3": PostureDistribution(name="wall-3", terrain="wall", legs=THREE_LEGS, friction=(0.1, 1.2)),
        "wall-5": PostureDistribution(name="wall-5", terrain="wall", legs=FIVE_LEGS, friction=(0.1, 1.2)),
    }
)
"""Paper E's three problem classes by name."""


def distribution(name: str) -> PostureDistribution:
    """Return a distribution by name. Raises InvalidInput that lists the names there are."""
    if name not in DISTRIBUTIONS:
        raise InvalidInput(f"distribution: expected one of {', '.join(DISTRIBUTIONS)}, got {name!r}")
    return DISTRIBUTIONS[name]
