"""Learned scores of a leap's candidates: numbers that add up over the toes, in place of those of
the hand rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import file_or_named
from stancekit.planners.leap.features import OF_CANDIDATE, OF_LEAP, LeapFeatures
from stancekit.planners.leap.numbers import LeapNumbers

from ..selectors.network import AttentionBlock
from ..selectors.tensors import load_weights, read_tensors, write_tensors
from ..zoo import shipped
from .kinds import FORMAT, KINDS, Kind

CAPS = {"grip": (0.0, 0.1, 0.3), "room_m": (-0.06, -0.03, 0.0, 0.03)}
"""More than this of a feature may be worth nothing: the smaller of the two is a feature, too."""
FEATURES = len(OF_CANDIDATE) + sum(map(len, CAPS.values()))
FOOTHOLDS = 8
"""P of LeapChoice-v0: all of its classes are of robots with four legs, which push off and land."""
NONE = -1e8
"""Score where there is no candidate."""
CLIP = 8.0
"""Standard deviations beyond which a feature counts for no more."""


def with_caps(candidates: Array) -> Array:
    """Features of candidates, and those of ``CAPS`` up to their caps; shape (…, F) to (…,
    ``FEATURES``).
    """
    capped = [
        np.minimum(candidates[..., OF_CANDIDATE.index(name)], cap)
        for name, caps in CAPS.items()
        for cap in caps
    ]
    return np.concatenate([candidates, np.stack(capped, axis=-1)], axis=-1)


class ScoreNetwork(nn.Module):
    """Scores of candidates, shape (B, P, R), and the odds of the scene, shape (B,), whose sum over
    a choice is a logit.

    additive: a score is linear in the candidate's own features. set: an attention network sees all
    candidates of all toes, whatever their order, and adds to the linear score.
    """

    mean: Tensor
    scale: Tensor
    leap_mean: Tensor
    leap_scale: Tensor

    def __init__(self, kind: Kind, width: int = 64, layers: int = 2, heads: int = 4) -> None:
        super().__init__()
        self.kind, self.width, self.layers, self.heads = kind, width, layers, heads
        for name, size in (
            ("mean", FEATURES),
            ("scale", FEATURES),
            ("leap_mean", len(OF_LEAP)),
            ("leap_scale", len(OF_LEAP)),
        ):
            self.register_buffer(
                name, torch.zeros(size) if name.endswith("mean") else torch.ones(size)
            )
        self.linear = nn.Linear(FEATURES, 1, bias=False)
        self.scene = nn.Sequential(nn.Linear(len(OF_LEAP), 32), nn.SiLU(), nn.Linear(32, 1))
        if kind == "set":
            self.embed = nn.Sequential(
                nn.Linear(FEATURES + len(OF_LEAP), width), nn.SiLU(), nn.Linear(width, width)
            )
            self.toe = nn.Linear(2 * width, width)
            self.blocks = nn.ModuleList(AttentionBlock(width, heads) for _ in range(layers))
            self.head = nn.Sequential(
                nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, 1)
            )
            self.odds = nn.Linear(width, 1)

    def forward(self, candidates: Tensor, mask: Tensor, leap: Tensor) -> tuple[Tensor, Tensor]:
        """Scores and odds.

        Arguments:
            candidates: shape (B, P, R, ``FEATURES``).
            mask: (B, P, R).
            leap: (B, G).
        """
        seen = ((candidates - self.mean) / self.scale).clamp(-CLIP, CLIP) * mask[..., None]
        task = ((leap - self.leap_mean) / self.leap_scale).clamp(-CLIP, CLIP)
        scores, odds = self.linear(seen)[..., 0], self.scene(task)[:, 0]
        if self.kind == "additive":
            return scores, odds
        hidden = self.embed(
            torch.cat([seen, task[:, None, None].expand(*seen.shape[:3], -1)], dim=-1)
        )
        hidden = hidden * mask[..., None]
        mean = hidden.sum(dim=2) / mask.sum(dim=2).clamp(min=1.0)[..., None]
        most = hidden.masked_fill(mask[..., None] == 0.0, -1e4).amax(dim=2)
        tokens = self.toe(torch.cat([mean, most], dim=-1))
        for block in self.blocks:
            tokens = block(tokens)
        beside = tokens[:, :, None].expand_as(hidden)
        scores = scores + self.head(torch.cat([hidden, beside], dim=-1))[..., 0]
        return scores, odds + self.odds(tokens.mean(dim=1))[:, 0]

    def seen(self, candidates: Tensor, mask: Tensor, leap: Tensor) -> tuple[Tensor, Tensor]:
        """Scores, very low where there is no candidate, and odds, from the flat parts of
        LeapChoice-v0's observations.

        Arguments:
            candidates: shape (B, P * R * F).
            mask: (B, P * R).
            leap: (B, G).
        """
        table = candidates.reshape(len(candidates), FOOTHOLDS, -1, len(OF_CANDIDATE))
        there = mask.reshape(len(mask), FOOTHOLDS, -1)
        capped = [
            table[..., OF_CANDIDATE.index(name), None].clamp(max=cap)
            for name, caps in CAPS.items()
            for cap in caps
        ]
        scores, odds = self(torch.cat([table, *capped], dim=-1), there, leap)
        return scores.masked_fill(there == 0.0, NONE), odds


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapScorer:
    """Scores that a network gives, for ``LeapFinder(rule=...)``.

    Arguments:
        network: the scores are its logits.
        origin: what it was learned from, for people.

    Raises:
        InvalidInput: from ``read``, for a file that holds no scorer, and a name that does not ship.
    Source:
        None: logistic regression, and self-attention over sets.

    Example:
        >>> import stancekit
        >>> tries = stancekit.label("leap-few", "few", scenes=2, tries={"random": 4})
        >>> scorer = stancekit.fit(tries, "additive", epochs=2)
        >>> stancekit.plan("leap-few:0", stancekit.LeapFinder(rule=scorer, solves=5, proof=0)).method
        'finder'
    """

    network: ScoreNetwork
    origin: dict[str, Any]

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        seen = LeapFeatures.of(numbers)
        with torch.no_grad():
            inputs = (with_caps(seen.candidates), seen.mask, seen.leap)
            scores, _ = self.network(
                *(torch.as_tensor(each, dtype=torch.float32)[None] for each in inputs)
            )
        return np.where(seen.mask > 0.0, scores[0].numpy().astype(np.float64), -np.inf)

    def predict(
        self,
        observation: Mapping[str, NDArray[np.float32]],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.int64], Any]:
        """Choices from observations of LeapChoice-v0, single ones or batches, as policies of
        stable-baselines3 do.

        Arguments:
            deterministic: the best candidate per foothold; otherwise drawn by the softmax of the
                scores, by torch's own generator.
        """
        seen = torch.as_tensor(np.atleast_2d(observation["candidates"]))
        mask = torch.as_tensor(np.atleast_2d(observation["mask"]))
        with torch.no_grad():
            scores = self.network.seen(
                seen, mask, torch.as_tensor(np.atleast_2d(observation["leap"]))
            )[0]
        if deterministic:
            choice = scores.argmax(dim=2).numpy()
        else:
            odds = scores.flatten(0, 1).softmax(dim=1)
            choice = torch.multinomial(odds, 1).reshape(scores.shape[:2]).numpy()
        return choice if np.ndim(observation["leap"]) > 1 else choice[0], state

    def write(self, path: str | Path) -> None:
        """Write a safetensors file."""
        network = self.network
        sizes = {
            "kind": network.kind,
            "width": network.width,
            "layers": network.layers,
            "heads": network.heads,
        }
        write_tensors(path, FORMAT, {**sizes, "origin": self.origin}, network.state_dict())

    @classmethod
    def read(cls, path: str | Path) -> LeapScorer:
        """Read what ``write`` wrote, or the scorer of that name that ships."""
        path = file_or_named(path, shipped("scorers"))
        header, tensors = read_tensors(path, FORMAT)
        try:
            kind, sizes = (
                header["kind"],
                [int(header[name]) for name in ("width", "layers", "heads")],
            )
            if (
                kind not in KINDS
                or not all(1 <= size <= 1024 for size in sizes)
                or sizes[0] % sizes[2]
            ):
                raise ValueError
        except (KeyError, TypeError, ValueError):
            raise InvalidInput(
                f"{path}: expected a leap scorer of a kind among {', '.join(KINDS)}, with its sizes"
            ) from None
        with torch.device("meta"):
            network = ScoreNetwork(kind, *sizes)
        load_weights(network, tensors, path)
        return cls(network=network.eval(), origin=dict(header.get("origin") or {}))
