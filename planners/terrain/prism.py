"""Solids behind patches: what a limb may run into, and what worlds build their terrain of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from .patch import Patch

THICKNESS_M = 0.04
FLAT_M = 1e-6
"""A patch whose corners leave their plane by no more is flat."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A convex body, mostly a thin prism behind a patch's surface.

    corners: shape (K, 3) [m]. normals, offsets_m: its faces n·x = d, outwards, shape (F, 3), (F,).
    triangles: of its surface, turned outwards, by index of the corners, shape (T, 3).
    """

    corners: Array
    normals: Array
    offsets_m: Array
    triangles: NDArray[np.int_]

    @classmethod
    def behind(cls, patch: Patch, thickness_m: float = THICKNESS_M) -> Solid:
        """The patch with some thickness behind it."""
        corners = _prism(patch, thickness_m)
        count = len(corners) // 2
        heights = corners[:count] @ patch.normal
        if np.ptp(heights) > FLAT_M:
            return cls.of_corners(corners)  # bent as far as a patch may be
        top = np.arange(count)
        then = np.roll(top, -1)
        around = np.cross(corners[:count], corners[then]).sum(axis=0) @ patch.normal
        sides = np.sign(around) * np.cross(corners[then] - corners[:count], patch.normal)
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        normals = np.vstack([patch.normal, -patch.normal, sides])
        fan = np.stack([np.zeros_like(top[2:]), top[1:-1], top[2:]], axis=1)
        walls = [np.stack([top, top + count, then], axis=1), np.stack([then, top + count, then + count], axis=1)]
        triangles = np.concatenate([fan, fan[:, ::-1] + count, *walls])
        return cls(
            corners=corners, normals=normals, offsets_m=(normals @ corners.T).max(axis=1),
            triangles=triangles if around > 0.0 else triangles[:, ::-1],
        )  # fmt: skip

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
        return cls(corners=corners, normals=faces[:, :3], offsets_m=-faces[:, 3], triangles=triangles)

    def distance(self, points: Array) -> Array:
        """How far points are outside: never more than their distance, negative inside; shape (…, 3) to (…) [m]."""
        return np.asarray((points @ self.normals.T - self.offsets_m).max(axis=-1))


def _prism(patch: Patch, thickness_m: float) -> Array:
    """The patch's border without doubled corners, then the same moved back along the normal, shape (2U, 3) [m]."""
    border = patch.vertices_m
    apart = np.linalg.norm(border - np.roll(border, 1, axis=0), axis=1) > 1e-9
    return np.concatenate([border[apart], border[apart] - thickness_m * patch.normal])
