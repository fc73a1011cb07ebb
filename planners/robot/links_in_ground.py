"""How deep links are in ground that is given by heights: points all over their hulls, by the ground's own spline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..files.arrays import Array
from ..terrain.obstacles import Ground
from .overlaps import WholeBody
from .solids import surface_points

APART_M = 0.02
"""Points of a link's surface that are looked for in the ground are about so far apart."""


PATCH_M = 1e-3
"""A ball touches where it comes so near to the plane that it stands on."""


class LinksInGround:
    """Shapes of links over one ground. points: whose hulls the shapes are, a shape each, (K, 3) [m]; feet: the limb
    that touches with a shape, −1 for none; radii_m: of the limbs' feet. Shapes are where they are with R_WS and p_WS,
    (S, 3, 3), (S, 3)."""

    def __init__(self, ground: Ground, points: Sequence[Array], feet: Sequence[int], radii_m: Array) -> None:
        self.ground, self._feet = ground, np.array(feet)
        self._patches_m = np.sqrt(2.0 * radii_m * PATCH_M) + PATCH_M
        self._surfaces = [surface_points(each, APART_M) for each in points]

    def depths(
        self, turns: Array, origins: Array, low: Array, high: Array, body: WholeBody
    ) -> Iterator[tuple[int, float]]:
        """Shapes whose boxes, corners (S, 3), may be in the ground, and how deep they are, negative above [m]; of feet
        that stand on it what is outside the patch on which they touch."""
        for shape in np.flatnonzero(self.ground.near(low, high)).tolist():
            limb = int(self._feet[shape])
            if limb < 0 or not body.stands[limb]:
                yield shape, self.depth(turns, origins, shape)
                continue
            points = self._surfaces[shape] @ turns[shape].T + origins[shape]
            apart = np.linalg.norm(points - body.toes_m[limb], axis=1) > self._patches_m[limb]
            yield shape, float(self.ground.depth(points[apart]).max(initial=-np.inf))

    def depth(self, turns: Array, origins: Array, shape: int) -> float:
        """How deep a shape is [m]."""
        return float(self.ground.depth(self._surfaces[shape] @ turns[shape].T + origins[shape]).max())
