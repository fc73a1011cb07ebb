"""The network of a surrogate: a scene's contacts in, whatever their order, a score and a margin
out.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..selectors.network import Architecture, AttentionBlock
from .features import CORNER, TOKEN

_CLIP = 8.0
"""Standard deviations beyond which a feature counts for no more."""


class SurrogateNetwork(nn.Module):
    """Scenes to a score, above 0 where feasible is likelier, and a margin, shape (B,) each.

    One token per contact without a position, so that the order of the contacts changes nothing, and
    means over the corners of a patch, so that theirs does not either.
    """

    token_mean: Tensor
    token_scale: Tensor
    corner_mean: Tensor
    corner_scale: Tensor

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        width, corner = architecture.width, architecture.corner_width
        for name, size in (("token", TOKEN), ("corner", CORNER)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_scale", torch.ones(size))
        self.corners = nn.Sequential(nn.Linear(CORNER, corner), nn.SiLU())
        self.embed = nn.Sequential(
            nn.Linear(TOKEN + 2 * corner, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.blocks = nn.ModuleList(
            AttentionBlock(width, architecture.heads) for _ in range(architecture.layers)
        )
        self.head = nn.Sequential(
            nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, 2)
        )

    def fit_scales(self, tokens: Tensor, corners: Tensor) -> None:
        """Set the scales of the inputs from scenes like these."""
        for name, values in (("token", tokens), ("corner", corners)):
            flat = values.reshape(-1, values.shape[-1])
            setattr(self, f"{name}_mean", flat.mean(dim=0))
            setattr(self, f"{name}_scale", flat.std(dim=0).clamp(min=1e-3))

    def forward(self, tokens: Tensor, corners: Tensor) -> tuple[Tensor, Tensor]:
        """Score and margin.

        Arguments:
            tokens: shape (B, N, ``TOKEN``).
            corners: (B, N, U, ``CORNER``).
        """
        seen = ((corners - self.corner_mean) / self.corner_scale).clamp(-_CLIP, _CLIP)
        patch = self.corners(seen)
        patch = torch.cat([patch.mean(dim=2), patch.amax(dim=2)], dim=-1)
        of_contact = ((tokens - self.token_mean) / self.token_scale).clamp(-_CLIP, _CLIP)
        hidden: Tensor = self.embed(torch.cat([of_contact, patch], dim=-1))
        for block in self.blocks:
            hidden = block(hidden)
        out = self.head(torch.cat([hidden.mean(dim=1), hidden.amax(dim=1)], dim=-1))
        return out[:, 0], out[:, 1]
