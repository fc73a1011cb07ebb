"""Configuration of a training run: a typed file whose keys are checked all at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import LabelledScene, PooledScenes, SceneKind
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.answer.answer import Status
from stancekit.planners.arguments import cached_property
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import read_yaml, validated
from stancekit.planners.search.exact import BoxSearch

from ..data.labelling import Quota
from ..selectors.policy import EnvironmentName, PolicyShape, moved


def open_scenes(scenes: Sequence[LabelledScene]) -> list[LabelledScene]:
    """The scenes that the first box of ``EnvelopeRefinement-v0`` leaves open: those where cuts are
    needed.
    """
    programs = Programs()
    searches = (BoxSearch(scene.problem, Scaled.of(scene.problem), programs) for scene in scenes)
    return [
        scene
        for scene, search in zip(scenes, searches, strict=True)
        if search.verdict is Status.UNDECIDED
    ]


class SelectionVecEnv(VecEnv):
    """``EnvelopeSelection-v0`` in batches, as a stable-baselines3 environment.

    With ``base`` given the actions are moves of its bounds: base + offset · action
    (``policy_file.moved``), so that an untrained policy of small actions answers about as the base
    does.

    Arguments:
        base: shape (12N,).
    """

    def __init__(
        self, env: EnvelopeSelectionVectorEnv, *, base: Array | None = None, offset: float = 0.25
    ) -> None:
        self._env, self._base, self._offset = env, base, offset
        self._actions: NDArray[Any] = np.zeros(0)
        self.render_mode = None
        space = env.single_action_space
        if base is not None and (not isinstance(space, spaces.Box) or space.shape != base.shape):
            raise InvalidInput(f"base: expected bounds of shape {space.shape}, got {base.shape}")
        super().__init__(env.num_envs, env.single_observation_space, space)

    def reset(self) -> dict[str, NDArray[np.float32]]:
        """Draw the next scenes."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observation, _ = self._env.reset(seed=seeds)
        self._reset_seeds()
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions."""
        self._actions = actions if self._base is None else moved(self._base, self._offset, actions)

    def step_wait(
        self,
    ) -> tuple[
        dict[str, NDArray[np.float32]], NDArray[np.float64], NDArray[np.bool_], list[dict[str, Any]]
    ]:
        """Judge them."""
        observation, rewards, ended, _, infos = self._env.step(self._actions)
        final = {
            name: values for name, values in infos["final_info"].items() if not name.startswith("_")
        }
        rows = [
            {name: values[index] for name, values in final.items()}
            | {
                "terminal_observation": infos["final_obs"][index],
                "episode": {"r": rewards[index], "l": 1, "t": 0.0},
            }
            for index in range(self.num_envs)
        ]
        return observation, rewards, ended, rows

    def close(self) -> None:
        """Close the batch."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The batch's attribute, once a sub-environment."""
        return [getattr(self._env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: sub-environments share what they have."""
        raise StancekitError("the sub-environments of a batch have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refused: sub-environments share what they have."""
        raise StancekitError("the sub-environments of a batch have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Nothing is wrapped."""
        return [False for _ in self._get_indices(indices)]


def refinement_vec_env(
    kind: SceneKind, scenes: Sequence[LabelledScene], *, envs: int, budget: int
) -> DummyVecEnv:
    """``EnvelopeRefinement-v0`` in batches, one after the other in this process."""
    pool, programs = PooledScenes(scenes), Programs()
    return DummyVecEnv(
        [
            lambda: EnvelopeRefinementEnv(kind, budget=budget, scenes=pool, programs=programs)
            for _ in range(envs)
        ]
    )


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
