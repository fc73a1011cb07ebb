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


def rotations_of(vectors: Array) -> Array:
    """The same of many, shape (..., 3) to (..., 3, 3)."""
    square = np.einsum("...i,...i->...", vectors, vectors)[..., None, None]
    angle = np.sqrt(square)
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    skew = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))
    # sin a / a and (1 - cos a) / a^2, the latter without the difference
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * skew + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (skew @ skew)
    )


def between_rotations(first: Array, last: Array, share: Array) -> Array:
    """Rotations a share of the way from one to another, each by less than half a turn about one axis: (L, 3, 3)."""
    turn = np.swapaxes(first, 1, 2) @ last
    skew = 0.5 * (turn - np.swapaxes(turn, 1, 2))
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    share = share * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    return np.asarray(first @ rotations_of(share[:, None] * axis))
