"""The decoupled chart: feet over the terrain, the torso over a smoothed one, so that it does not
feel every stone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from ...terrain.heightfield import HeightField
from ...warp.spline_map import SplineMap
from .shear import Shear


class DecoupledChart(Shear):
    """Feet as in the shear; the torso over the terrain under a Gaussian of deviation smoothing_m
    [m].
    """

    @classmethod
    def of(
        cls, terrain: HeightField, *, smoothing_m: float, flattened: Callable[[], SplineMap]
    ) -> Self:
        """Chart of the terrain and its smoothed self."""
        return cls(terrain, terrain.smoothed(smoothing_m))
