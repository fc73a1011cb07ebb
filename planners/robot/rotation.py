"""Rotations exactly, where planners linearise them."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..files.arrays import Array

SMALL_RAD = 1e-3
"""Below this angle, sin(a/2) / a is its series."""


def rotation_of(vector: ArrayLike) -> Array:
    """exp([v]×): the rotation matrix of a rotation vector, shape (3,) [rad] → (3, 3), read-only."""
    return _rotation_of(np.array(vector, dtype=np.float64).tobytes())


@lru_cache(
    maxsize=64
)  # of one control period, and of the postures of one plan: each is asked for several times
def _rotation_of(vector: bytes) -> Array:
    matrix = rotations_of(np.frombuffer(vector))
    matrix.flags.writeable = False
    return matrix


def rotations_of(vectors: Array) -> Array:
    """Rotation matrices of many vectors, shape (…, 3) to (…, 3, 3), by quaternions.

    SciPy's ``Rotation.from_rotvec(vectors).as_matrix()`` gives the same numbers to the last bit;
    its import takes longer than a plan takes to find.
    """
    x, y, z = np.moveaxis(np.asarray(vectors, dtype=np.float64), -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    square, each = angle * angle, angle.ravel().tolist()
    large = np.array([math.sin(0.5 * a) / a if a > SMALL_RAD else 0.0 for a in each]).reshape(
        angle.shape
    )
    scale = np.where(angle > SMALL_RAD, large, 0.5 - square / 48.0 + square * square / 3840.0)
    w = np.array([math.cos(0.5 * a) for a in each]).reshape(angle.shape)
    x, y, z = scale * x, scale * y, scale * z
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    rows = (
        (xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)),
        (2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)),
        (2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def continued(vectors: Array) -> Array:
    """The same rotations by the vectors that are nearest to the one before, shape (K, 3) [rad].

    A heading that passes half a turn goes on there, where rotation vectors jump by a whole one.
    """
    result = np.array(vectors, dtype=np.float64)
    if not np.any(np.linalg.norm(np.diff(result, axis=0), axis=1) > math.pi):
        return result
    for before, vector in pairwise(result):  # rows of it, which are changed
        if (angle := float(np.linalg.norm(vector))) > 0.0:
            axis = vector / angle
            vector += math.tau * np.rint((before @ axis - angle) / math.tau) * axis
    return result


def between_rotations(first: Array, last: Array, share: Array) -> Array:
    """Rotations a share of the way from one to another, each by less than half a turn about one
    axis: (L, 3, 3).
    """
    turn = np.swapaxes(first, 1, 2) @ last
    skew = 0.5 * (turn - np.swapaxes(turn, 1, 2))
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    share = share * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    return np.asarray(first @ rotations_of(share[:, None] * axis))
