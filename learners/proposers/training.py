"""Training proposers without labels, with a loss that counts what a network fails to settle.

A posture's loss is by how much it breaks its problem, a proof's is what it lacks to prove
something. Both saturate, so that a problem that has no posture, or no proof, pulls at nothing. Of
the draws only those are kept that a few steps of the fixed iteration (``planners.search.witness``)
leave open: the rest will never be asked about. No solver takes part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any, cast

import numpy as np
import torch
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt
from torch import Tensor, nn

from stancekit.envs.distributions.postures import Distribution
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import check_fields
from stancekit.planners.problem import PostureBatch
from stancekit.planners.search.witness import witnesses

from ..selectors.network import CORNERS, Architecture
from . import proof, witness
from .network import ProposerNetwork
from .proposer import Proposers, networks
from .scenes import Scenes

Progress = Callable[[int, int], None]
ROOM = 2e-3
"""By this, non-dimensional, a posture must meet everything before nothing more is asked of it."""
BOUND = 1e-2
"""So much a proof must prove, its multipliers of unit length, before nothing more is asked of
it."""
SATURATED = 0.05
"""Where a loss v / (v + this) is one half."""
BLOCK = 512
"""Draws that the iteration is run on at once."""
RECORDS = 10
"""Points of a training curve."""


@dataclass(frozen=True, kw_only=True)
class ProposerSettings:
    """Settings of training proposers.

    Arguments:
        architecture: of either network.
        proofs, postures: steps of AdamW of each: more settle more problems, and take longer.
        batch: scenes a step.
        rate: of AdamW; it rises over the first twentieth and falls along a cosine.
        pool: scenes to learn from, fewer where so many draws leave fewer.
        easy: steps of the iteration that leave them open.
        held: draws that the training curve is taken on, as they come.
        seed: of draws and weights.
    """

    architecture: Architecture = field(default_factory=lambda: Architecture(width=64, layers=2))
    proofs: PositiveInt = 1300
    postures: PositiveInt = 500
    batch: PositiveInt = 256
    rate: PositiveFloat = 3e-3
    pool: PositiveInt = 32768
    draws: PositiveInt = 131072
    easy: PositiveInt = 24
    held: PositiveInt = 2048
    seed: NonNegativeInt = 0

    def __post_init__(self) -> None:
        check_fields(self)


def train_proposers(
    source: Distribution,
    settings: ProposerSettings = ProposerSettings(),
    progress: Progress | None = None,
) -> Proposers:
    """Train both networks on draws of a distribution; uses one torch thread.

    Equal settings give equal networks.

    Arguments:
        progress: told steps done and in all.

    Raises:
        InvalidInput: for problems that are not on triangles.
    """
    torch.set_num_threads(1)
    rng = np.random.default_rng(settings.seed)
    scenes = source.batch(rng, settings.held)
    _check(scenes)
    held, pool = Scenes.of(ScaledBatch.of(scenes)), _left_open(source, rng, settings)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        both = networks(settings.architecture)
    history, done = dict[str, list[dict[str, float]]](), 0
    for name in ("proofs", "postures"):
        cast(ProposerNetwork, both[name]).encoder.fit_scales(pool.observed())
        history[name] = []
        for step, record in _descent(name, both[name], pool, held, settings):
            history[name] += record
            if progress is not None:
                progress(done + step, settings.proofs + settings.postures)
        done += settings.proofs
    return Proposers(
        both,
        problem_class=source.name,
        legs=scenes.like.legs,
        robot=scenes.like.robot.identity,
        force_scale_n=cast(float, scenes.like.force_scale_n),
        length_scale_m=scenes.like.length_scale_m,
        provenance={
            "method": "proposers",
            "settings": asdict(settings),
            "scenes": len(pool),
            "history": history,
        },
    )


def _left_open(
    source: Distribution, rng: np.random.Generator, settings: ProposerSettings
) -> Scenes:
    """Draws that the fixed iteration leaves open.

    Raises InvalidInput where there is none.
    """
    batches, open_, count = list[ScaledBatch](), 0, 0
    while open_ < settings.pool and count < settings.draws:
        scaled = ScaledBatch.of(source.batch(rng, BLOCK))
        index, _ = witnesses(scaled, settings.easy)
        batches.append(scaled.select(np.setdiff1d(np.arange(len(scaled)), index)))
        open_, count = open_ + len(batches[-1]), count + len(scaled)
    if not open_:
        raise InvalidInput(
            f"problems: expected some that are hard, got {count} that {settings.easy} steps solve"
        )
    names = ("vertices", "frames", "friction")
    parts: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in batches]) for name in names
    }
    return Scenes.of(replace(batches[0], **parts))


def _descent(
    name: str, network: nn.Module, pool: Scenes, held: Scenes, settings: ProposerSettings
) -> Iterator[tuple[int, list[dict[str, float]]]]:
    """Train one network; after every step how many there were, and, now and then, how it does on
    held scenes.
    """
    steps, chance = int(getattr(settings, name)), torch.Generator().manual_seed(settings.seed)
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-4)
    order = torch.zeros(0, dtype=torch.long)
    for step in range(1, steps + 1):
        done = step / steps
        for group in optimizer.param_groups:
            group["lr"] = (
                settings.rate
                * min(1.0, 20.0 * done)
                * max(0.01, 0.5 * (1.0 + math.cos(math.pi * done)))
            )
        if not len(order):
            order = torch.randperm(len(pool), generator=chance)
        rows, order = order[: settings.batch], order[settings.batch :]
        short = lacks(name, network, pool[rows])
        optimizer.zero_grad()
        torch.autograd.backward((short / (short + SATURATED)).mean())
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        last = step == steps or step % max(steps // RECORDS, 1) == 0
        yield step, [{"step": step, "settled": settled(name, network, held)}] if last else []


def lacks(name: str, network: nn.Module, scenes: Scenes) -> Tensor:
    """Shortfall of every proposal, at least 0: of postures shape (B, 1), of proofs (B, 2)."""
    outputs = network(scenes.observed())
    if name == "postures":
        return torch.relu(witness.claims(scenes, *outputs).violation + ROOM).sum(
            dim=1, keepdim=True
        )
    return torch.relu(BOUND - proof.least_values(scenes, proof.multipliers(*outputs)))


def settled(name: str, network: nn.Module, scenes: Scenes) -> float:
    """The share of scenes that a network settles by its own sums, in single precision."""
    with torch.no_grad():
        outputs = network(scenes.observed())
        if name == "postures":
            return float(
                (witness.claims(scenes, *outputs).violation.amax(dim=1) < 0.0).double().mean()
            )
        values = proof.least_values(scenes, proof.multipliers(*outputs))
        return float((values.amax(dim=1) > 1e-4).double().mean())


def _check(batch: PostureBatch) -> None:
    corners = batch.vertices_m.shape[2]
    if corners != CORNERS:
        raise InvalidInput(
            f"problems: expected patches of {CORNERS} corners to learn proposals from, got "
            f"{corners}"
        )


def curve(proposers: Proposers) -> dict[str, Any]:
    """The share of held scenes that each network settled at the end of its training."""
    return {name: points[-1]["settled"] for name, points in proposers.provenance["history"].items()}
