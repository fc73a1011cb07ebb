"""How sure surfaces of a map or a cloud are, from the noise of its heights and from how many there are."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .cells import GroundCells, Labels, fitted
from .certainty import Certainty

LAG_M = 0.15
"""Residuals farther apart are taken for independent [m]."""
CHOSEN = 0.1
"""How far planes are off because their cells were chosen by these very heights, as a share of the noise: assumed,
after planes of 2 cm of noise that were 2.5 mm off."""
UNRELATED = 0.1
"""A correlation below this ends the sum."""
LEAST_STEP_M, BLURRED = 0.01, 1.5
"""A step lower than this is no edge to a foot [m]; and the most that noise moves an edge, in samples' distances."""
FEWEST = 30
"""Cells of a surface whose residuals count for the correlation."""


def certainties(labels: Labels, cells: GroundCells, noise_m: float, margin_m: float) -> list[Certainty]:
    """The certainty of each surface.

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
    spacing, mean, (x, y) = cells.spacing_m, cells.heights, cells.places
    of = np.maximum(labels, 0)
    level = planes[of, 0] * x + planes[of, 1] * y + planes[of, 2]
    rest = np.where((labels >= 0) & cells.known, mean - level, np.nan)
    i, j = np.nonzero(np.isfinite(rest))
    number, r, u, v = labels[i, j], rest[i, j], x[i, j], y[i, j]
    size = np.maximum(np.bincount(number, minlength=count), 1)
    middle = np.stack([np.bincount(number, weights=each, minlength=count) / size for each in (u, v)])
    du, dv = spacing * (u - middle[0, number]), spacing * (v - middle[1, number])
    uu, uv, vv = (np.bincount(number, weights=each, minlength=count) for each in (du * du, du * dv, dv * dv))
    variance = np.bincount(number, weights=r * r, minlength=count) / np.maximum(size - 3, 1)
    related = _related(rest, np.where(np.append(size >= FEWEST, False)[labels], labels, -1), spacing)
    steps = _steps(labels, level, count)
    found = []
    for k in range(count):
        matrix = np.array([[uu[k], uv[k]], [uv[k], vv[k]]]) + 1e-3 * spacing**2 * np.eye(2)
        covariance = np.zeros((3, 3))
        covariance[0, 0], covariance[1:, 1:] = 1.0 / size[k], np.linalg.inv(matrix)
        blur = spacing * min(2.0 * (noise_m / steps[k]) ** 2, BLURRED)  # where a step begins, in noisy samples
        found.append(
            Certainty(
                about_m=cells.corner_m[:2] + spacing * middle[:, k],
                covariance=related * variance[k] * covariance + np.diag([(CHOSEN * noise_m) ** 2, 0.0, 0.0]),
                edge_sd_m=float(np.hypot(spacing / np.sqrt(12.0), blur)),
                inset_m=margin_m + blur,
            )
        )
    return found


def _related(rest: Array, labels: Labels, spacing: float) -> float:
    """How many cells count for one, by the correlation of residuals along both axes."""
    values = np.where(labels >= 0, rest, np.nan)
    variance = float(np.nanmean(values**2)) if np.isfinite(values).any() else 0.0
    if variance <= 0.0:
        return 1.0
    found = 1.0
    for axis in (0, 1):
        total = 1.0
        for lag in range(1, max(int(LAG_M / spacing), 1) + 1):
            if lag >= values.shape[axis]:
                break
            one, other = (np.take(values, range(*part), axis=axis) for part in _lagged(values.shape[axis], lag))
            own, its = (np.take(labels, range(*part), axis=axis) for part in _lagged(values.shape[axis], lag))
            both = (own == its) & np.isfinite(one * other)
            share = float((one * other)[both].mean()) / variance if both.any() else 0.0
            if share < UNRELATED:
                break
            total += 2.0 * share
        found *= total
    return found


def _lagged(count: int, lag: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (0, count - lag), (lag, count)


def _steps(labels: Labels, level: Array, count: int) -> Array:
    """How high the step is at the border of each surface: the median over its neighbours, inf where a foot would not
    notice any, shape (count,) [m]."""
    found = np.full(count, np.inf)
    own, off = list[Labels](), list[Array]()
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        for a, b in ((one, other), (other, one)):
            differ = (labels[a] != labels[b]) & (labels[a] >= 0) & (labels[b] >= 0)
            differ &= np.abs(level[b] - level[a]) > LEAST_STEP_M
            own.append(labels[a][differ])
            off.append(np.abs(level[b] - level[a])[differ])
    owner, height = np.concatenate(own), np.concatenate(off)
    order = np.lexsort((height, owner))
    owner, height = owner[order], height[order]
    first = np.searchsorted(owner, np.arange(count))
    last = np.searchsorted(owner, np.arange(count), side="right")
    some = last > first
    found[some] = height[(first[some] + last[some]) // 2]
    return found
