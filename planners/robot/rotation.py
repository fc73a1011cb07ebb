"""Rotations exactly, where planners linearise them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..files.arrays import Array


def rotation_of(vector: ArrayLike) -> Array:
    """exp([v]×): the rotation matrix of a rotation vector, shape (3, 3)."""
    x, y, z = np.asarray(vector, dtype=np.float64)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = float(np.sqrt(x * x + y * y + z * z))
    if angle < 1e-9:
        return np.asarray(np.eye(3) + skew)
    return np.asarray(np.eye(3) + np.sin(angle) / angle * skew + (1.0 - np.cos(angle)) / angle**2 * (skew @ skew))
