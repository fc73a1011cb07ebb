"""A chooser among several envelopes: the terrain decides which box P1 gets (Lin et al.'s one binary
a box, learned).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt
from torch import Tensor, nn
from torch.nn import functional

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.envs.selection import ADMITTED
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.documents import check_fields, validated
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick

from .network import (
    Architecture,
    ChoiceNetwork,
    SceneTensors,
    load_weights,
    read_tensors,
    undisturbed,
    write_tensors,
)

FORMAT = "stancekit/chooser/1"
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class ChooserSettings:
    """Settings of training a chooser.

    Arguments:
        epochs, batch, rate: of AdamW.
        projection: what a feasible problem costs that P1 admits but fix-p does not solve; a wrong
            answer of P1 costs 1.
        caution: how much more a feasible problem counts than an infeasible one.
    """

    architecture: Architecture = field(default_factory=lambda: Architecture(width=48, layers=2))
    epochs: PositiveInt = 20
    batch: PositiveInt = 64
    rate: PositiveFloat = 1e-3
    projection: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    caution: PositiveFloat = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self)


class Chooser(MemorylessPolicy):
    """A network that picks one envelope of a set for every scene."""

    name = "chooser"

    def __init__(self, network: ChoiceNetwork, envelopes: EnvelopeSet) -> None:
        self.network = network.eval()
        self.envelopes = envelopes
        self.provenance = envelopes.provenance
        self._actions = np.stack([envelope.to_vector() for envelope in envelopes.envelopes]).astype(
            np.float32
        )

    @undisturbed()
    def choose(self, observation: Observation) -> NDArray[np.int64]:
        """Index of the envelope for each scene, shape (B,): an action where the environment has the
        set as library.
        """
        with torch.no_grad():
            cost = self.network(SceneTensors.of_observation(observation, len(self.envelopes.legs)))
        return np.asarray(cost.argmin(dim=1).numpy(), dtype=np.int64)

    def action(self, observation: Observation) -> NDArray[Any]:
        """The chosen box's bounds, shape (12N,), or (B, 12N) for a batch."""
        actions = self._actions[self.choose(observation)]
        return actions if np.ndim(observation["friction"]) == 2 else actions[0]

    def save(self, path: str | Path) -> None:
        """Write network and envelopes as one safetensors file."""
        header = {
            "architecture": asdict(self.network.architecture),
            "envelopes": self.envelopes.to_json(),
        }
        write_tensors(path, FORMAT, header, self.network.state_dict())

    @classmethod
    @undisturbed()
    def load(cls, path: str | Path, *, problem_class: str | None = None) -> Chooser:
        """Read a chooser.

        Raises InvalidInput for a file that is damaged or foreign, or made for another class.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        try:
            envelopes = EnvelopeSet.from_json(raw.envelopes)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None
        if problem_class not in (None, envelopes.problem_class):
            raise InvalidInput(
                f"{path}: expected a chooser for {problem_class}, got one for "
                f"{envelopes.problem_class}"
            )
        with torch.device("meta"):
            network = ChoiceNetwork(raw.architecture, len(envelopes.envelopes))
        load_weights(network, tensors, path)
        return cls(network, envelopes)


@undisturbed()
def fit_chooser(
    dataset: Dataset,
    envelopes: EnvelopeSet,
    settings: ChooserSettings = ChooserSettings(),
    progress: Progress | None = None,
) -> Chooser:
    """Learn which envelope suits a terrain: the network predicts what each box costs, and the
    cheapest is chosen.

    The cost of every box on every row is solved for once (``costs``); ``progress`` gets rows
    solved and rows in all. Raises InvalidInput for a data set of another class or without rows of a
    label.
    """
    if dataset.problem_class != envelopes.problem_class:
        raise InvalidInput(
            f"envelopes: expected some for {dataset.problem_class}, got {envelopes.problem_class}"
        )
    kinds = (dataset.feasible, dataset.infeasible)
    if not all(len(rows) for rows in kinds):
        raise InvalidInput(
            f"data set: expected rows of both labels, got {len(kinds[0])} and {len(kinds[1])}"
        )
    problems = [Scaled.of(problem) for rows in kinds for problem in dataset.select(rows).problems()]
    feasible = np.arange(len(problems)) < len(kinds[0])
    cost = costs(
        problems,
        feasible,
        envelopes.envelopes,
        Programs(),
        projection=settings.projection,
        progress=progress,
    )
    weight = (
        np.where(feasible, settings.caution / len(kinds[0]), 1.0 / len(kinds[1]))
        * len(problems)
        / 2.0
    )
    targets, weights = (
        torch.as_tensor(array, dtype=torch.float32) for array in (cost, weight[:, None])
    )
    return Chooser(
        _train(SceneTensors.of_problems(problems), targets, weights, settings), envelopes
    )


def costs(
    problems: Sequence[Scaled],
    feasible: NDArray[np.bool_],
    envelopes: Sequence[Envelope],
    programs: Programs,
    *,
    projection: float = 0.5,
    progress: Progress | None = None,
) -> Array:
    """Cost of every box on every problem, shape (len(problems), K).

    1 where P1's answer is wrong; ``projection`` where it admits a feasible problem and fix-p does
    not solve it; else 0.

    Arguments:
        feasible: the labels, shape (len(problems),).
    """
    cost = np.zeros((len(problems), len(envelopes)))
    for i, problem in enumerate(problems):
        for k, envelope in enumerate(envelopes):
            answer = programs.get(McCormick, problem.layout).solve(problem, envelope)
            if not answer.known or answer.feasible != feasible[i]:
                cost[i, k] = 1.0
            elif feasible[i] and projection > 0.0 and answer.point is not None:
                solved = project(programs, "fix-p", problem, answer.point).residual <= ADMITTED
                cost[i, k] = 0.0 if solved else projection
        if progress is not None:
            progress(i + 1, len(problems))
    return cost


def _train(
    scenes: SceneTensors, cost: Tensor, weight: Tensor, settings: ChooserSettings
) -> ChoiceNetwork:
    """Regress every box's cost, shape (B, K), by cross-entropy.

    Minimising the expected cost of a softmax choice instead was tried: it settles on the one box
    that is best overall.

    Arguments:
        weight: of each row, shape (B, 1).
    """
    with undisturbed(settings.seed):
        network = ChoiceNetwork(settings.architecture, cost.shape[1])
    network.encoder.fit_scales(scenes)
    chance = torch.Generator().manual_seed(settings.seed)
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.epochs)
    for _ in range(settings.epochs):
        for rows in torch.split(torch.randperm(len(scenes), generator=chance), settings.batch):
            loss = functional.binary_cross_entropy_with_logits(
                network(scenes[rows]), cost[rows], weight=weight[rows]
            )
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
        schedule.step()
    return network


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    architecture: Annotated[Architecture, ALL_KEYS]
    envelopes: dict[str, Any]
