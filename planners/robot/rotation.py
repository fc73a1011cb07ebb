"""Rotations exactly, where planners linearise them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..files.arrays import Array


def rotation_of(vector: ArrayLike) -> Array:
    """exp([v]×): the rotation matrix of a rotation vector, shape (3,) [rad] → (3, 3)."""
    from scipy.spatial.transform import Rotation  # takes longer to import than a plan takes to find

    return np.asarray(Rotation.from_rotvec(np.array(vector, dtype=np.float64)).as_matrix())
