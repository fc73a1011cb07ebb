"""What a selector is: scene in, envelopes out, with the same ``predict`` as a stable-baselines3 policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from stancekit.planners.contact.envelope import EnvelopeSet

Observation = Mapping[str, NDArray[Any]]


class Selector(Protocol):
    """Chooses the envelope(s) that P1 may use for an observed scene."""

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return (action, state): one action of ``EnvelopeSelection-v0``, or a row an observation of a batch."""
        ...


class FixedSelector:
    """Answers every scene with the same envelopes: what the clustering and evolutionary methods of paper E learn."""

    def __init__(self, name: str, envelopes: EnvelopeSet) -> None:
        self.name = name
        self.envelopes = envelopes
        self._action = np.concatenate([envelope.to_vector() for envelope in envelopes.envelopes]).astype(np.float32)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return the envelopes' bounds, tiled over a batch of observations."""
        batch = np.shape(observation["friction"])[:-1]
        return np.broadcast_to(self._action, (*batch, self._action.size)).copy(), state
