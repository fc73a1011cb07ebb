"""Learned scores as a policy of sb3-contrib's MaskablePPO: imitation first, then rewards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from .kinds import Kind
from .scorer import FOOTHOLDS, LeapScorer, ScoreNetwork


class ScorePolicy(MaskableActorCriticPolicy):  # type: ignore[misc, unused-ignore]
    """Draw a candidate per foothold of LeapChoice-v0 by the softmax of a score network, which is
    the whole actor.

    ``MaskablePPO(ScorePolicy, env, policy_kwargs={"scorer": "set.safetensors"})`` goes on from what
    ``fit`` learned; ``scorer()`` gives back what ``plan``, ``bench room`` and ``LeapFinder`` take.

    Arguments:
        observation_space, action_space, lr_schedule: as stable-baselines3 passes them.
        scorer: file or name of the scores to begin with; untrained ones where None.
        kind: "set" or "additive", of untrained scores.
        more: other keywords of sb3-contrib's policy.

    Raises:
        InvalidInput: for a file that holds no scorer.
    Source:
        None: proximal policy optimisation with masks, as sb3-contrib has it.

    Example:
        >>> import gymnasium, stancekit.envs
        >>> from sb3_contrib import MaskablePPO
        >>> env = gymnasium.make("stancekit/LeapChoice-v0", problem="leap-few", tries=1)
        >>> agent = MaskablePPO(ScorePolicy, env, n_steps=8, batch_size=8)
        >>> agent.policy.scorer().network.kind
        'set'
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.MultiDiscrete,
        lr_schedule: Callable[[float], float],
        *,
        scorer: str | Path | None = None,
        kind: Kind = "set",
        **more: Any,
    ) -> None:
        self._begins = {"scorer": None if scorer is None else str(scorer), "kind": kind}
        defaults = {
            "net_arch": [],
            "ortho_init": False,
            "features_extractor_class": _Scored,
            "features_extractor_kwargs": self._begins,
        }
        super().__init__(observation_space, action_space, lr_schedule, **{**more, **defaults})

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        heads: Any = (_Actor(), _Critic())
        self.action_net, self.value_net = heads
        make: Any = self.optimizer_class
        self.optimizer = make(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def scorer(self) -> LeapScorer:
        """The scores as they are now."""
        extractor: Any = self.features_extractor
        network = ScoreNetwork(
            extractor.network.kind,
            extractor.network.width,
            extractor.network.layers,
            extractor.network.heads,
        )
        network.load_state_dict(extractor.network.state_dict())
        return LeapScorer(
            network=network.eval(), origin={**extractor.origin, "method": "maskable-ppo"}
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        fixed = ("net_arch", "ortho_init", "features_extractor_class", "features_extractor_kwargs")
        rest = {
            name: value
            for name, value in super()._get_constructor_parameters().items()
            if name not in fixed
        }
        extractor: Any = self.features_extractor
        return {**rest, "scorer": None, "kind": extractor.network.kind}


class _Scored(BaseFeaturesExtractor):
    """Scores of all candidates; after them, for the value, how likely the best choice has a leap,
    and ``left``.
    """

    def __init__(self, space: spaces.Dict, scorer: str | None, kind: Kind) -> None:
        super().__init__(space, int(np.prod(space["mask"].shape or ())) + EXTRA)
        read = None if scorer is None else LeapScorer.read(scorer)
        self.network = ScoreNetwork(kind) if read is None else read.network
        self.origin = {} if read is None else read.origin

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        scores, odds = self.network.seen(
            *(observation[name] for name in ("candidates", "mask", "leap"))
        )
        tables = scores.reshape(len(scores), FOOTHOLDS, -1)
        likely = torch.sigmoid(tables.amax(dim=2).sum(dim=1) + odds)
        return torch.cat([scores.flatten(1), likely[:, None], observation["left"]], dim=1)


EXTRA = 3
"""Numbers for the value: how likely the best choice has a leap, and the two of ``left``."""


class _Actor(nn.Module):
    """Logits."""

    def forward(self, features: Tensor) -> Tensor:
        return features[:, :-EXTRA]


class _Critic(nn.Module):
    """A value that is linear in how likely the best choice has a leap, and in what is left."""

    def __init__(self) -> None:
        super().__init__()
        self.linear = nn.Linear(EXTRA, 1)

    def forward(self, features: Tensor) -> Tensor:
        value: Tensor = self.linear(features[:, -EXTRA:].detach())
        return value
