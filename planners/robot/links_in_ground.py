"""Depth of links in ground that is given by heights: points all over their hulls, by the ground's
own spline.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..files.arrays import Array
from ..terrain.obstacles import Ground
from .inverse_kinematics import WholeBody
from .meshes import surface_points

_APART_M = 0.02
"""Points of a link's surface that are looked for in the ground are about so far apart."""


_PATCH_M = 1e-3
"""A ball touches where it comes so near to the plane that it stands on."""


class LinksInGround:
    """Shapes of links over one ground.

    Shapes are where they are with R_WS and p_WS, (S, 3, 3), (S, 3).

    Arguments:
        points: whose hulls the shapes are, a shape each, (K, 3) [m].
        feet: the limb that touches with a shape, −1 for none.
        radii_m: radii of the limbs' feet.
    """

    def __init__(
        self, ground: Ground, points: Sequence[Array], feet: Sequence[int], radii_m: Array
    ) -> None:
        self.ground, self._feet = ground, np.array(feet)
        self._patches_m = np.sqrt(2.0 * radii_m * _PATCH_M) + _PATCH_M
        self._points, self._surfaces = points, dict[int, Array]()

    def _surface(self, shape: int) -> Array:
        """Points all over a shape that comes near to the ground, in its own frame, shape (P, 3)
        [m].
        """
        if shape not in self._surfaces:
            self._surfaces[shape] = surface_points(self._points[shape], _APART_M)
        return self._surfaces[shape]

    def depths(
        self, turns: Array, origins: Array, low: Array, high: Array, bodies: WholeBody
    ) -> Iterator[tuple[int, int, float]]:
        """Moments and shapes whose boxes, corners (T, S, 3), may be in the ground, and how deep
        they are, −inf of what is above [m]; of feet that stand on it what is outside the patch on
        which they touch.
        """
        tops = self.ground.tops(low.reshape(-1, 3), high.reshape(-1, 3)).reshape(low.shape[:2])
        near = low[..., 2] < tops
        for shape in np.flatnonzero(near.any(axis=0)).tolist():
            moments, limb = np.flatnonzero(near[:, shape]), int(self._feet[shape])
            points = (
                self._surface(shape) @ np.swapaxes(turns[moments, shape], 1, 2)
                + origins[moments, shape, None]
            )
            below = points[..., 2] < tops[moments, shape, None]
            if limb >= 0:
                apart = (
                    np.linalg.norm(points - bodies.toes_m[moments, None, limb], axis=2)
                    > self._patches_m[limb]
                )
                below &= apart | ~bodies.stands[moments, None, limb]
            depths = np.full(below.shape, -np.inf)
            depths[below] = self.ground.depth_inside(points[below])
            for t, depth in zip(moments.tolist(), depths.max(axis=1).tolist(), strict=True):
                yield t, shape, depth

    def depth(self, turns: Array, origins: Array, shape: int) -> float:
        """Depth of a shape in the ground [m]."""
        return float(
            self.ground.depth(self._surface(shape) @ turns[shape].T + origins[shape]).max()
        )
