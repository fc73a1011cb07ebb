"""Boxes that stand on the ground of a map, or hang over that of a cloud: a map holds one height per
cell, so that footholds alone are surfaces of it, and walls, poles and bars overhead would be
nothing.

1. Points of a cloud over a free height of ``_FREE_M`` hang over the ground; what is below them is the ground there.
2. Cells that are far above a neighbour, or narrower than their height lets a foot stand on, are solid down to the
   ground beside them.
3. Solid cells of about one height are covered by rectangles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from ..files.arrays import Array
from .elevation import ElevationMap
from .patch import Patch
from .polygon import half_planes

_FREE_M = 0.25
"""Points of a column with so much free height below them hang over the ground [m]."""
_SAME_M = 0.1
"""The ground below what hangs over it differs by no more from that of the cells beside it [m]."""
_BESIDES = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))
_ROUNDS = 3
"""So many cells from ground that is seen below something the ground below it may be unseen."""
_BESIDE = 2
"""What hangs over the ground does so in so many of the eight cells beside it: single points are
noise."""
_WALL_M = 0.3
"""Cells so far above one beside them have sides that bodies run into [m]."""
_NARROW_M, _HIGH_M, _NOISES = 0.25, 0.1, 6.0
"""What is narrower and so far above the ground to both sides is solid [m]; more, by so many
deviations, where there is noise. Heights within as many of a surface are on it: of a hundred thousand one is
four off."""
_ALIKE_M = (0.05, 0.2, np.inf)
"""Cells whose tops and bottoms differ by no more are covered by one box [m]: the first with which
there are no more than ``_MOST_BOXES``."""
_MOST_BOXES = 300
_SUNK_M = 0.01
"""Boxes on the ground end so far below their highest point, where feet may stand [m]."""
_APART_M = 5e-4
"""Between neighbouring boxes, so that each is a body of its own [m]."""
ROOM = 0.5
"""In a cloud in which more than this share of the ground has something over it, the ground is
below."""
_REACH_M = 0.5
"""Width of the ground beside what hangs over it, which is looked at together [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overhead:
    """A cloud in two layers.

    Arguments:
        ground_m: all points that hang over nothing, shape (K, 3) [m].
        beside_m: those of them below and near what hangs over them, shape (K', 3) [m].
        boxes_m: what hangs over the ground, each box x, y and z from and to, shape (B, 6) [m].
        share: of the cells that have something over them.
    """

    ground_m: Array
    beside_m: Array
    boxes_m: Array
    share: float

    @classmethod
    def of(cls, points_m: Array, spacing_m: float) -> Overhead | None:
        """Points that hang over the ground of a cloud; None for nothing."""
        places = np.round(points_m[:, :2] / spacing_m).astype(np.int64)
        first = places.min(axis=0)
        shape = tuple((places.max(axis=0) - first + 1).tolist())
        cell = np.ravel_multi_index(tuple((places - first).T), shape)
        order = np.lexsort((points_m[:, 2], cell))
        cell, z = cell[order], points_m[order, 2]
        new = np.append(True, cell[1:] != cell[:-1])
        gap = np.append(False, z[1:] - z[:-1] >= _FREE_M) & ~new
        if not gap.any():
            return None
        begins = np.flatnonzero(new)
        above = np.cumsum(gap)
        above = above - np.repeat(
            above[begins], np.diff(np.append(begins, len(z)))
        )  # gaps below, in the column
        floor = np.full(shape[0] * shape[1], np.nan)
        last = (above == 0) & np.append((cell[1:] != cell[:-1]) | gap[1:], True)
        floor[cell[last]] = z[last]
        under = np.zeros(len(floor), dtype=bool)
        under[cell[gap]] = True
        under = _together(under.reshape(shape), floor.reshape(shape)).ravel()
        if not under.any():
            return None
        lowest = np.full(len(floor), np.nan)
        lowest[cell[begins]] = z[begins]
        unseen = _unseen(under.reshape(shape), floor.reshape(shape), lowest.reshape(shape)).ravel()
        above = above + unseen[cell]
        hangs = (above > 0) & (under | unseen)[cell]
        under |= unseen
        near = binary_dilation(
            under.reshape(shape), iterations=max(1, round(_REACH_M / spacing_m))
        ).ravel()
        corner = (first - 0.5) * spacing_m
        boxes = list[Array]()
        for number in range(1, int(above[hangs].max()) + 1):
            cells_here = hangs & (above == number)
            bottom, top = np.full(len(floor), np.inf), np.full(len(floor), -np.inf)
            np.minimum.at(bottom, cell[cells_here], z[cells_here])
            np.maximum.at(top, cell[cells_here], z[cells_here])
            bottom, top = _as_beside(bottom.reshape(shape)), -_as_beside(-top.reshape(shape))
            boxes.append(covered(bottom, top, corner, spacing_m))
        ground = order[~hangs]
        return cls(
            ground_m=points_m[np.sort(ground)],
            beside_m=points_m[np.sort(order[~hangs & near[cell]])],
            boxes_m=np.concatenate(boxes),
            share=float(under.sum() / np.isfinite(floor).sum()),
        )


def _as_beside(bottom: Array) -> Array:
    """Bottoms of cells, as low as those beside them where these are about as low: a cell shows few
    points.
    """
    beside = minimum_filter(bottom, size=3, mode="nearest")
    with np.errstate(invalid="ignore"):
        alike = np.isfinite(bottom) & (bottom - beside <= 1.5 * _SAME_M)
    return np.where(alike, beside, bottom)


def _together(under: NDArray[np.bool_], floor: Array) -> NDArray[np.bool_]:
    """Cells that have such neighbours whose ground is as high."""
    while True:
        beside = np.zeros(under.shape)
        padded, known = np.pad(floor, 1, constant_values=np.nan), np.pad(under, 1)
        n, m = under.shape
        for i, j in _BESIDES:
            here = np.s_[1 + i : 1 + i + n, 1 + j : 1 + j + m]
            with np.errstate(invalid="ignore"):
                even = np.abs(padded[here] - floor) <= _SAME_M
            beside += known[here] & even
        left = under & (beside >= _BESIDE)
        if left.sum() == under.sum():
            return left
        under = left


def _unseen(under: NDArray[np.bool_], floor: Array, lowest: Array) -> NDArray[np.bool_]:
    """Cells among those with something over the ground, of which all points are over the ground
    beside them.
    """
    unseen = np.zeros(under.shape, dtype=bool)
    for _ in range(_ROUNDS):
        count, height = np.zeros(under.shape), np.zeros(under.shape)
        known = np.pad(under, 1), np.pad(np.where(under, floor, 0.0), 1)
        n, m = under.shape
        for i, j in _BESIDES:
            here = np.s_[1 + i : 1 + i + n, 1 + j : 1 + j + m]
            count += known[0][here]
            height += known[1][here]
        with np.errstate(invalid="ignore", divide="ignore"):
            more = ~under & ~unseen & (count > _BESIDE) & (lowest - height / count > _FREE_M)
        if not more.any():
            break
        floor, under, unseen = (
            np.where(more, height / np.maximum(count, 1.0), floor),
            under | more,
            unseen | more,
        )
    return unseen


def on_surfaces(terrain: ElevationMap, surfaces: Sequence[Patch], noise_m: float) -> ElevationMap:
    """A map whose cells on its surfaces are as high as these are, and those beside them no higher: a single height is
    off its surface by the noise, and a box as high as the highest of its cells would hide the surface.

    Arguments:
        noise_m: deviation of the heights [m].
    """
    heights, near = terrain.heights_m, np.full(terrain.heights_m.shape, _NOISES * noise_m)
    level = np.array(heights)
    for patch in surfaces:
        corners, normal = patch.vertices_m, patch.normal
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        beside = terrain.spacing_m + 1e-9
        i, j = (
            slice(*np.searchsorted(line, [a - beside, b + beside]))
            for line, a, b in zip((terrain.x_m, terrain.y_m), low, high, strict=True)
        )
        x, y = terrain.x_m[i, None], terrain.y_m[None, j]
        normals, offsets = half_planes(corners[:, :2])
        out = [u * x + v * y - offset for (u, v), offset in zip(normals, offsets, strict=True)]
        beyond = np.max(out, axis=0)
        plane = (
            corners[0, 2]
            - ((x - corners[0, 0]) * normal[0] + (y - corners[0, 1]) * normal[1]) / (normal[2])
        )
        off = np.abs(plane - heights[i, j])
        with np.errstate(invalid="ignore"):
            over = (beyond <= beside) & (heights[i, j] > plane)
            closer = (over | (beyond <= 1e-9)) & (off <= near[i, j])
        level[i, j] = np.where(closer, plane, level[i, j])
        near[i, j] = np.where(closer, off, near[i, j])
    return replace(terrain, heights_m=level)


def standing_boxes(terrain: ElevationMap, noise_m: float) -> Array:
    """Boxes of walls, poles and rails of a map, each x, y and z from and to, shape (B, 6) [m]."""
    heights, spacing = terrain.heights_m, terrain.spacing_m
    known = np.isfinite(heights)
    one = max(1, round(0.05 / spacing))
    low = np.where(known, heights, np.inf)
    beside = minimum_filter(low, size=2 * one + 1, mode="nearest")
    wide = max(3, 2 * int(_NARROW_M / spacing / 2) + 1)
    ground = np.pad(known, wide, constant_values=True)  # as if the ground went on beyond the border
    lowest = minimum_filter(np.pad(low, wide, constant_values=np.inf), size=wide)
    lowest = np.where(ground & np.isfinite(lowest), lowest, -np.inf)
    opened = maximum_filter(lowest, size=wide)[wide:-wide, wide:-wide]
    with np.errstate(invalid="ignore"):
        wall = known & (heights - beside > max(_WALL_M, _NOISES * noise_m))
        narrow = known & (heights - opened > max(_HIGH_M, _NOISES * noise_m))
    solid = wall | narrow
    floor = np.minimum(beside, np.where(narrow, opened, np.inf))
    bottom, top = np.where(solid, floor, np.inf), np.where(solid, heights - _SUNK_M, -np.inf)
    corner = np.array([terrain.x_m[0], terrain.y_m[0]]) - 0.5 * spacing
    return covered(bottom, top, corner, spacing)


def covered(bottom: Array, top: Array, corner: Array, spacing: float) -> Array:
    """Boxes over cells from a bottom to a top, −inf where there is none, each of cells that are
    about alike, shape (B, 6).
    """
    for axis in (0, 1):  # a gap of one cell is closed
        before, after = (
            (np.roll(each, 1, axis), np.roll(each, -1, axis)) for each in (bottom, top)
        )
        low, high = (np.stack(pair) for pair in (before, after))
        gap = ~np.isfinite(top) & np.isfinite(high).all(axis=0)
        np.moveaxis(gap, axis, 0)[[0, -1]] = False
        bottom, top = np.where(gap, low.min(axis=0), bottom), np.where(gap, high.max(axis=0), top)
    boxes = np.zeros((0, 6))
    for alike in _ALIKE_M:
        boxes = np.array(list(_rectangles(bottom, top, alike)), dtype=np.float64).reshape(-1, 6)
        if len(boxes) <= _MOST_BOXES:
            break
    boxes[:, :2] = corner[0] + spacing * boxes[:, :2] + [_APART_M, -_APART_M]
    boxes[:, 2:4] = corner[1] + spacing * boxes[:, 2:4] + [_APART_M, -_APART_M]
    boxes[:, 5] = np.maximum(boxes[:, 5], boxes[:, 4] + 2.0 * _SUNK_M)
    return boxes


def _rectangles(bottom: Array, top: Array, alike: float) -> Iterator[tuple[float, ...]]:
    """Rectangles of cells whose bottoms and tops are within ``alike``: as long as they can be along
    one axis, then as wide; from and to in cells, then the lowest bottom and the highest top.
    """
    left = np.isfinite(top)
    for i, j in np.argwhere(left).tolist():
        if not left[i, j]:
            continue
        rows, columns = 1, 1
        for along in (0, 1) if _run(left, i, j, 0) >= _run(left, i, j, 1) else (1, 0):
            while True:
                more = rows + (along == 0), columns + (along == 1)
                if i + more[0] > left.shape[0] or j + more[1] > left.shape[1]:
                    break
                window = np.s_[i : i + more[0], j : j + more[1]]
                if (
                    not left[window].all()
                    or max(np.ptp(bottom[window]), np.ptp(top[window])) > alike
                ):
                    break
                rows, columns = more
        window = np.s_[i : i + rows, j : j + columns]
        left[window] = False
        yield i, i + rows, j, j + columns, float(bottom[window].min()), float(top[window].max())


def _run(left: NDArray[np.bool_], i: int, j: int, axis: int) -> int:
    """Number of cells from one on along an axis."""
    line = left[i:, j] if axis == 0 else left[i, j:]
    return int(len(line) if line.all() else line.argmin())


def box_patches(boxes_m: Array, friction: float) -> list[Patch]:
    """The six sides of every box."""
    patches = list[Patch]()
    for x0, x1, y0, y1, z0, z1 in boxes_m.tolist():
        low, high = np.array([x0, y0, z0]), np.array([x1, y1, z1])
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for end, sign in ((low, -1.0), (high, 1.0)):
                corners = np.tile(end, (4, 1))
                corners[:, u] = [low[u], high[u], high[u], low[u]]
                corners[:, v] = [low[v], low[v], high[v], high[v]]
                normal = np.zeros(3)
                normal[axis] = sign
                patches.append(
                    Patch(
                        vertices_m=corners,
                        normal=normal,
                        shear_reference=np.eye(3)[u],
                        friction=friction,
                    )
                )
    return patches
