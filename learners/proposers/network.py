"""The network of the proposers: a scene's contacts in, numbers for a posture and for two proofs
out.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..selectors.network import Architecture, Encoder, SceneTensors


class ProposerNetwork(nn.Module):
    """Scenes to numbers a contact, (B, N, contact), and a scene, (B, body); the scene's are of the
    tokens' mean.
    """

    def __init__(self, architecture: Architecture, *, contact: int, body: int) -> None:
        super().__init__()
        self.architecture = architecture
        width = architecture.width
        self.encoder = Encoder(architecture)
        self.contact, self.body = _head(width, contact), _head(width, body)

    def forward(self, scenes: SceneTensors) -> tuple[Tensor, Tensor]:
        """Numbers of every contact and of every scene."""
        tokens = self.encoder(scenes)
        return torch.as_tensor(self.contact(tokens)), torch.as_tensor(self.body(tokens.mean(dim=1)))


def _head(width: int, out: int) -> nn.Sequential:
    return nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 128), nn.SiLU(), nn.Linear(128, out))
