"""Heights of patches for walks: tops as they are, and beyond their edges as far as a foot of some
size rolls off.

A patch stays in its place to its very edge. Beyond it the surface bends down over the radius of a
foot, then falls at a slope that a spline of this spacing can hold, to the next surface or to the
bottom. So a lower surface is wrong only near a higher one, by less than the drop over ``SLOPE``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..files.arrays import Array
from .heightfield import HeightField
from .patch import Patch
from .polygon import EDGE_M, UPRIGHT, VOID_M, nearest

ROUND_M, SLOPE = 0.03, 3.0
"""Radius of an edge, about that of a foot [m], and gradient of what falls beyond it (72°)."""
SPACING_M = 0.025
"""Spacing of the grid [m]."""
FIRST_M = 0.15
"""Distance from a patch at which its fall is looked at first; twice as far as long as it is above
all else [m]."""


def rounded(
    patches: Sequence[Patch],
    low_m: Array | None = None,
    high_m: Array | None = None,
    *,
    name: str = "",
) -> HeightField | None:
    """The highest surface over a rectangle, rounded beyond edges; None where no patch faces up.

    Arguments:
        low_m, high_m: corners of the rectangle, shape (2,), by the patches where they are missing
            [m].
        name: of the field.
    """
    up = [patch for patch in patches if patch.normal[2] >= UPRIGHT]
    if not up:
        return None
    corners = np.concatenate([patch.vertices_m for patch in up])
    low = corners[:, :2].min(axis=0) if low_m is None else low_m
    high = corners[:, :2].max(axis=0) if high_m is None else high_m
    x, y = (
        np.linspace(a, b, max(4, round(float(b - a) / SPACING_M) + 1))
        for a, b in zip(low, high, strict=True)
    )
    heights = np.full((len(x), len(y)), min(VOID_M, float(corners[:, 2].min())))
    for patch in up:
        _raise_to(heights, x, y, patch, 0.0)
    for patch in up:
        reach = FIRST_M
        while _raise_to(heights, x, y, patch, reach):
            reach *= 2.0
    return HeightField(x, y, heights, name)


def _raise_to(heights: Array, x: Array, y: Array, patch: Patch, reach_m: float) -> bool:
    """Raise the grid to a patch and what falls off from it within a reach; whether it was raised at
    the end of that.
    """
    corners = patch.vertices_m[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = reach_m + EDGE_M
    i, j = (
        slice(*np.searchsorted(line, (a - room, b + room)))
        for line, a, b in zip((x, y), low, high, strict=True)
    )
    if i.start == i.stop or j.start == j.stop:
        return False
    places = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1)
    upright = len(corners) == 4 and bool(np.all((corners == low) | (corners == high)))
    on = (
        np.clip(places, low, high) if upright else nearest(corners, places)
    )  # most are rectangles along the axes
    beyond = np.sqrt(((places - on) ** 2).sum(axis=-1))
    lifted = patch.centre_m[2] - (on - patch.centre_m[:2]) @ patch.normal[:2] / patch.normal[2]
    lifted -= SLOPE * (np.sqrt(beyond**2 + ROUND_M**2) - ROUND_M)
    raised = (lifted > heights[i, j]) & (beyond <= room)
    heights[i, j] = np.where(raised, lifted, heights[i, j])
    return reach_m > 0.0 and bool(np.any(raised & (beyond > reach_m - 2.0 * SPACING_M)))
