"""Depth of the solids of a mesh behind its facets: what lies behind a facet is no thicker than its solid, or bars and
plates would come out on their other side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..files.arrays import Array
from .facets import shapely_module
from .patch import Patch
from .prism import THICKNESS_M
from .triangle_mesh import TriangleMesh

THINNEST_M = 0.008
"""What is behind a facet is no thinner [m]."""
INWARD = 0.1
"""Depths are looked at in the middle of a patch and so far from its corners towards it."""
BEGIN_M = 1e-4
"""Triangles that are no deeper are of the facet itself [m]."""
PAIRS = 2_000_000
"""Rays and triangles that are looked at together, at most."""


def with_depths(patches: Sequence[Patch], mesh: TriangleMesh) -> tuple[Patch, ...]:
    """Patches of a mesh, those as thin as their solid whose solid is thinner than usual."""
    if not patches:
        return ()
    places = list[Array]()
    for patch in patches:
        middle = patch.centre_m
        places.append(np.vstack([middle, patch.vertices_m + INWARD * (middle - patch.vertices_m)]))
    owner = np.repeat(np.arange(len(patches)), [len(each) for each in places])
    ways = -np.array([patch.normal for patch in patches])[owner]
    depths = np.full(len(patches), np.inf)
    np.minimum.at(depths, owner, _depths(np.concatenate(places), ways, mesh.spread_m))
    return tuple(
        patch.with_thickness(max(depth, THINNEST_M)) if depth < THICKNESS_M else patch
        for patch, depth in zip(patches, depths.tolist(), strict=True)
    )


def _depths(places: Array, ways: Array, corners: Array) -> Array:
    """Distance of places along unit vectors to the first triangle that faces the same way, inf where there is none
    within ``THICKNESS_M``, shape (K,) [m].
    """
    shapely = shapely_module()
    low, high = corners.min(axis=1), corners.max(axis=1)
    tree = shapely.STRtree(shapely.box(*low[:, :2].T, *high[:, :2].T))
    ends, depths = places + THICKNESS_M * ways, np.full(len(places), np.inf)
    least, most = np.minimum(places, ends), np.maximum(places, ends)
    boxes = shapely.box(*least[:, :2].T, *most[:, :2].T)
    step = max(1, min(len(places), PAIRS // max(len(corners) // 50, 1)))
    for begin in range(0, len(places), step):
        ray, triangle = tree.query(boxes[begin : begin + step])
        ray = ray + begin
        near = (low[triangle, 2] <= most[ray, 2]) & (high[triangle, 2] >= least[ray, 2])
        ray, triangle = ray[near], triangle[near]
        a, b, c = np.moveaxis(corners[triangle], 1, 0)
        normal, way = np.cross(b - a, c - a), ways[ray]
        along = np.vecdot(normal, way)
        out = along > 1e-6 * np.sqrt(np.vecdot(normal, normal))
        ray, way, a, b, c, normal, along = (
            each[out] for each in (ray, way, a, b, c, normal, along)
        )
        depth = np.vecdot(normal, a - places[ray]) / along
        hit = places[ray] + depth[:, None] * way
        inside = (depth > BEGIN_M) & (depth < THICKNESS_M)
        for one, other in ((a, b), (b, c), (c, a)):
            inside &= np.vecdot(np.cross(other - one, hit - one), normal) >= 0.0
        np.minimum.at(depths, ray[inside], depth[inside])
    return depths
