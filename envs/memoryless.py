"""Policies without a memory: an action follows from one observation, or actions from a batch of
them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import NDArray

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
