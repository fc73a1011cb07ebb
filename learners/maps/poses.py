"""Poses over a terrain as posture problems: the robot's default stance at every place and heading, its
toes put on the nearest places to stand.

A pose is a place of the centre of mass from above and a heading. Each toe is put on the place of
the terrain that is nearest, from above, to where the toe is as the robot stands; the centre of mass
is as high over the mean of these places as it is over its toes then, the body upright. A patch is
the triangle in the free circle about its place, up to the largest that is drawn for the robot. A
toe whose nearest place is farther than ``aside_m`` has no foothold, and its pose is infeasible by
that alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from stancekit.envs.distributions.cut import SMALLER, Places
from stancekit.envs.distributions.stance import (
    FORWARD,
    NominalStance,
    StandingRobot,
    plain_problem,
    triangle,
)
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked, checked_int
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.problem.standing_map import MOST_POSES
from stancekit.planners.robot import Robot
from stancekit.planners.terrain.footholds import Footholds

Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """All poses of a grid.

    Arguments:
        places: of the terrain.
        stance: the robot's.
        like: a problem of the robot.
        corner_m, spacing_m, counts, headings_rad: the grid.
        chosen: per pose and limb the number of its place, shape (P, N).
        aside_m: how far each is from where its toe likes to be, from above, (P, N) [m].
        z_m: of the centre of mass, (P,) [m].
        most_aside_m: how far one may be.
        options: of the terrain's file and of footholds, other than the usual.
    """

    terrain: str
    robot: Robot
    places: Places
    stance: NominalStance
    like: Problem
    friction: float
    corner_m: Array
    spacing_m: float
    counts: tuple[int, int]
    headings_rad: Array
    chosen: NDArray[np.int32]
    aside_m: Array
    z_m: Array
    most_aside_m: float
    options: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        footholds: Footholds,
        robot: Robot | str | None,
        *,
        terrain: str,
        spacing_m: float,
        headings: int,
        friction: float,
        options: dict[str, Any] | None = None,
    ) -> Poses:
        """The poses over a terrain.

        Arguments:
            footholds: where its toes may stand.
            terrain: the terrain's name.

        Raises InvalidInput for a grid without cells or with too many, a terrain without places to
        stand, and numbers out of range.
        """
        checked(spacing_m, "spacing_m", above=0.0)
        checked_int(headings, "headings", least=1, most=3600)
        checked(friction, "friction", least=0.0)
        standing = StandingRobot.of(robot)
        legs = standing.robot.limb_names
        stance = standing.stance("ground", legs)
        places = Places.of_footholds(footholds, SMALLER * stance.circumradius_m[0])
        low, high = places.points_m[:, :2].min(axis=0), places.points_m[:, :2].max(axis=0)
        counts = np.floor((high - low) / spacing_m + 1e-9)
        if not (counts >= 1.0).all():
            raise InvalidInput(
                f"spacing_m: expected a grid of one cell or more over {high[0] - low[0]:.3g} × "
                f"{high[1] - low[1]:.3g} m "
                f"of footholds, got none with {spacing_m:g} m"
            )
        if float(np.prod(counts)) * headings > MOST_POSES:
            raise InvalidInput(
                f"spacing_m, headings: expected {MOST_POSES} poses or fewer, got "
                f"{float(np.prod(counts)) * headings:.3g}"
            )
        number = int(counts[0]), int(counts[1])
        corner = low + 0.5 * (high - low - spacing_m * (counts - 1.0))
        turns = 2.0 * np.pi * np.arange(headings) / headings
        chosen, aside, z = _snapped(places, stance, corner, spacing_m, number, turns)
        return cls(
            terrain=terrain,
            robot=standing.robot,
            places=places,
            stance=stance,
            like=plain_problem(standing.robot, legs, stance, shear=FORWARD),
            friction=float(friction),
            corner_m=corner,
            spacing_m=float(spacing_m),
            counts=number,
            headings_rad=turns,
            chosen=chosen,
            aside_m=aside,
            z_m=z,
            most_aside_m=float(np.abs(stance.room_m[:, :2]).min()),
            options=dict(options or {}),
        )

    def __len__(self) -> int:
        return len(self.z_m)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Places along x and y, and headings."""
        return *self.counts, len(self.headings_rad)

    @property
    def off(self) -> NDArray[np.bool_]:
        """Poses that lack a foothold, shape (P,)."""
        return np.asarray((self.aside_m > self.most_aside_m).any(axis=1))

    def batch(self, which: Index) -> PostureBatch:
        """Problems of some poses, by number, in the body's axes."""
        i, j, k = np.unravel_index(which, self.shape)
        body = np.column_stack(
            [self.corner_m + self.spacing_m * np.column_stack([i, j]), self.z_m[which]]
        )
        axes = _axes(self.headings_rad[k])
        chosen = self.chosen[which]
        normals = self.places.normals[chosen] @ axes
        centres = (self.places.points_m[chosen] - body[:, None]) @ axes
        normals /= np.linalg.norm(normals, axis=-1)[..., None]
        radius = np.minimum(self.stance.circumradius_m[1], self.places.free_m[chosen])
        corners = centres[:, :, None] + triangle(normals, radius, np.zeros_like(radius))
        return PostureBatch(
            like=self.like,
            vertices_m=corners,
            normals=normals,
            friction=np.full(chosen.shape, self.friction),
            convex=True,
        )


def _axes(turns: Array) -> Array:
    """Axes of a body that faces so, its columns in the world, shape (K, 3, 3)."""
    c, s, zero, one = np.cos(turns), np.sin(turns), np.zeros_like(turns), np.ones_like(turns)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, one]]
    return np.moveaxis(np.array(rows), -1, 0)


def _snapped(
    places: Places,
    stance: NominalStance,
    corner: Array,
    spacing: float,
    counts: tuple[int, int],
    turns: Array,
) -> tuple[NDArray[np.int32], Array, Array]:
    """Place of every toe, how far aside it is, and the height of the centre of mass."""
    tree = KDTree(places.points_m[:, :2])
    toes = stance.centre_m @ _axes(turns).swapaxes(1, 2)  # (H, N, 3)
    chosen, aside, z = [], [], []
    lines = spacing * np.arange(counts[1])
    for i in range(counts[0]):
        body = corner + np.column_stack([np.full(counts[1], spacing * i), lines])
        at = body[:, None, None] + toes[None, :, :, :2]
        gap, number = map(np.asarray, tree.query(at.reshape(-1, 2)))
        shape = (-1, len(stance.centre_m))
        chosen.append(number.reshape(shape).astype(np.int32))
        aside.append(gap.reshape(shape))
        z.append(places.points_m[number, 2].reshape(shape).mean(axis=1))
    down = float(stance.centre_m[:, 2].mean())
    return np.concatenate(chosen), np.concatenate(aside), np.concatenate(z) - down
