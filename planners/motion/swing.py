"""The path of a foot from one toe to the next: up along the patch's normal, across, down along the next one's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from ..files.arrays import Array
from ..robot.urdf import FOOT_RADIUS_M
from ..terrain.prism import Solid

KEPT_M = 0.006
"""Feet stay this far from the terrain on their path across."""
RAISES_M = (0.0, 0.02, 0.04, 0.07, 0.10, 0.14)
"""How much higher than usual a foot may be lifted, and how much higher it may come from."""
SHARES = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True, kw_only=True, eq=False)
class Swing:
    """start, lifted, lowered, end: centres of the foot, shape (3,) [m]; straight lines join them."""

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
        """Where the lines begin and end."""
        return self.start, self.lifted, self.lowered, self.end


def clear_swing(
    ends: tuple[Array, Array],
    normals: tuple[Array, Array],
    clearance_m: float,
    solids: Sequence[Solid],
    radius_m: float = FOOT_RADIUS_M,
) -> Swing:
    """The lowest swing that stays off the terrain on its path across; the clearest one where none does.

    ends, normals: of the two toes' surfaces, the foot's centres, shape (3,) [m]. clearance_m: least lift.
    radius_m: of the foot.
    """
    best, most = None, -np.inf
    for up, down in sorted(product(RAISES_M, repeat=2), key=lambda raises: (sum(raises), max(raises))):
        swing = Swing(
            start=ends[0], lifted=ends[0] + (clearance_m + up) * normals[0],
            lowered=ends[1] + (clearance_m + down) * normals[1], end=ends[1],
        )  # fmt: skip
        path = swing.lifted + SHARES[:, None] * (swing.lowered - swing.lifted)
        gap = min((float(solid.distance(path).min()) for solid in solids), default=np.inf) - radius_m
        if gap >= KEPT_M:
            return swing
        if gap > most:
            best, most = swing, gap
    assert best is not None
    return best
