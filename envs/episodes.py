"""What all environments do alike: how an episode is begun, gone on with and drawn, and what is
refused before any work is done.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import shown

from .reward import Step, Terms

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
    else:
        low, kinds = np.asarray(getattr(space, "start", 0)), "iu"
        high = np.asarray(getattr(space, "nvec", getattr(space, "n", 0))) - 1 + low
    if array.shape != space.shape:
        raise InvalidInput(f"action: expected shape {space.shape}, got {array.shape}")
    if array.dtype.kind not in kinds or not (
        (array >= low - _BEYOND).all() and (array <= high + _BEYOND).all()
    ):
        ends = np.unique(high).tolist()
        most = f"{ends[0]:g}" if len(ends) == 1 else tuple(high.ravel().tolist())
        numbers = f"{'finite' if kinds == 'fiu' else 'whole'} numbers, {low.min():g} to {most}"
        raise InvalidInput(f"action: expected {numbers}, got {shown(action)}")
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


_WINDOW = "stancekit"
Episode = TypeVar("Episode")


class TaskEnv(gym.Env[dict[str, NDArray[np.float32]], Any], ABC, Generic[Episode]):
    """An environment but for its task, which has the spaces, and says how an episode begins, what
    an action does, what is seen then, and how it is drawn.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 — Gymnasium's own convention
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    _terms = Terms(by_key={})

    def __init__(self, render_mode: str | None) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata)
        self._episode: Episode | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw the next episode."""
        check_options(options)
        super().reset(seed=checked_seed(seed))
        self._episode, info = self._begin()
        if self.render_mode == "human":
            self.render()
        return self._observe(self._episode), info | self._terms.nothing

    def step(
        self, action: Any
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Do as the action says, and judge it."""
        episode = self._now("the first step")
        if self._is_over(episode):
            raise gym.error.ResetNeeded("the episode is over: reset the environment")
        done = self._act(episode, action)
        own = self._terms.of(done)
        if self.render_mode == "human":
            self.render()
        reward = float(sum((done.reward, *own.values())))
        info = {**done.info, **own}
        return self._observe(episode), reward, done.terminated, done.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the episode as it is now; for "human" on the screen, or, on a machine without one,
        nowhere.
        """
        from stancekit.views.sheet import to_rgb

        pixels = to_rgb(self._drawn(self._now("rendering")))
        if self.render_mode != "human":
            return pixels
        import matplotlib.pyplot as plt

        plt.figure(_WINDOW, clear=True).figimage(pixels, resize=True)
        plt.pause(0.001)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.render_mode == "human":
            import matplotlib.pyplot as plt

            plt.close(_WINDOW)

    def _now(self, before: str) -> Episode:
        """The episode.

        Raises ResetNeeded before the first one.
        """
        if self._episode is None:
            raise gym.error.ResetNeeded(f"reset the environment before {before}")
        return self._episode

    def _try_terms(self, question: Any, info: Mapping[str, Any], terminated: bool = False) -> None:
        """Ask terms of one's own about a question of which nothing was tried: what they may not bear
        is told at once.
        """
        action = np.zeros(self.action_space.shape or (), dtype=np.int64)[()]
        self._terms.of(Step(question=question, action=action, info=info, terminated=terminated))

    @abstractmethod
    def _begin(self) -> tuple[Episode, dict[str, Any]]:
        """An episode drawn with the environment's generator, and its info."""

    @abstractmethod
    def _act(self, episode: Episode, action: Any) -> Step:
        """What an action comes to."""

    @abstractmethod
    def _observe(self, episode: Episode) -> dict[str, NDArray[np.float32]]:
        """What the agent sees."""

    @abstractmethod
    def _drawn(self, episode: Episode) -> Any:
        """A figure of it."""

    def _is_over(self, episode: Episode) -> bool:
        """Tell whether no action is taken any more."""
        return False


def boxes(bounds: Mapping[str, tuple[float, float, int]]) -> spaces.Dict:
    """The space of flat float32 boxes, each with its lowest and highest number and its size."""
    return spaces.Dict(
        {
            name: spaces.Box(low, high, (size,), np.float32)
            for name, (low, high, size) in bounds.items()
        }
    )
