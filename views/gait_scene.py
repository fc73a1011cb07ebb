"""A trajectory as something to look at: what of the terrain is shown, from where, and where the robot's parts are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from matplotlib.colors import to_rgb as rgb

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.gait.trajectory import Trajectory

from .painter import UP, Painter, unit

Warp = Callable[[Array], Array]
"""Points of the warped space, shape (N, 3) [m], to the world, shape (N, 3) [m]."""
STEEL, RIM, SHELL = "#5b6b7b", "#2b3642", "#eef2f6"
GRID, EARTH = "#4d5d66", "#cfc8ba"
LOW, HIGH = np.array(rgb("#9fb4b0")), np.array(rgb("#ecdcc0"))
CELLS = 84
"""Facets of the terrain along its longer side."""
GRID_M = 0.25
"""Distance of the lines drawn on the terrain, in the map's own metres."""
BONE = 0.045
"""Thickness of the legs, in stand heights."""
WEIGHT_ARROW = 1.1
"""Length of an arrow as heavy as the robot, in stand heights."""


@dataclass(frozen=True, eq=False)
class MotionScene:
    """A trajectory as something to look at: where it runs and what is shown of it."""

    trajectory: Trajectory

    @property
    def size_m(self) -> float:
        """Height at which the robot stands: its size."""
        return self.trajectory.robot.stand_height_m

    @cached_property
    def bounds(self) -> Array:
        """Corners of the terrain that is shown, shape (2, 2) [m]: the feet's way with room around, inside the grid."""
        feet = self.trajectory.feet_m[..., :2].reshape(-1, 2)
        room = 1.6 * self.size_m
        low, high = feet.min(axis=0) - room, feet.max(axis=0) + room
        least, most = np.array(self.trajectory.terrain.domain_m).T
        inside = np.array([np.clip(low, least, most), np.clip(high, least, most)])
        return inside if float(np.min(inside[1] - inside[0])) > 0.5 * room else np.array([low, high])

    @cached_property
    def moments(self) -> list[int]:
        """Samples at which the robot is shown: the ends, and between them where it has gone on by its own length."""
        torso = self.trajectory.torso_m
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(torso, axis=0), axis=1))])
        length = 2.6 * float(self.trajectory.robot.trunk_half_m[0])
        count = int(np.clip(round(way[-1] / length), 1, 8))
        return sorted({int(np.searchsorted(way, share * way[-1])) for share in np.linspace(0.0, 1.0, count + 1)})

    def way(self) -> Iterator[tuple[Array, Array]]:
        """Pieces of the torso's way by their ends, shape (3,) each [m], but those inside a trunk that is shown."""
        trajectory = self.trajectory
        half = trajectory.robot.trunk_half_m
        for a, b in pairwise(trajectory.torso_m[:: max(1, trajectory.samples // 150)]):
            middles = 0.5 * (a + b) - trajectory.torso_m[self.moments]
            local = np.einsum("kji,kj->ki", trajectory.rotation[self.moments], middles)
            if not np.any(np.all(np.abs(local) < half, axis=1)):
                yield a, b

    @cached_property
    def surface(self) -> tuple[Array, Array, Array, Array]:
        """Grid lines x, shape (n,), and y, shape (m,), with heights (n, m) [m], and unit normals of the cells."""
        low, high = self.bounds
        step = float(np.max(high - low)) / CELLS
        x, y = (np.linspace(a, b, max(2, round((b - a) / step) + 1)) for a, b in zip(low, high, strict=True))
        heights = self.trajectory.terrain.height(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
        middles = np.stack(np.meshgrid(0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]), indexing="ij"), axis=-1)
        return x, y, heights, self.trajectory.terrain.normal(middles)

    @cached_property
    def floor_m(self) -> float:
        """Where the block under the surface ends."""
        return float(self.surface[2].min()) - 0.25 * self.size_m

    def colours(self, heights: Array) -> Array:
        """Colours of the terrain at these heights, shape (…) [m] → (…, 3)."""
        low, high = float(self.surface[2].min()), float(self.surface[2].max())
        share = (heights - low) / max(high - low, 0.5 * self.size_m)
        return np.asarray(LOW + np.clip(share, 0.0, 1.0)[..., None] * (HIGH - LOW))

    def sides(self) -> list[tuple[Array, Array]]:
        """Borders of the surface, shape (n, 3) [m], each with the direction out of the block."""
        x, y, heights, _ = self.surface
        return [
            (np.column_stack([x, np.full_like(x, y[0]), heights[:, 0]]), np.array([0.0, -1.0, 0.0])),
            (np.column_stack([x, np.full_like(x, y[-1]), heights[:, -1]]), np.array([0.0, 1.0, 0.0])),
            (np.column_stack([np.full_like(y, x[0]), y, heights[0]]), np.array([-1.0, 0.0, 0.0])),
            (np.column_stack([np.full_like(y, x[-1]), y, heights[-1]]), np.array([1.0, 0.0, 0.0])),
        ]

    def lines(self, warp: Warp | None) -> Iterator[Array]:
        """Lines of constant x̄ and ȳ where they run over the surface, in pieces of shape (2, 3) [m]."""
        (x0, x1), (y0, y1) = self.trajectory.terrain.domain_m
        for (low, high), (begin, end), swapped in (((x0, x1), (y0, y1), False), ((y0, y1), (x0, x1), True)):
            along = np.linspace(begin, end, 1 + round(24 * (end - begin)))
            for value in GRID_M * np.arange(np.ceil(low / GRID_M), np.floor(high / GRID_M) + 1.0):
                pair = [np.full_like(along, value), along]
                flat = np.column_stack([*(pair[::-1] if swapped else pair), np.zeros_like(along)])
                yield from self._laid(flat if warp is None else warp(flat))

    def _laid(self, points: Array) -> Iterator[Array]:
        inside = np.all((points[:, :2] >= self.bounds[0]) & (points[:, :2] <= self.bounds[1]), axis=1)
        laid = np.column_stack([points[:, :2], self.trajectory.terrain.height(points[:, :2])])
        for k in np.flatnonzero(inside[1:] & inside[:-1]):
            yield laid[k : k + 2]

    def footholds(self) -> list[tuple[int, int, Array]]:
        """Sample, foot and place of every touch-down, shape (3,) [m]."""
        contact = self.trajectory.contact
        began = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=bool), contact[:-1]])
        return [(int(k), int(foot), self.trajectory.feet_m[k, foot]) for k, foot in np.argwhere(began)]

    def legs(self, sample: int) -> list[Array]:
        """Hip, knee and toe of every leg, shape (3, 3) [m]; where knees bend is a guess, for the eye."""
        torso, turn = self.trajectory.torso_m[sample], self.trajectory.rotation[sample]
        found = []
        for foot, toe in zip(self.trajectory.robot.feet, self.trajectory.feet_m[sample], strict=True):
            way = np.array([0.5 * np.sign(foot.hip_m[0]), 0.9 * np.sign(foot.hip_m[1]), 0.3])
            found.append(self._leg(torso + turn @ foot.hip_m, toe, turn @ way))
        return found

    def _leg(self, hip: Array, toe: Array, way: Array) -> Array:
        """A leg of two equal bones whose knee bends this way."""
        line = toe - hip
        length = float(np.linalg.norm(line))
        bone = max(0.7 * self.size_m, 0.505 * length)
        bend = unit(way - (way @ line) * line / max(length, 1e-9) ** 2)
        return np.array([hip, hip + 0.5 * line + np.sqrt(max(bone**2 - 0.25 * length**2, 0.0)) * bend, toe])

    @property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""
        return WEIGHT_ARROW * self.size_m / (self.trajectory.robot.mass_kg * 9.81)


def check_drawable(trajectory: Trajectory) -> MotionScene:
    """What can be drawn of a trajectory. Raises InvalidInput for under two samples, or values that are not finite."""
    if trajectory.samples < 2 or not all(
        np.isfinite(getattr(trajectory, name)).all() for name in ("torso_m", "rotation", "feet_m", "forces_n")
    ):
        raise InvalidInput("trajectory: expected two or more samples of finite numbers")
    return MotionScene(trajectory)


def view(scene: MotionScene) -> Painter:
    """From the side of the way and above, where the terrain hides the robot least."""
    x, y, heights, _ = scene.surface
    low, high = np.array([x[0], y[0], heights.min()]), np.array([x[-1], y[-1], heights.max() + scene.size_m])
    middle, span = 0.5 * (low + high), float(np.linalg.norm(high - low))
    torso = scene.trajectory.torso_m[:: max(1, scene.trajectory.samples // 40)]
    along = unit(np.append((scene.trajectory.torso_m[-1] - scene.trajectory.torso_m[0])[:2], 0.0))
    rays = np.linspace(0.05, 0.5, 30)[:, None, None]

    def merit(painter: Painter) -> float:
        towards = painter.axes[2]
        points = torso + rays * span * towards
        free = np.all(points[..., 2] > scene.trajectory.terrain.height(points[..., :2]), axis=0)
        across = 1.0 - abs(float(along @ unit(towards * [1.0, 1.0, 0.0])))
        light = float(painter.axes[1] @ UP)  # low enough to see heights
        return 3.0 * float(free.mean()) + across + 0.8 * light

    angles = product(np.deg2rad(np.arange(-180.0, 180.0, 15.0)), np.deg2rad([28.0, 38.0, 50.0]))
    return max((Painter(middle, *angle, 1.9 * span) for angle in angles), key=merit)
