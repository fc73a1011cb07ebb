"""Rules of branching for ``EnvelopeRefinement-v0``, which no agent that learns should be worse
than: each gives the dimension to split of an observation, or of a batch of them.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from .memoryless import MemorylessPolicy, Observation

LEAST = 1e-9
"""Least value of gaps and widths, so that they have logarithms."""


def largest_gap(observation: Observation) -> NDArray[np.int64]:
    """The wider dimension of the largest gap, where P1's answer is farthest off the bilinear
    surface, or the widest one where there is no gap: the textbook rule for bilinear problems.

    Both factors of the worst product have its gap as their score; the width tells which of them to
    cut.
    """
    gap, width = observation["gap"], observation["high"] - observation["low"]
    worst = gap >= gap.max(axis=-1, keepdims=True)
    return np.asarray(np.argmax(np.where(worst, width, -1.0), axis=-1))


def widest(observation: Observation) -> NDArray[np.int64]:
    """The longest edge of the box."""
    return np.asarray(np.argmax(observation["high"] - observation["low"], axis=-1))


def noisy_gap(rng: np.random.Generator, *, spread: float) -> MemorylessPolicy:
    """Policy that branches on the largest product of gap and width, up to chance: log(gap · width)
    + spread · Gumbel noise.
    """
    return MemorylessPolicy(partial(_noisy, rng=rng, spread=spread))


def _noisy(
    observation: Observation, *, rng: np.random.Generator, spread: float
) -> NDArray[np.int64]:
    score = np.log(np.maximum(observation["gap"], LEAST)) + np.log(
        np.maximum(observation["high"] - observation["low"], LEAST)
    )
    return np.asarray(np.argmax(score + spread * rng.gumbel(size=score.shape), axis=-1))


def any_dimension(rng: np.random.Generator) -> MemorylessPolicy:
    """Policy that branches on any dimension, each as likely."""
    return MemorylessPolicy(partial(_drawn, rng=rng))


def _drawn(observation: Observation, *, rng: np.random.Generator) -> NDArray[np.int64]:
    shape = np.shape(observation["gap"])
    return np.asarray(rng.integers(shape[-1], size=shape[:-1]))
