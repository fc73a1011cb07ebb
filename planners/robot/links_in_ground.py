"""How deep links are in ground that is given by heights: points all over their hulls, by the ground's own spline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..terrain.obstacles import Ground
from .solids import surface_points

APART_M = 0.02
"""Points of a link's surface that are looked for in the ground are about so far apart."""


class LinksInGround:
    """Shapes of links over one ground. points: whose hulls the shapes are, a shape each, (K, 3) [m]; feet: the limb
    whose foot a shape is of, −1 for none. Shapes are where they are with R_WS and p_WS, (S, 3, 3), (S, 3)."""

    def __init__(self, ground: Ground, points: Sequence[Array], feet: Sequence[int]) -> None:
        self.ground, self._feet = ground, np.array(feet)
        self._surfaces = [surface_points(each, APART_M) for each in points]

    def depths(
        self, turns: Array, origins: Array, low: Array, high: Array, stands: NDArray[np.bool_]
    ) -> Iterator[tuple[int, float]]:
        """Shapes whose boxes, corners (S, 3), may be in the ground, and how deep they are, negative above [m]; feet
        that stand on it, shape (N,), do not count."""
        may = self.ground.near(low, high) & ~((self._feet >= 0) & stands[self._feet])
        for shape in np.flatnonzero(may).tolist():
            yield shape, self.depth(turns, origins, shape)

    def depth(self, turns: Array, origins: Array, shape: int) -> float:
        """How deep a shape is [m]."""
        return float(self.ground.depth(self._surfaces[shape] @ turns[shape].T + origins[shape]).max())
