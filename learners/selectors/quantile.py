"""The quantile box of S: the plain baseline that every learned envelope has to beat."""

from __future__ import annotations

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import Envelope


def quantile_box(points: Array, *, share: float = 0.05) -> Envelope:
    """Bounds that leave ``share`` of the solutions out on each side of each dimension.

    Arguments:
        points: shape (K, N, 6).
    """
    return Envelope(
        low=np.quantile(points, share, axis=0), high=np.quantile(points, 1.0 - share, axis=0)
    )
