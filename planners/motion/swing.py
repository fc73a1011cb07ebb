"""The path of a foot from one toe to the next: up along the patch's normal, across, down along the
next one's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from ..files.arrays import Array
from ..robot.urdf import FOOT_RADIUS_M
from ..terrain.prism import Solids

KEPT_M = 0.006
"""Feet stay this far from the terrain on their path across."""
RAISES_M = np.array(
    sorted(
        product((0.0, 0.02, 0.04, 0.07, 0.10, 0.14), repeat=2),
        key=lambda pair: (sum(pair), max(pair)),
    )
)
"""Heights beyond the usual to which a foot may be lifted, and by which higher it may come from, the
lowest first (36, 2)."""
SHARES = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True, kw_only=True, eq=False)
class Swing:
    """The path of a foot in the air.

    Arguments:
        start, lifted, lowered, end: centres of the foot, shape (3,) [m]; straight lines join them.
    """

    start: Array
    lifted: Array
    lowered: Array
    end: Array

    @property
    def lengths_m(self) -> tuple[float, float, float]:
        """Up, across and down [m]."""
        up, across, down = (float(np.linalg.norm(b - a)) for a, b in pairwise(self.corners))
        return up, across, down

    @property
    def corners(self) -> tuple[Array, Array, Array, Array]:
        """End points of the three straight lines, in order."""
        return self.start, self.lifted, self.lowered, self.end


def clear_swing(
    ends: tuple[Array, Array],
    normals: tuple[Array, Array],
    clearance_m: float,
    solids: Solids,
    radius_m: float = FOOT_RADIUS_M,
    kept_m: float = KEPT_M,
) -> Swing:
    """The lowest swing that stays ``kept_m`` off the terrain on its path across; the clearest one
    where none does.

    Arguments:
        ends, normals: of the two toes' surfaces, the foot's centres, shape (3,) [m].
        clearance_m: least lift.
        radius_m: of the foot.
    """
    lifted = ends[0] + (clearance_m + RAISES_M[:, :1]) * normals[0]
    lowered = ends[1] + (clearance_m + RAISES_M[:, 1:]) * normals[1]

    def gaps(its: slice) -> Array:
        paths = lifted[its, None] + SHARES[:, None] * (lowered[its] - lifted[its])[:, None]
        return np.asarray(solids.distances(paths).min(axis=(1, 2), initial=np.inf) - radius_m)

    gap = gaps(slice(1))
    if gap[0] < kept_m:
        gap = np.concatenate([gap, gaps(slice(1, None))])
    clear = gap >= kept_m
    k = int(np.argmax(clear) if clear.any() else np.argmax(gap))
    return Swing(start=ends[0], lifted=lifted[k], lowered=lowered[k], end=ends[1])
