"""Certainty of the surfaces of a map or a cloud, from the noise of its heights and from their
number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..files.arrays import Array
from .correlation import (
    GroundCells,
    Labels,
    block_squares,
    boxed,
    fitted,
    residuals,
    sums_of,
    sums_off,
)
from .elevation import BESIDE
from .footholds import TerrainPatch
from .patch import Certainty
from .polygon import half_planes

_BLOCK_M = 0.08
"""Side of the blocks by whose means a surface is held against its plane: about what a foot and its
path need [m]."""
_PATH_M = 0.15
"""Side of the squares of cells by which a piece is held against its plane, 3 cells at least [m]."""
_UNSEEN = 0.5
"""How many of its own deviations the mean square of what a piece is off its plane may be larger than it seems."""
_KNOWN = 4.0
"""The noise counts as much as so many blocks beside those of a surface."""
LEVEL_M = 1e-3
"""Exact heights that are off their plane by no more are on it to a foot [m]."""
LEAST_STEP_M, _BLURRED = 0.01, 1.5
"""A step lower than this is no edge to a foot [m]; and the most that noise moves an edge, in
samples' distances."""


def certainties(
    labels: Labels,
    cells: GroundCells,
    noise_m: float,
    margin_m: float,
    shape_m: float = 0.0,
    *,
    looked: bool = False,
) -> Sequence[Certainty | None]:
    """The certainty of each surface.

    Means over blocks of a surface are off its plane by the noise of means alone where it is a plane
    and its noise is white. What they are off beyond that, by correlated noise, bends and foreign
    samples, makes the plane less sure, as every block counts for one, and it is how far the ground
    is off the plane here and there.

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        cells: the samples.
        noise_m: deviation of a sample [m].
        margin_m: of footholds from the borders [m].
        shape_m: deviation of bumps that are a sensor's noise or the ground's shape, and of steps that are not seen
            [m].
        looked: whether what correlated noise may hide was looked for; else all of it may be the
            ground's shape.
    """
    planes, _, _ = fitted(labels, cells)
    count = len(planes)
    if not count:
        return []
    spacing, (x, y) = cells.spacing_m, cells.places
    i, j = np.nonzero((labels >= 0) & cells.known)
    sums = sums_of(labels[i, j], cells.moments[:, i, j], count)
    one = np.maximum(sums[0], cells.weight)
    middle = sums[1:3] / one
    squares, blocks = block_squares(labels, cells, planes, max(round(_BLOCK_M / spacing), 1))
    freedom = np.maximum(blocks - 3.0, 0.0)
    mean_square = (_KNOWN * noise_m**2 + squares) / (_KNOWN + freedom)
    if cells.weight < 1.0:  # blocks are not wider than the noise is alike
        mean_square = np.maximum(mean_square, noise_m**2)
    each = 1.0 if looked else 1.0 / cells.weight
    local = np.maximum(each * squares - freedom * noise_m**2, 0.0) / (each * one)
    xx, xy, yy = spacing**2 * np.stack(
        [
            sums[3] - one * middle[0] ** 2,
            sums[4] - one * middle[0] * middle[1],
            sums[5] - one * middle[1] ** 2,
        ]
    )
    of = np.maximum(labels, 0)
    steps = _steps(labels, planes[of, 0] * x + planes[of, 1] * y + planes[of, 2], count)
    result = []
    for k in range(count):
        matrix = np.array([[xx[k], xy[k]], [xy[k], yy[k]]]) + 1e-3 * spacing**2 * np.eye(2)
        covariance = np.zeros((3, 3))
        covariance[0, 0], covariance[1:, 1:] = 1.0 / one[k], np.linalg.inv(matrix)
        blur = spacing * min(
            2.0 * (noise_m / steps[k]) ** 2, _BLURRED
        )  # where a step begins, in noisy samples
        result.append(
            Certainty(
                about_m=cells.corner_m[:2] + spacing * middle[:, k],
                covariance=mean_square[k] * covariance,
                rough_m=float(np.hypot(np.sqrt(local[k]), shape_m)),
                edge_sd_m=float(np.hypot(spacing / np.sqrt(12.0), blur)),
                inset_m=margin_m + 0.5 * spacing + blur,
            )
        )
    return result


def roughnesses(
    labels: Labels, cells: GroundCells, margin_m: float, planes: Array, rms: Array
) -> Sequence[Certainty | None]:
    """The certainty of each surface of exact heights: how far they are off its plane; None where
    that is nothing to a foot.

    Arguments:
        planes, rms: of each surface, as ``fitted`` gives them.
    """
    own, largest = labels >= 0, np.zeros(len(planes))
    np.maximum.at(largest, labels[own], np.abs(residuals(labels, cells, planes))[own])
    return [
        None
        if largest[k] <= LEVEL_M
        else Certainty(
            about_m=cells.corner_m[:2],
            covariance=np.zeros((3, 3)),
            rough_m=float(rms[k]),
            inset_m=margin_m + 0.5 * cells.spacing_m,
        )
        for k in range(len(planes))
    ]


def excess_squares(
    labels: Labels, cells: GroundCells, noise_m: float, *, looked: bool = False
) -> Array:
    """Squared means, over about a foot's path, of each surface's deviation from its plane, less
    those of the noise; and those of the noise, shape (2, n, m) [m²], 0 where no deviation can hide
    in them.
    """
    side = max(2 * round(0.5 * _PATH_M / cells.spacing_m) + 1, 3)
    count, off = boxed(sums_off(labels, cells), side)
    count = np.maximum(count, cells.weight)
    chance = noise_m**2 / count
    return np.stack([(off / count) ** 2 - chance, 0.0 * chance if looked else chance])


def with_local(
    pieces: Sequence[TerrainPatch], labels: Labels, cells: GroundCells, excess_m2: Array
) -> list[TerrainPatch]:
    """Pieces of a surface as rough as the ground is off the plane within each, if that is more.

    Arguments:
        labels: the surface of each cell, shape (n, m).
        excess_m2: as of ``excess_squares``.
    """
    result = []
    for piece in pieces:
        inside = _cells_in(piece, labels, cells)
        off_m2, chance_m2 = excess_m2[:, *inside.T].mean(axis=1) if len(inside) else (0.0, 0.0)
        paths = max(len(inside) * (cells.spacing_m / _PATH_M) ** 2, 1.0)
        rough_m2 = max(off_m2 + _UNSEEN * chance_m2 * np.sqrt(2.0 / paths), 0.0)
        result.append(_no_smoother(piece, float(np.sqrt(rough_m2))))
    return result


def with_largest(
    pieces: Sequence[TerrainPatch], labels: Labels, cells: GroundCells, plane: Array
) -> list[TerrainPatch]:
    """Pieces of a surface of exact heights, the largest that those of each are off the plane three
    deviations of its roughness, if that is more.

    Arguments:
        labels: the surface of each cell, shape (n, m).
        plane: a, b, c of a x + b y + c in cells, shape (3,).
    """
    result = []
    for piece in pieces:
        i, j = _cells_in(piece, labels, cells).T
        off = np.abs(plane[0] * i + plane[1] * j + plane[2] - cells.heights[i, j])
        result.append(_no_smoother(piece, float(off.max(initial=0.0)) / 3.0))
    return result


def _cells_in(piece: TerrainPatch, labels: Labels, cells: GroundCells) -> Labels:
    """Indices of a surface's cells within a cell of a piece, shape (K, 2)."""
    corners = (piece.patch.vertices_m[:, :2] - cells.corner_m[:2]) / cells.spacing_m
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.ceil(corners.max(axis=0)).astype(int) + 2
    normals, offsets = half_planes(corners)
    own = labels[low[0] : high[0], low[1] : high[1]] == piece.surface
    places = np.stack(np.nonzero(own), axis=-1) + low
    return np.asarray(places[np.all(places @ normals.T <= offsets + 1.0, axis=1)])


def _no_smoother(piece: TerrainPatch, rough_m: float) -> TerrainPatch:
    """A piece that is so rough at the least [m]."""
    certainty = piece.patch.certainty
    assert certainty is not None
    certainty = replace(certainty, rough_m=max(certainty.rough_m, rough_m))
    return replace(piece, patch=piece.patch.with_certainty(certainty))


def _steps(labels: Labels, level: Array, count: int) -> Array:
    """Height of the step at the border of each surface: the lower quartile over its neighbours, inf where a
    foot would not notice any, shape (count,) [m].
    """
    steps = np.full(count, np.inf)
    ours, off = list[Labels](), list[Array]()
    for one, other in BESIDE:
        for a, b in ((one, other), (other, one)):
            differ = (labels[a] != labels[b]) & (labels[a] >= 0) & (labels[b] >= 0)
            differ &= np.abs(level[b] - level[a]) > LEAST_STEP_M
            ours.append(labels[a][differ])
            off.append(np.abs(level[b] - level[a])[differ])
    owner, height = np.concatenate(ours), np.concatenate(off)
    order = np.lexsort((height, owner))
    owner, height = owner[order], height[order]
    first = np.searchsorted(owner, np.arange(count))
    last = np.searchsorted(owner, np.arange(count), side="right")
    some = last > first
    steps[some] = height[first[some] + (last[some] - first[some]) // 4]
    return steps
