"""Feet that are soles, as the verifier works them out: where their points are, and how far off they
are.
"""

from __future__ import annotations

import math

import numpy as np

from ..files.arrays import Array
from ..problem.contact import Contact
from ..robot.model import Limb
from ..terrain.patch import Patch
from .geometry import contact_frames, cross, length, patch_distances

POINTS_SUM = 1e-9
"""Forces at the points of a foot add up to the foot's, up to this share of the largest."""


def sole_points(sole_m: Array | None, patch: Patch, yaw_rad: float) -> Array:
    """From the toe to the points that bear forces, shape (K, 3) [m]; of a point foot its own place.

    Forward is z of the contact frame (E3) turned by the yaw about the normal n; left is n ×
    forward.
    """
    if sole_m is None:
        return np.zeros((1, 3))
    n, _, z = contact_frames(patch.normal, patch.shear_reference).T
    ahead = math.cos(yaw_rad) * z + math.sin(yaw_rad) * cross(n, z)
    left = cross(n, ahead)
    return np.asarray(sole_m[:, :1] * ahead + sole_m[:, 1:] * left)


def off_sole(patch: Patch, region: Patch, offsets: Array, toe: Array, claimed: Array) -> float:
    """The farthest of: the centre from where it may be, a point from the patch, a point from where
    it is claimed [m].

    Arguments:
        claimed: shape (K, 3) or longer; what comes after the points is the centre.
    """
    points = np.concatenate(
        [toe + offsets, np.repeat(toe[None], len(claimed) - len(offsets), axis=0)]
    )
    centre = float(patch_distances([region.vertices_m], toe[None])[0])
    off = patch_distances([patch.vertices_m] * len(offsets), points[: len(offsets)])
    return max(centre, float(off.max()), float(length(claimed - points).max()))


def counts_of(limbs: tuple[Limb, ...] | tuple[Contact, ...]) -> tuple[int, ...]:
    """Number of points per foot; () where all have one."""
    counts = tuple(1 if limb.sole_m is None else len(limb.sole_m) for limb in limbs)
    return counts if max(counts) > 1 else ()


def forces_defect(whole: Array, points: Array, counts: tuple[int, ...]) -> str:
    """Fault of forces at points, shape (..., N, K, 3), of feet with forces (..., N, 3); empty if
    nothing.
    """
    with np.errstate(all="ignore"):  # absurd magnitudes are no sum, either
        most = float(np.abs(whole).max(initial=0.0) + np.abs(points).max(initial=0.0))
        off = float(np.abs(points.sum(axis=-2) - whole).max(initial=0.0))
    if not off <= POINTS_SUM * most or math.isinf(most):
        return "point_forces_n: expected forces that add up to forces_n"
    idle = np.arange(points.shape[-2]) >= np.array(counts)[:, None]
    if points[..., idle, :].any():
        return "point_forces_n: expected zeros after the points of a foot"
    return ""
