"""Configuration of a training run: a typed file whose keys are checked all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import SceneKind
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_yaml, validated

from ..data.labelling import Quota
from ..selectors.policy import EnvironmentName, PolicyShape


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """Knobs of PPO.

    Arguments:
        rollout: steps of every sub-environment between updates.
        rate: falls linearly to a tenth.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    rate: Annotated[float, Field(gt=0.0)] = 1e-3
    rollout: Annotated[int, Field(ge=1)] = 64
    batch: Annotated[int, Field(ge=2)] = 512
    epochs: Annotated[int, Field(ge=1)] = 10
    clip: Annotated[float, Field(gt=0.0)] = 0.2
    entropy: Annotated[float, Field(ge=0.0)] = 0.0
    discount: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    hidden: Annotated[tuple[int, ...], Field(min_length=1)] = (128, 128)


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """One training run.

    Steps are rounded up to whole segments, and segments to whole rollouts.

    Arguments:
        problem: distribution.
        robot, terrain: files that it is of, where not the default hexapod and no terrain's.
        legs: of a class whose scenes are given, and which no distribution draws.
        train, held_out: how many labelled scenes to learn from and to evaluate on, and their seeds.
        envs: sub-environments.
        workers: their processes (selection only).
        base, offset, spread: the envelope whose bounds the policy moves, how far it may, and the
            initial standard deviation of that, as a share of offset (selection only).
        budget: solves per episode (refinement only).
        tensorboard: write its logs, too.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    environment: EnvironmentName
    problem: str
    steps: Annotated[int, Field(ge=1)]
    train: Quota
    held_out: Quota
    seed: Annotated[int, Field(ge=0)] = 0
    envs: Annotated[int, Field(ge=1)] = 16
    workers: Annotated[int, Field(ge=1)] = 1
    base: Literal["heuristic", "quantile"] = "quantile"
    offset: Annotated[float, Field(gt=0.0)] = 0.25
    spread: Annotated[float, Field(gt=0.0)] = 0.2
    budget: Annotated[int, Field(ge=1)] = 200
    evaluate_every: Annotated[int, Field(ge=1)] = 10_240
    tensorboard: bool = False
    ppo: PpoSettings = field(default_factory=PpoSettings)
    robot: str | None = None
    terrain: str | None = None
    legs: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if self.train.seed == self.held_out.seed:
            raise InvalidInput(
                f"held_out.seed: expected another seed than train.seed, got {self.train.seed} for "
                "both"
            )
        _ = self.kind  # refuses unknown distributions

    @classmethod
    def from_yaml(cls, path: str | Path, overrides: Mapping[str, Any] | None = None) -> TrainConfig:
        """Read a file, some of its keys replaced.

        Raises InvalidInput with every key that is wrong.
        """
        return validated(cls, read_yaml(path) | dict(overrides or {}), str(path))

    @cached_property
    def kind(self) -> SceneKind:
        """Class of the scenes."""
        if self.legs:
            return SceneKind(name=self.problem, legs=self.legs)
        source = distribution(self.problem, robot=self.robot, terrain=self.terrain)
        return SceneKind(name=source.name, legs=source.legs)

    @property
    def shape(self) -> PolicyShape:
        """The policy that is trained."""
        return PolicyShape(
            environment=self.environment,
            problem=self.kind.name,
            hidden=tuple(self.ppo.hidden),
            spread=self.spread,
            offset=self.offset,
            legs=() if self.kind.name == self.problem and not self.legs else self.kind.legs,
        )

    @property
    def segment(self) -> int:
        """Steps between evaluations: whole rollouts."""
        rollout = self.ppo.rollout * self.envs
        return -(-self.evaluate_every // rollout) * rollout
