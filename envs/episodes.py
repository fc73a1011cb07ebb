"""Checks that all environments make alike when they are made and reset, before any work is done."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import shown

Observation = Mapping[str, NDArray[Any]]


class MemorylessPolicy:
    """Adapter to call a rule, or a selector, which has an ``action`` alone, as policies of
    stable-baselines3 are called.

    Arguments:
        rule: from an observation, or a batch of them, to the action; classes with an ``action`` of
            their own need none.
    """

    def __init__(self, rule: Callable[[Observation], NDArray[Any]]) -> None:
        self._rule = rule

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return (action, state), the state as it came: an action of the environment, or a row an
        observation.
        """
        return self.action(observation), state

    def action(self, observation: Observation) -> NDArray[Any]:
        """The action; of a batch of observations one a row.

        Raises InvalidInput where it was made for others.
        """
        return self._rule(observation)


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


_IGNORED = ("minari_autoseed",)
"""Options of ``reset`` that are for a collector around an environment, which hands them on."""


def checked_render_mode(mode: Any, metadata: Mapping[str, Any]) -> str | None:
    """Return a render mode that the metadata of an environment has, or None.

    Raises InvalidInput.
    """
    modes = metadata["render_modes"]
    if mode is not None and mode not in modes:
        raise InvalidInput(f"render_mode: expected one of {modes}, got {shown(mode)}")
    return None if mode is None else str(mode)


def checked_seed(seed: Any) -> int | None:
    """Return the seed of ``reset`` as an int of 0 or more, or None.

    Raises InvalidInput.
    """
    return None if seed is None else checked_int(seed, "seed")


def check_options(options: Any, known: Collection[str] = ()) -> None:
    """Raise InvalidInput for options of ``reset`` that an environment does not have."""
    if options is not None and not isinstance(options, Mapping):
        raise InvalidInput(f"options: expected a mapping or None, got {shown(options)}")
    strange = [name for name in options or () if name not in known and name not in _IGNORED]
    if strange:
        wanted = f"one of {', '.join(known)}" if known else "none"
        raise InvalidInput(f"options: expected {wanted}, got {', '.join(map(str, strange))}")


_BEYOND = 1e-6
"""Distance by which rounding may carry the numbers of an action out of their box."""


def checked_action(action: Any, space: spaces.Space[Any]) -> NDArray[Any]:
    """Return an action of a space: whole numbers as int64, those of a box as float64.

    Raises InvalidInput for another shape, what is beyond its limits, fractions of whole numbers,
    truth values, and what is no number.
    """
    array = np.asarray(action)
    if isinstance(space, spaces.Box):
        low, high, kinds = space.low, space.high, "fiu"
        wanted = f"finite numbers, {low.min():g} to {high.max():g}"
    else:
        kinds, low = "iu", np.asarray(getattr(space, "start", 0))
        high = np.asarray(getattr(space, "nvec", getattr(space, "n", 0))) - 1 + low
        ends = high.ravel().tolist()
        most = ends[0] if len(set(ends)) == 1 else tuple(ends)
        wanted = f"whole numbers, {low.min()} to {most}"
    if array.shape != space.shape:
        raise InvalidInput(f"action: expected shape {space.shape}, got {array.shape}")
    if array.dtype.kind not in kinds or not (
        np.all(array >= low - _BEYOND) and np.all(array <= high + _BEYOND)
    ):
        raise InvalidInput(f"action: expected {wanted}, got {shown(action)}")
    return array.astype(np.float64 if kinds == "fiu" else np.int64)


def checked_mask(mask: Any, count: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return a ``reset_mask`` of Gymnasium: which of ``count`` sub-environments are reset, one at
    least.

    Raises InvalidInput for anything but truth values, shape (count,), of which one is true.
    """
    array = np.asarray(mask)
    if array.shape != (count,) or array.dtype != np.bool_ or not array.any():
        wanted = f"an array of truth values, shape ({count},), one or more of them true"
        raise InvalidInput(f"options: reset_mask: expected {wanted}, got {shown(mask)}")
    return array
