"""Thresholds of a score that hold a stated error in each class of true answers, for finite samples.

Scores of held-out rows of one class are exchangeable with those of new problems of that class. With
n of them the k-th largest is exceeded by a new one with a probability that is at most ``error``, at
a confidence of 1 − δ, where P(Bin(n, error) < k) ≤ δ: the order statistic of a one-sided tolerance
interval (Wilks, 1941), which asks nothing of the distribution of scores.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array

CONFIDENCE = 0.95
"""Confidence at which the stated error holds in all classes together."""
KINDS = ("feasible", "infeasible", "trivial")
"""Classes of true answers: the trivially infeasible ones are a class of their own."""


def checked_error(error: float, name: str = "error") -> float:
    """The error as a float.

    Raises InvalidInput unless it lies between 0 and 1.
    """
    if not (isinstance(error, float | int) and 0.0 < error < 1.0):
        raise InvalidInput(f"{name}: expected a number above 0 and below 1, got {error!r}")
    return float(error)


def allowed(count: int, error: float, doubt: float) -> int:
    """The rows of a class, of so many, that may lie beyond a threshold that is to hold ``error``
    with a probability of at least 1 − doubt; −1 where not even none is few enough.
    """
    if count < 1 or (1.0 - error) ** count > doubt:
        return -1
    from scipy.special import bdtr  # slow to import, and not asked for where answers are read

    low, high = 0, count
    while high - low > 1:  # P(Bin ≤ low) ≤ doubt < P(Bin ≤ high)
        middle = (low + high) // 2
        low, high = (middle, high) if bdtr(middle, count, error) <= doubt else (low, middle)
    return low


def threshold(scores: Array, error: float, doubt: float) -> float:
    """The least threshold that new scores like these exceed with a probability of at most
    ``error``; inf where there are too few.

    Arguments:
        scores: of held-out rows of one class, shape (n,).
    """
    beyond = allowed(len(scores), error, doubt)
    return math.inf if beyond < 0 else float(np.sort(scores)[len(scores) - 1 - beyond])


def thresholds(scores: Mapping[str, Array], error: float) -> tuple[float, float]:
    """(low, high): a score below low is called infeasible, one above high feasible.

    Arguments:
        scores: of held-out rows by their true class, a name of ``KINDS``; the larger, the more
            feasible. Of truly feasible problems at most ``error`` are called infeasible, and of
            each class of infeasible ones that has rows at most ``error`` feasible, all at
            ``CONFIDENCE`` together.
    """
    checked_error(error)
    there = [kind for kind in KINDS if len(scores.get(kind, ()))]
    doubt = (1.0 - CONFIDENCE) / max(len(there), 1)
    none: Array = np.zeros(0)
    low = -threshold(-np.asarray(scores.get("feasible", none)), error, doubt)
    high = threshold(np.asarray(scores.get("infeasible", none)), error, doubt)
    if len(scores.get("trivial", ())):
        high = max(high, threshold(np.asarray(scores["trivial"]), error, doubt))
    return low, high


BINS = 8
FEWEST = 64
"""Problems from which on a batch is compared: fewer cannot tell a class from another."""
ALARM = 1e-4
"""A batch of the class is called unlike it with about this probability."""
_ROUNDS = 4
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
        from scipy.optimize import nnls
        from scipy.special import gammaincc

        weights, expected = np.ones(len(shares)), seen
        for _ in range(_ROUNDS):
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """Answers of a surrogate.

    Arguments:
        answers: "feasible", "infeasible" or "ask" per problem, shape (B,).
        margins: the surrogate's own estimate of how far each problem is from the border, above 0
            feasible, within ±0.1, non-dimensional: no bound holds it; shape (B,).
        scores: scores that decide, larger for more feasible, shape (B,).
        error: of truly feasible problems of the class at most this share is called infeasible, and
            of truly infeasible ones at most this share feasible; of trivially infeasible ones only
            where the rows of the calibration had any.
        confidence: with which that holds, by the rows that it was calibrated on.
        shifted: why everything is asked, where a batch of 64 problems or more is not drawn as the
            class is, so that nothing is promised of it; empty otherwise.

    Raises:
        Nothing.
    Source:
        Wilks (1941), one-sided tolerance intervals.

    Example:
        >>> import numpy as np
        >>> from stancekit import Screened
        >>> Screened(answers=np.array(["feasible", "ask"]), margins=np.zeros(2),
        ...          scores=np.zeros(2), error=0.005, confidence=0.95).decided
        0.5
    """

    answers: NDArray[np.str_]
    margins: Array
    scores: Array
    error: float
    confidence: float
    shifted: str = ""

    def __len__(self) -> int:
        return len(self.answers)

    @property
    def decided(self) -> float:
        """Share of the problems that are not asked of an exact planner; NaN for no problems."""
        return float(np.mean(self.answers != "ask")) if len(self.answers) else math.nan
