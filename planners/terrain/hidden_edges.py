"""Edges within surfaces of correlated noise, which is smooth where it reaches over several samples: a step that is
lower than the noise still stands out of it.

The height of a step, and the turn of a crease, along the middle of a window of heights is estimated by generalised
least squares beside a plane, with the covariance of the noise, and held against its own deviation.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate, maximum_filter, minimum_filter

from ..files.arrays import Array
from .cells import GroundCells, Labels, boxed, residuals
from .correlation import Noise

WINDOW_M, FEWEST = 0.06, 2
"""Half width of the window that a step is looked for in [m], and the fewest cells."""
SEEN = 4.0
"""Steps are seen that are so many deviations high."""
RESIDUE = 0.02
"""Share of the variance that is taken for white at least: no noise is as smooth as its model."""
MEDIAN, ENOUGH = 0.6745, 40
"""Half of all values of a normal distribution are within so many deviations; and the number of
windows from which the deviation is estimated."""


def half_window(spacing_m: float) -> int:
    """Half width of the window in cells."""
    return max(round(WINDOW_M / spacing_m), FEWEST)


def windows(noise: Noise, spacing_m: float) -> Iterator[tuple[Array, float]]:
    """Weights of the heights in windows, shape (h, w), whose sum is the height of a step along the
    middle, in four directions; and the deviation of this height by the noise [m].
    """
    half = half_window(spacing_m)
    between, whole = np.arange(-half, half) + 0.5, np.arange(-half, half + 1.0)
    for rows, turned in ((between, False), (whole, True)):
        i, j = spacing_m * np.stack(np.meshgrid(rows, whole, indexing="ij"))
        step = 0.5 * np.sign(np.round((i + j if turned else i) / spacing_m, 3))
        weights, deviation = _weights(i.ravel(), j.ravel(), step.ravel(), noise)
        weights = weights.reshape(i.shape)
        yield weights, deviation
        yield weights[::-1] if turned else weights.T, deviation


def _weights(x: Array, y: Array, edge: Array, noise: Noise) -> tuple[Array, float]:
    """Weights that estimate the size of an edge beside a plane with the least variance, and the
    standard deviation that the noise leaves to this estimate [m].
    """
    apart = ((x[:, None] - x) ** 2 + (y[:, None] - y) ** 2) / noise.length_m**2
    smooth = min(noise.correlated, 1.0 - RESIDUE)
    covariance = smooth * np.exp(-apart) + (1.0 - smooth) * np.eye(len(x))
    terms = np.column_stack([edge, np.ones_like(x), x, y])
    weighted = np.linalg.solve(covariance, terms)
    inverse = np.linalg.inv(terms.T @ weighted)
    return weighted @ inverse[0], float(noise.deviation_m * np.sqrt(inverse[0, 0]))


def hidden_edges(
    labels: Labels, cells: GroundCells, noise: Noise
) -> tuple[NDArray[np.bool_], float]:
    """Cells beside edges within surfaces, shape (n, m); and the deviation of a step's height [m].

    Arguments:
        labels: the surface of each cell, −1 for none, shape (n, m).
        cells: the samples.
        noise: correlated.
    """
    beside_edges = np.zeros(labels.shape, dtype=bool)
    rest, known = residuals(labels, cells), (labels >= 0) & cells.known
    count, total = boxed(np.stack([known, known * rest]).astype(np.float64), 3)
    about = count > 0.5  # a cell without samples is as those about it
    rest = np.where(known, rest, total / np.where(about, count, 1.0))
    usable = np.where(about, labels, -1)
    if cells.sparse:  # the outermost cells have points of what is beside
        low, high = (turn(usable, 3) for turn in (minimum_filter, maximum_filter))
        usable = np.where(low == high, usable, -1)
    unseen = list[float]()
    for weights, deviation in windows(noise, cells.spacing_m):
        shape = weights.shape
        size = np.abs(correlate(rest, weights, mode="nearest"))
        whole = minimum_filter(usable, shape, mode="constant", cval=-1)
        inside = (whole >= 0) & (whole == maximum_filter(usable, shape, mode="constant", cval=-1))
        if not inside.any():
            continue
        if np.count_nonzero(inside) >= ENOUGH:
            deviation = float(np.median(size[inside])) / MEDIAN
        unseen.append(deviation)
        beside_edges |= inside & (size > SEEN * deviation)
    return beside_edges, max(unseen, default=noise.deviation_m)
