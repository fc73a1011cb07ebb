"""Matrices that place the meshes of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...files.arrays import Array
from ...files.documents import shown
from .numbers import broken


def checked_matrix(values: Any) -> Array:
    """Sixteen numbers as a matrix, shape (4, 4), row by row.

    Raises InvalidInput.
    """
    try:
        matrix = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (16,) or not np.all(np.isfinite(matrix)):
        raise broken(f"expected a matrix of 16 numbers, got {shown(values)}")
    return matrix.reshape(4, 4)


def moved(points: Array, place: Array) -> Array:
    """Points, shape (K, 3), by a matrix, shape (4, 4)."""
    return np.asarray(points @ place[:3, :3].T + place[:3, 3])


def turn_of(quaternion: Array) -> Array:
    """The rotation of a quaternion x, y, z, w of any length but 0, shape (3, 3).

    Raises InvalidInput.
    """
    length = float(np.linalg.norm(quaternion))
    if not 0.0 < length < np.inf:
        raise broken("expected a rotation that is a quaternion")
    x, y, z, w = quaternion / length
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
