"""Likeness of a batch of problems to the rows of a calibration: whether all of its numbers could be
draws of the same class, whatever share of them is feasible.

A promise that held-out rows give is a promise for problems drawn as they were. Which share of a
batch is feasible is nobody's to say, so each number's histogram is compared with the best mixture of
the histograms of the true classes (weights by least squares over all numbers together), by
Pearson's statistic with the variance of both sides, and the least of the p-values times their
number (Bonferroni) is what counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.special import gammaincc

from stancekit.planners.files.arrays import Array

from .calibration import KINDS

BINS = 8
FEWEST = 64
"""Problems from which on a batch is compared: fewer cannot tell a class from another."""
ALARM = 1e-4
"""A batch of the class is called unlike it with about this probability."""
ROUNDS = 4
LEAST = 5.0
"""Variance that a bin has at least, so that one problem in an empty bin is no alarm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Likeness:
    """Histograms of the numbers of a calibration's rows, by their true class.

    Arguments:
        edges: inner edges of the bins, shape (C, ``BINS`` − 1), for C numbers per problem.
        counts: rows per true class, number and bin, shape (3, C, ``BINS``), in the order of
            ``KINDS``.
    """

    edges: Array
    counts: Array

    @classmethod
    def of(cls, rows: Mapping[str, Array]) -> Likeness:
        """Histograms of rows by their true class, each shape (n, C); bins are quantiles of all."""
        every = np.concatenate([rows[kind] for kind in KINDS])
        levels = np.arange(1, BINS) / BINS
        edges = (
            np.quantile(every, levels, axis=0).T
            if len(every)
            else np.zeros((every.shape[1], BINS - 1))
        )
        return cls(edges=edges, counts=np.stack([_counted(rows[kind], edges) for kind in KINDS]))

    def unlike(self, values: Array) -> tuple[float, int]:
        """Bonferroni's bound on the p-value that these are draws of the class, at most 1, and the
        number that differs most; (1, 0) for too few problems to tell, or without rows.

        Arguments:
            values: shape (B, C).
        """
        counted = self.counts[:, :1].sum(axis=2)  # rows of each class, (3, 1)
        there = counted[:, 0] > 0
        if len(values) < FEWEST or not there.any():
            return 1.0, 0
        seen = _counted(values, self.edges)
        size = counted[there][..., None]
        shares = (self.counts[there] + 0.5 / BINS) / (size + 0.5)
        weights, expected = np.ones(len(shares)), seen
        for _ in range(ROUNDS):
            scale = 1.0 / np.sqrt(np.maximum(expected, LEAST))
            rows = (shares * scale).reshape(len(shares), -1).T
            weights = nnls(rows, (seen * scale).ravel())[0]
            weights /= weights.sum()
            expected = len(values) * np.tensordot(weights, shares, 1)
        noise = np.tensordot(weights**2, shares / size, 1)
        spread = expected + len(values) ** 2 * noise
        statistic = ((seen - expected) ** 2 / np.maximum(spread, LEAST)).sum(axis=1)
        p = gammaincc(0.5 * (BINS - 1), 0.5 * statistic)
        worst = int(np.argmax(statistic))
        return min(float(p[worst]) * len(p), 1.0), worst


def _counted(values: Array, edges: Array) -> Array:
    """Values per number and bin, shape (C, ``BINS``)."""
    bins = [
        np.bincount(np.searchsorted(row, column), minlength=BINS)
        for row, column in zip(edges, np.reshape(values, (-1, len(edges))).T, strict=True)
    ]
    return np.array(bins, dtype=np.float64)
