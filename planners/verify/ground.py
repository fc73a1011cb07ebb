"""Are the footholds of a plan pieces of its terrain? A candidate that hangs in the air carries
nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..files.arrays import Array
from ..terrain.patch import Patch
from .geometry import patch_distances

THICK_M = 1e-3
"""A toe so far from the terrain stands on it, as in walks [m]: rounded files, merged facets."""
SAME_WAY = float(np.cos(0.02))
"""Cosine between normals of a foothold and of the terrain under it: more than a mesh's facets
differ, 1 % of a cone."""
ROUGHER = 1e-9
"""Of friction: what rounding makes of it."""


def off_terrain(terrain: Sequence[Patch], patches: Sequence[Patch], toes: Array) -> Array:
    """Distance of every toe from terrain that is as rough as its patch and faces as it does, beyond
    ``THICK_M``.

    Arguments:
        patches: the one that each toe chose.
        toes: shape (P, 3) [m].

    Returns:
        Shape (P,) [m], inf where there is none.
    """
    if not terrain:
        return np.full(len(toes), np.inf)
    normals, friction = (
        np.array([patch.normal for patch in terrain]),
        np.array([patch.friction for patch in terrain]),
    )
    low = np.array([patch.vertices_m.min(axis=0) for patch in terrain])
    high = np.array([patch.vertices_m.max(axis=0) for patch in terrain])
    distances = np.full(len(toes), np.inf)
    for p, (patch, toe) in enumerate(zip(patches, toes, strict=True)):
        bears = (normals @ patch.normal >= SAME_WAY) & (friction >= patch.friction - ROUGHER)
        if not bears.any():
            continue
        about = np.where(
            bears,
            np.linalg.norm(np.maximum(low - toe, 0.0) + np.maximum(toe - high, 0.0), axis=1),
            np.inf,
        )
        near = np.flatnonzero(about <= max(THICK_M, float(about.min()))).tolist()
        gaps = patch_distances(
            [terrain[i].vertices_m for i in near], np.repeat(toe[None], len(near), axis=0)
        )
        distances[p] = max(0.0, float(gaps.min()) - THICK_M)
    return distances
