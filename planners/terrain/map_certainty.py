"""Certainty of the surfaces of a map or a cloud, from the noise of its heights and from their
number.
"""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .cells import GroundCells, Labels, block_squares, fitted, sums_of
from .certainty import Certainty

BLOCK_M = 0.08
"""Side of the blocks by whose means a surface is held against its plane: about what a foot and its
path need [m]."""
KNOWN = 4.0
"""The noise counts as much as so many blocks beside those of a surface."""
LEAST_STEP_M, BLURRED = 0.01, 1.5
"""A step lower than this is no edge to a foot [m]; and the most that noise moves an edge, in
samples' distances."""


def certainties(
    labels: Labels, cells: GroundCells, noise_m: float, margin_m: float
) -> list[Certainty]:
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
    """
    planes, _, _ = fitted(labels, cells)
    count = len(planes)
    if not count:
        return []
    spacing, (x, y) = cells.spacing_m, cells.places
    i, j = np.nonzero((labels >= 0) & cells.known)
    sums = sums_of(labels[i, j], cells.moments[:, i, j], count)
    one = np.maximum(sums[0], 1.0)
    middle = sums[1:3] / one
    squares, blocks = block_squares(labels, cells, planes, max(round(BLOCK_M / spacing), 1))
    freedom = np.maximum(blocks - 3.0, 0.0)
    mean_square = (KNOWN * noise_m**2 + squares) / (KNOWN + freedom)
    local = np.maximum(squares - freedom * noise_m**2, 0.0) / one
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
            2.0 * (noise_m / steps[k]) ** 2, BLURRED
        )  # where a step begins, in noisy samples
        result.append(
            Certainty(
                about_m=cells.corner_m[:2] + spacing * middle[:, k],
                covariance=mean_square[k] * covariance,
                rough_m=float(np.sqrt(local[k])),
                edge_sd_m=float(np.hypot(spacing / np.sqrt(12.0), blur)),
                inset_m=margin_m + 0.5 * spacing + blur,
            )
        )
    return result


def _steps(labels: Labels, level: Array, count: int) -> Array:
    """Height of the step at the border of each surface: the median over its neighbours, inf where a
    foot would not notice any, shape (count,) [m].
    """
    steps = np.full(count, np.inf)
    ours, off = list[Labels](), list[Array]()
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
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
    steps[some] = height[(first[some] + last[some]) // 2]
    return steps
