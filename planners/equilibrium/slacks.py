"""Distance of postures from their limits: the room that each kind of limit leaves them."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .batch import PointBatch, ScaledBatch

LIMITS = ("friction", "force", "reach", "body")
"""Kinds of limits: friction cones, bounds of the normal force, reach of the limbs, and the room of
the centre of mass."""


def slacks(
    scaled: ScaledBatch, points: PointBatch, half_spaces: list[tuple[Array, Array]]
) -> Array:
    """The least room per kind of limit, shape (B, len(``LIMITS``)), non-dimensional: of friction
    and force in units of the force scale, of reach and body in units of the length scale.

    Arguments:
        half_spaces: of reach, normals (K, 3) and bounds (K,) per limb.
    """
    one, forces = scaled.like, points.forces
    tangent = np.hypot(forces[..., 1], forces[..., 2])
    friction = (scaled.friction * forces[..., 0] - tangent).min(axis=1)
    force = np.minimum(
        one.force_max[:, 0] - forces[..., 0], forces[..., 0] - one.force_min[:, 0]
    ).min(axis=1)
    legs = points.legs(one)
    reach = (one.reach - np.linalg.norm(legs, axis=-1)).min(axis=1)
    local = points.toes - points.com[:, None]
    for limb, (normals, bounds) in enumerate(half_spaces):
        if len(bounds):
            back = local[:, limb] + np.cross(local[:, limb], points.rotation)  # (I − [Θ]×) p
            reach = np.minimum(reach, (bounds - back @ normals.T).min(axis=-1))
    body = one.com_radius[0] - np.linalg.norm(points.com - one.com[0], axis=-1)
    return np.stack([friction, force, reach, body], axis=-1)
