"""Are the footholds of a plan pieces of its terrain? A candidate that hangs in the air carries
nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..files.arrays import Array
from ..terrain.certainty import Certainty
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes
from .geometry import patch_distances

THICK_M = 1e-3
"""A toe so far from the terrain stands on it, as in walks [m]: rounded files, merged facets."""
SAME_WAY = float(np.cos(0.02))
"""Cosine between normals of a foothold and of the terrain under it: more than a mesh's facets
differ, 1 % of a cone."""
ROUGHER = 1e-9
"""Of friction: what rounding makes of it."""
AROUND, FAR_M = 64, 0.3
"""Ways from a toe along which the border of its surface is looked for, and how far [m]."""


def off_terrain(terrain: Sequence[Patch], patches: Sequence[Patch], toes: Array) -> Array:
    """Distance of every toe from terrain that is as rough as its patch and faces as it does, beyond
    ``THICK_M``; on a map, from where a surface is known, which goes on for bodies to keep out of.

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
    near = list[list[int]]()
    for patch, toe in zip(patches, toes, strict=True):
        bears = (normals @ patch.normal >= SAME_WAY) & (friction >= patch.friction - ROUGHER)
        about = np.where(
            bears,
            np.linalg.norm(np.maximum(low - toe, 0.0) + np.maximum(toe - high, 0.0), axis=1),
            np.inf,
        )
        most = max(THICK_M, float(about.min()))
        near.append(np.flatnonzero(bears & (about <= most)).tolist())
    distances, counts = np.full(len(toes), np.inf), [len(each) for each in near]
    if not any(counts):
        return distances
    gaps = patch_distances(
        [terrain[i].vertices_m for each in near for i in each], np.repeat(toes, counts, axis=0)
    )
    for p, off in enumerate(np.split(np.maximum(0.0, gaps - THICK_M), np.cumsum(counts)[:-1])):
        if not len(off):
            continue
        for k in np.flatnonzero(off <= float(off.min())).tolist():
            if (sure := terrain[near[p][k]].certainty) is not None:
                off[k] = max(float(off[k]), sure.wider_m - border_m(terrain, near[p][k], toes[p]))
        distances[p] = float(off.min())
    return distances


def certainty_under(
    terrain: Sequence[Patch], patch: Patch, toe: Array
) -> tuple[Certainty, float] | None:
    """The terrain's certainty of the surface that a toe stands on, and the distance of the toe
    inside of where the surface's edge most likely is [m]; None where it does not say so.
    """
    near = [
        (gap, i)
        for i, other in enumerate(terrain)
        if other.certainty is not None
        and not other.certainty.exact
        and other.normal @ patch.normal >= SAME_WAY
        and abs(gap := float(other.normal @ (toe - other.vertices_m[0]))) <= THICK_M
        and (gap := float(patch_distances([other.vertices_m], toe[None])[0])) <= THICK_M
    ]
    if not near:
        return None
    _, first = min(near)
    sure = terrain[first].certainty
    assert sure is not None
    return sure, border_m(terrain, first, toe) - sure.wider_m


def border_m(terrain: Sequence[Patch], first: int, toe: Array) -> float:
    """Distance of a toe to the border of the surface that a patch is a piece of, ``FAR_M`` at most [m].

    Arguments:
        first: number of the patch.
        toe: in the patch, shape (3,) [m].
    """
    patch, angles = terrain[first], np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    ways, axes = np.stack([np.cos(angles), np.sin(angles)]), patch.frame[:, 1:]
    begins, ends = list[Array](), list[Array]()
    for other in terrain:
        if not _same_surface(patch, other) or np.any(other.vertices_m.min(axis=0) > toe + FAR_M):
            continue
        if np.any(other.vertices_m.max(axis=0) < toe - FAR_M):
            continue
        normals, offsets = half_planes((other.vertices_m - toe) @ axes)
        along = normals @ ways
        with np.errstate(divide="ignore", invalid="ignore"):
            reached = offsets[:, None] / along
        begins.append(np.max(np.where(along < 0.0, reached, -np.inf), axis=0))
        ends.append(np.min(np.where(along > 0.0, reached, np.inf), axis=0))
    begin, end, out = np.array(begins), np.array(ends), np.zeros(AROUND)
    for _ in begins:
        meets = (begin <= out + THICK_M) & (begin <= end)
        out = np.maximum(out, np.max(np.where(meets, end, 0.0), axis=0))
    return float(min(out.min(), FAR_M))


def _same_surface(one: Patch, other: Patch) -> bool:
    """Tell whether two patches are pieces of one surface of a map."""
    if one.certainty is None or other.certainty is None:
        return one is other
    return bool(
        np.array_equal(one.certainty.about_m, other.certainty.about_m)
        and np.array_equal(one.certainty.covariance, other.certainty.covariance)
        and one.normal @ other.normal >= 1.0 - 1e-9
        and abs(one.normal @ (other.vertices_m[0] - one.vertices_m[0])) <= THICK_M
    )
