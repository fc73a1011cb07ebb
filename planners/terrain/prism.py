"""Solids behind patches: what a limb may run into, and what worlds build their terrain of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array, cross

THICKNESS_M = 0.04
FLAT_M = 1e-6
"""A patch whose corners leave their plane by no more is flat."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A convex body, mostly a thin prism behind a patch's surface.

    Arguments:
        corners: shape (K, 3) [m].
        normals, offsets_m: its faces n·x = d, outwards, shape (F, 3), (F,).
        triangles: of its surface, turned outwards, by index of the corners, shape (T, 3).
    """

    corners: Array
    normals: Array
    offsets_m: Array
    triangles: NDArray[np.int_]

    @classmethod
    def behind(cls, border_m: Array, normal: Array, thickness_m: float = THICKNESS_M) -> Solid:
        """A surface with some thickness behind it.

        Arguments:
            border_m: its corners in order, shape (U, 3) [m].
            normal: its unit normal, shape (3,).
            thickness_m: of the solid.
        """
        return cls.behind_all([border_m], [normal], [thickness_m])[0]

    @classmethod
    def behind_all(
        cls, borders_m: Sequence[Array], normals: Sequence[Array], thicknesses_m: Sequence[float]
    ) -> list[Solid]:
        """The solids ``behind`` many surfaces; those of as many corners are made at once."""
        prisms = [_prism(*each) for each in zip(borders_m, normals, thicknesses_m, strict=True)]
        solids: list[Solid | None] = [None] * len(prisms)
        for size in {len(corners) for corners in prisms}:
            chosen = [k for k, corners in enumerate(prisms) if len(corners) == size]
            corners, outwards = (
                np.array([prisms[k] for k in chosen]),
                np.array([normals[k] for k in chosen]),
            )
            for k, solid in zip(chosen, cls._of_prisms(corners, outwards), strict=True):
                solids[k] = solid
        return [solid for solid in solids if solid is not None]

    @classmethod
    def _of_prisms(cls, corners: Array, normal: Array) -> list[Solid]:
        """The solids between K borders and what lies behind them.

        Arguments:
            corners: the borders, and the same moved back, shape (K, 2U, 3) [m].
            normal: unit normals, shape (K, 3).
        """
        count = corners.shape[1] // 2
        border, top = corners[:, :count], np.arange(count)
        then = np.concatenate([top[1:], top[:1]])
        bent = np.ptp(np.matmul(border, normal[:, :, None])[..., 0], axis=1) > FLAT_M
        around = np.vecdot(cross(border, border[:, then]).sum(axis=1), normal)
        sides = np.sign(around)[:, None, None] * cross(
            border[:, then] - border, np.repeat(normal[:, None], count, axis=1)
        )
        sides /= np.linalg.norm(sides, axis=2)[..., None]
        faces = np.concatenate([normal[:, None], -normal[:, None], sides], axis=1)
        offsets = np.matmul(faces, corners.transpose(0, 2, 1)).max(axis=2)
        fan = np.stack([np.zeros_like(top[2:]), top[1:-1], top[2:]], axis=1)
        walls = [
            np.stack([top, top + count, then], axis=1),
            np.stack([then, top + count, then + count], axis=1),
        ]
        triangles = np.concatenate([fan, fan[:, ::-1] + count, *walls])
        return [
            cls.of_corners(corners[k])  # bent as far as a patch may be
            if bent[k]
            else cls(
                corners=corners[k],
                normals=faces[k],
                offsets_m=offsets[k],
                triangles=triangles if around[k] > 0.0 else triangles[:, ::-1],
            )
            for k in range(len(corners))
        ]

    @classmethod
    def of_corners(cls, corners: Array) -> Solid:
        """The convex hull of points, shape (K, 3) [m]."""
        from scipy.spatial import ConvexHull  # slow to import

        hull = ConvexHull(corners)
        triangles, outwards = hull.simplices.astype(np.int_), hull.equations[:, :3]
        a, b, c = (corners[triangles[:, i]] for i in range(3))
        turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), outwards) < 0.0
        triangles[turned] = triangles[turned][:, [0, 2, 1]]
        faces = np.unique(hull.equations.round(12), axis=0)
        return cls(
            corners=corners, normals=faces[:, :3], offsets_m=-faces[:, 3], triangles=triangles
        )

    def distance(self, points: Array) -> Array:
        """Distance of points from the outside: never more than their distance, negative inside;
        shape (…, 3) to (…) [m].
        """
        return np.asarray((points @ self.normals.T - self.offsets_m).max(axis=-1))


class Solids:
    """Convex bodies whose distances are measured at once."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        counts = np.array([len(solid.offsets_m) for solid in solids], dtype=np.int_)
        self._first = np.cumsum(counts) - counts
        self._normals = (
            np.concatenate([solid.normals for solid in solids]) if solids else np.zeros((0, 3))
        )
        self._offsets_m = (
            np.concatenate([solid.offsets_m for solid in solids]) if solids else np.zeros(0)
        )

    def distances(self, points: Array) -> Array:
        """Distances from each of S solids, as of ``Solid.distance``: shape (…, 3) to (…, S) [m]."""
        if not len(self._first):
            return np.zeros((*points.shape[:-1], 0))
        beyond = points @ self._normals.T - self._offsets_m
        return np.asarray(np.maximum.reduceat(beyond, self._first, axis=-1))


def _prism(border: Array, normal: Array, thickness_m: float) -> Array:
    """The border without doubled corners, then the same moved back along the normal, shape (2U, 3)
    [m].
    """
    before = border[[-1, *range(len(border) - 1)]]
    apart = np.linalg.norm(border - before, axis=1) > 1e-9
    return np.concatenate([border[apart], border[apart] - thickness_m * normal])
