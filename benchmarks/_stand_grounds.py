"""The grounds of benchmarks/stands: meshes by kind, height and draw, written as OBJ files; numpy
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Faces of a hexahedron whose corners count x, y, z as binary digits, outward."""
DEEP = 0.3
"""How far boxes go down, in units of the robot's height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """A ground that was drawn for a robot.

    Attributes:
        solids: corners of hexahedra, shape (B, 8, 3) [m].
        start_m: where the robot begins, shape (2,) [m].
        goal_m: where its centre of mass is to end, shape (2,) [m].
        friction: coefficient of friction of all of it.
    """

    solids: Array
    start_m: Array
    goal_m: Array
    friction: float

    def write(self, path: Path) -> None:
        """Write the mesh as an OBJ file of triangles."""
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in self.solids.reshape(-1, 3)]
        for first in range(1, 8 * len(self.solids), 8):
            for a, b, c, d in BOX:
                lines += [
                    f"f {first + a} {first + b} {first + c}",
                    f"f {first + a} {first + c} {first + d}",
                ]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def ground(
    kind: str, numbers: Mapping[str, float], height_m: float, full_m: float, seed: list[int]
) -> Ground:
    """Draw a ground.

    Arguments:
        kind: what it is called in the list; the first word names its generator.
        numbers: the list's numbers of the kind.
        height_m: the robot's height, the unit of lengths [m].
        full_m: the height below which rises are less in proportion [m].
        seed: numbers that the draw begins with, the same for every robot.
    """
    rng = np.random.default_rng(seed)
    friction, aside = rng.uniform(0.5, 0.75), rng.uniform(-0.15, 0.15)
    make, ahead = GROUNDS[kind.split("-")[0]]
    solids = np.array(list(make(numbers, rng, min(1.0, height_m / full_m) / height_m)))
    return Ground(
        solids=solids * height_m,
        start_m=np.array([0.2, 0.0]) * height_m,
        goal_m=np.array([ahead, aside]) * height_m,
        friction=round(float(friction), 3),
    )


def _stairs(
    numbers: Mapping[str, float], rng: np.random.Generator, scale: float
) -> Iterator[Array]:
    """Three steps up; scale: what a metre of a rise is in units of the height."""
    first, tread, rise = rng.uniform(0.8, 1.0), rng.uniform(0.85, 1.05), numbers["rise_m"] * scale
    yield _box(-7.0, first, 0.0)
    for k in range(3):
        left = first + k * tread
        yield _box(left, left + tread if k < 2 else 12.0, (k + 1) * rise)


def _gap(numbers: Mapping[str, float], rng: np.random.Generator, _: float) -> Iterator[Array]:
    """Level ground, nothing, level ground."""
    edge = rng.uniform(0.85, 1.05)
    yield _box(-7.0, edge, 0.0)
    yield _box(edge + numbers["width"], 12.0, 0.0)


def _slope(numbers: Mapping[str, float], rng: np.random.Generator, _: float) -> Iterator[Array]:
    """Level ground, then up."""
    foot, angle = rng.uniform(0.7, 0.9), np.radians(numbers["angle_deg"])
    yield _box(-7.0, foot, 0.0)
    solid = _box(foot, foot + 6.0, 0.0)
    solid[:, 2] += np.tan(angle) * (solid[:, 0] - foot)
    yield solid


def _slabs(numbers: Mapping[str, float], rng: np.random.Generator, _: float) -> Iterator[Array]:
    """Square stepping stones, each at a height and a tilt of its own."""
    half, spacing = numbers["side"] / 2.0, numbers["spacing"]
    for x in np.arange(-2.2, 4.2, spacing):
        for y in np.arange(-1.5, 1.5, spacing):
            solid = _box(x - half, x + half, 0.0, y - half, y + half)
            tilt = rng.uniform(-numbers["tilt_rad"], numbers["tilt_rad"], 2)
            solid[:, 2] += rng.uniform(-1.0, 1.0) * numbers["rise"]
            solid[:, 2] += (solid[:, :2] - [x, y]) @ tilt
            yield solid


def _blocks(numbers: Mapping[str, float], rng: np.random.Generator, _: float) -> Iterator[Array]:
    """A floor, and from one height ahead blocks on it in rows, turned a little, of heights of their
    own.
    """
    half = numbers["side"] / 2.0
    yield _box(-7.0, 12.0, 0.0)
    for x in np.arange(1.0 + half, 4.0, 2.4 * half):
        for y in np.arange(-2.0, 2.0, 2.4 * half):
            turn, top = rng.uniform(-0.3, 0.3), numbers["rise"] * rng.uniform(0.2, 1.0)
            cos, sin = np.cos(turn), np.sin(turn)
            solid = _box(-half, half, top, -half, half)
            solid[:, :2] = solid[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
            yield solid


def _box(left: float, right: float, top: float, low: float = -3.0, high: float = 3.0) -> Array:
    """Corners of a box that goes down to the bottom, shape (8, 3)."""
    return np.array([[x, y, z] for x in (left, right) for y in (low, high) for z in (-DEEP, top)])


Generator = Callable[[Mapping[str, float], np.random.Generator, float], Iterator[Array]]
GROUNDS: dict[str, tuple[Generator, float]] = {
    "stairs": (_stairs, 2.6),
    "gap": (_gap, 2.4),
    "slope": (_slope, 2.4),
    "slabs": (_slabs, 1.8),
    "blocks": (_blocks, 2.4),
}
"""By the first word of a kind: what draws it, and how far ahead the goal is, in heights."""
