"""Policies without a memory: an action follows from one observation, or actions from a batch of
them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

Observation = Mapping[str, NDArray[Any]]


class MemorylessPolicy(ABC):
    """Adapter to call rules and selectors, which have an ``action`` alone, as policies of
    stable-baselines3 are called.
    """

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

    @abstractmethod
    def action(self, observation: Observation) -> NDArray[Any]:
        """The action; of a batch of observations one a row.

        Raises InvalidInput where it was made for others.
        """
