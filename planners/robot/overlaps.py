"""A robot in the world, and what of it is near to, or inside, something else: plain values."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeBody:
    """A robot in the world, J joints, N limbs, at one moment; or at T moments, which every array
    then begins with.

    Arguments:
        rotation, origin_m: R_WB and p_WB of the base's frame, shapes (3, 3), (3,) [m].
        angles: joint angles, shape (J,) [rad].
        toes_m, normals: contact points of the limbs [m] and normals of the surfaces there, shape
            (N, 3).
        stands: truth values, True for limbs that stand, shape (N,).
    """

    rotation: Array
    origin_m: Array
    angles: Array
    toes_m: Array
    normals: Array
    stands: NDArray[np.bool_]

    @property
    def moments(self) -> WholeBody:
        """Moments of the body, T of them, one where it is one."""
        return self if self.angles.ndim == 2 else self.at(None)

    def at(self, rows: slice | NDArray[np.intp] | int | None) -> WholeBody:
        """Some of the moments, by number."""
        return replace(self, **{item.name: getattr(self, item.name)[rows] for item in fields(self)})

    def __len__(self) -> int:
        return len(self.moments.angles)


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """A link is depth_m deep inside something: another link, or a part of the terrain."""

    link: str
    other: str
    depth_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Near:
    """A shape of a link near to another one, or to a part of the terrain.

    Arguments:
        shape, other: numbers of the shapes, other −1 for the terrain.
        name: name of the other link or part of the terrain.
        distance_m: distance between them, negative inside [m].
        points_m: nearest points of both, in the world, shape (2, 3) [m].
        normal: unit vector from the other to the shape, along which the distance grows.
    """

    shape: int
    other: int
    name: str
    distance_m: float
    points_m: Array
    normal: Array
