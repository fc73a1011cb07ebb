"""Rotations exactly, where planners linearise them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..files.arrays import Array


def rotation_of(vector: ArrayLike) -> Array:
    """exp([v]×): the rotation matrix of a rotation vector, shape (3,) [rad] → (3, 3), read-only."""
    return _rotation_of(np.array(vector, dtype=np.float64).tobytes())


@lru_cache(maxsize=64)  # of one control period, and of the postures of one plan: each is asked for several times
def _rotation_of(vector: bytes) -> Array:
    from scipy.spatial.transform import Rotation  # takes longer to import than a plan takes to find

    matrix = np.array(Rotation.from_rotvec(np.array(np.frombuffer(vector))).as_matrix())
    matrix.flags.writeable = False
    return matrix
