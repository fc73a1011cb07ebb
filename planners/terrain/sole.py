"""A foot that is a rigid flat sole: points on it, turned by a yaw about a patch's normal, and where
its centre may be.

All points of a sole are on one patch, so its centre q is where every q + o_k is: the patch shrunk
by the points. With the yaw fixed that is a convex polygon, and everything else that is linear in a
toe stays so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from .patch import Patch
from .polygon import clipped, half_planes

_MOST_POINTS = 16
_FLAT_M = 1e-7
"""A sole's points are in one plane: corners of a patch under it may be this far off [m]."""


def checked_sole(value: ArrayLike, where: str) -> Array:
    """Points of a sole (forward, left) about the foot's frame, shape (K, 2) [m], read-only.

    Raises InvalidInput unless they are three or more that are not in one line.
    """
    points = read_only(value, (None, 2), where)
    if not 3 <= len(points) <= _MOST_POINTS:
        raise InvalidInput(
            f"{where}: expected 3 to {_MOST_POINTS} points of a sole, got {len(points)}"
        )
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-3:
        raise InvalidInput(
            f"{where}: expected points that are not in one line, got {points.tolist()}"
        )
    return points


def sole_offsets(sole_m: Array, patch: Patch, yaw_rad: float) -> Array:
    """From the centre of a sole on a patch to its points, world frame, shape (K, 3) [m].

    Its forward axis is the patch's z, the shear reference, turned by the yaw about the normal; left
    is n × forward.
    """
    normal, y, z = patch.frame.T
    forward = np.cos(yaw_rad) * z - np.sin(yaw_rad) * y
    return np.asarray(sole_m @ np.array([forward, np.cross(normal, forward)]))


def sole_region(patch: Patch, offsets_m: Array) -> Patch:
    """Region in which the centre of a sole may be that is on a patch with all of its points: a
    piece of the patch's plane.

    Arguments:
        offsets_m: of the points, shape (K, 3).

    Raises:
        InvalidInput: where there is no room, and for a patch that is bent.
    """
    axes, origin = patch.frame[:, 1:], patch.centre_m
    off = float(np.abs((patch.vertices_m - origin) @ patch.normal).max())
    if off > _FLAT_M:
        raise InvalidInput(
            f"expected a patch flat to {_FLAT_M:g} m under a sole, got corners {off:.3g} m off its "
            "plane"
        )
    polygon, points = (patch.vertices_m - origin) @ axes, offsets_m @ axes
    normals, offsets = half_planes(polygon)
    left = clipped(polygon - points[0], normals, offsets - (normals @ points.T).max(axis=1))
    if not len(left):
        raise InvalidInput("expected room for a sole on the patch, got less than a millimetre")
    return replace(patch, vertices_m=origin + left @ axes.T)
