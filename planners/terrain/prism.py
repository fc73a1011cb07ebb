"""Solids behind patches: what a limb may run into, and what worlds build their terrain of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from .patch import Patch

THICKNESS_M = 0.04


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
        return cls.of_corners(_prism(patch, thickness_m))

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
