"""Rules of branching for ``EnvelopeRefinement-v0``, which no agent that learns should be worse
than.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .memoryless import MemorylessPolicy, Observation

LEAST = 1e-9
"""Least value of gaps and widths, so that they have logarithms."""


class LargestGap(MemorylessPolicy):
    """Branch where P1's answer is farthest off the bilinear surface: the textbook rule for bilinear
    problems.
    """

    def action(self, observation: Observation) -> NDArray[np.int64]:
        """Split the wider dimension of the largest gap, or the widest one where there is no gap.

        Both factors of the worst product have its gap as their score; the width tells which of them
        to cut.
        """
        gap, width = observation["gap"], observation["high"] - observation["low"]
        worst = gap >= gap.max(axis=-1, keepdims=True)
        return np.asarray(np.argmax(np.where(worst, width, -1.0), axis=-1))


class WidestDimension(MemorylessPolicy):
    """Bisect the longest edge of the box."""

    def action(self, observation: Observation) -> NDArray[np.int64]:
        """The dimension."""
        return np.asarray(np.argmax(observation["high"] - observation["low"], axis=-1))


class NoisyGap(MemorylessPolicy):
    """Branch on the largest product of gap and width, up to chance: log(gap · width) + spread ·
    Gumbel noise.
    """

    def __init__(self, rng: np.random.Generator, *, spread: float) -> None:
        self._rng, self._spread = rng, spread

    def action(self, observation: Observation) -> NDArray[np.int64]:
        """The dimension."""
        score = np.log(np.maximum(observation["gap"], LEAST)) + np.log(
            np.maximum(observation["high"] - observation["low"], LEAST)
        )
        return np.asarray(
            np.argmax(score + self._spread * self._rng.gumbel(size=score.shape), axis=-1)
        )


class RandomDimension(MemorylessPolicy):
    """Any dimension, each as likely."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def action(self, observation: Observation) -> NDArray[np.int64]:
        """The dimension."""
        shape = np.shape(observation["gap"])
        return np.asarray(self._rng.integers(shape[-1], size=shape[:-1]))
