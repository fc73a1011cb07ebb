"""Thresholds of a score that hold a stated error in each class of true answers, for finite samples.

Scores of held-out rows of one class are exchangeable with those of new problems of that class. With
n of them the k-th largest is exceeded by a new one with a probability that is at most ``error``, at
a confidence of 1 − δ, where P(Bin(n, error) < k) ≤ δ: the order statistic of a one-sided tolerance
interval (Wilks, 1941), which asks nothing of the distribution of scores.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import bdtr

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
