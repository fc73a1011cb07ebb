"""Reinforcement: PPO on both environments, in segments that can be resumed bit for bit.

A run is cut into segments of ``evaluate_every`` steps. Before each one every random stream is seeded from the run's
seed and the segment's number, and after each one the policy is evaluated on held-out scenes and a checkpoint written.
So a run that was stopped, however hard, goes on from its last segment and ends with the same policy.
"""

from __future__ import annotations

import importlib.util
import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.utils import FloatSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.data.scenes import scenes_of
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import ListedScenes, PooledScenes, Scene
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text

from ..data.labelling import label
from ..selectors.policy import TrainedPolicy, bounds_of, check_shapes
from ..selectors.selector import Selector
from ..selectors.tensors import read_tensors, write_tensors
from .baselines import SelectionVecEnv, open_scenes, refinement_vec_env
from .envelope_methods import fit
from .train_config import TrainConfig

CHECKPOINT_FORMAT = "stancekit/training/1"
Figures = dict[str, float]
Progress = Callable[[int, int], None]
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """A point of the learning curve: steps so far, mean reward an episode on held-out scenes, and further figures."""

    steps: int
    reward: float
    figures: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """What a run ended with."""

    policy: TrainedPolicy
    curve: tuple[CurvePoint, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingScenes:
    """What a run learns from and is evaluated on.

    base: bounds, shape (12N,), empty where nothing is selected. origin: of the rows learned from, ``Dataset.origin``.
    """

    train: Sequence[Scene]
    held_out: Sequence[Scene]
    base: Array
    origin: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def label(cls, config: TrainConfig, folder: Path, *, workers: int = 1) -> TrainingScenes:
        """Make both data sets in a folder, or use those that are there."""
        sets = []
        for name, quota in (("train", config.train), ("held-out", config.held_out)):
            plan = LabelPlan(
                distribution=config.problem, robot=config.robot, terrain=config.terrain, shard_size=125, **asdict(quota)
            )  # fmt: skip
            label(plan, folder / name, workers=workers)
            sets.append(Dataset.open(folder / name))
        scenes = [scenes_of(dataset) for dataset in sets]
        if config.shape.selects:
            base = bounds_of(fit(config.base, sets[0]).envelopes[0])
            return cls(train=scenes[0], held_out=scenes[1], base=base, origin=sets[0].origin)
        cut = [open_scenes(part) for part in scenes]
        for name, quota, left in zip(("train", "held_out"), (config.train, config.held_out), cut, strict=True):
            if not left:
                asked = quota.feasible + quota.infeasible
                raise InvalidInput(f"{name}: expected scenes that need cuts, found none among {asked}: ask for more")
        return cls(train=cut[0], held_out=cut[1], base=np.zeros(0), origin=sets[0].origin)


def train(
    config: TrainConfig,
    folder: Path,
    *,
    resume: bool = False,
    scenes: TrainingScenes | None = None,
    progress: Progress | None = None,
) -> Trained:
    """Train, and write ``policy.safetensors``, ``checkpoint.safetensors`` and ``curve.jsonl`` into the folder.

    resume: go on from the folder's checkpoint; its configuration must be the same but for ``steps``. scenes: None
    labels them in the folder. progress: told steps done and in all. Uses one torch thread. Raises InvalidInput.
    """
    torch.set_num_threads(1)
    checkpoint = folder / "checkpoint.safetensors"
    if checkpoint.exists() and not resume:
        raise InvalidInput(f"{folder}: holds a run already: resume it, or choose another folder")
    if resume and not checkpoint.exists():
        raise InvalidInput(f"{folder}: expected checkpoint.safetensors to resume from, found none")
    folder.mkdir(parents=True, exist_ok=True)
    scenes = scenes or TrainingScenes.label(config, folder)
    env = _training_env(config, scenes)
    try:
        return _Run(config, folder, scenes, env).go(checkpoint if resume else None, progress)
    finally:
        env.close()


class _Run:
    """A run between its environment and its folder."""

    def __init__(self, config: TrainConfig, folder: Path, scenes: TrainingScenes, env: VecEnv) -> None:
        self._config, self._folder, self._scenes, self._env = config, folder, scenes, env
        self._curve: list[CurvePoint] = []
        kind, arguments = config.shape.policy
        ppo = config.ppo
        set_random_seed(config.seed)
        self._model = PPO(
            kind, env, learning_rate=ppo.rate, n_steps=ppo.rollout, n_epochs=ppo.epochs,
            batch_size=min(ppo.batch, ppo.rollout * config.envs), gamma=ppo.discount, gae_lambda=0.95,
            clip_range=ppo.clip, ent_coef=ppo.entropy,
            policy_kwargs=arguments, device="cpu", seed=config.seed,
        )  # fmt: skip
        self._model.set_logger(_logger(folder, config.tensorboard))
        self._evaluate = evaluator(config, scenes.held_out)

    def go(self, checkpoint: Path | None, progress: Progress | None) -> Trained:
        """Train segment by segment."""
        config, model = self._config, self._model
        segments = -(-config.steps // config.segment)
        if checkpoint is not None:
            self._restore(checkpoint)
        else:
            self._judge()
        while (number := model.num_timesteps // config.segment) < segments:
            if progress is not None:
                progress(model.num_timesteps, segments * config.segment)
            seed = int(np.random.SeedSequence((config.seed, number)).generate_state(1)[0]) >> 1
            set_random_seed(seed)
            self._env.seed(seed)
            model._last_obs = None  # the environments begin anew
            share = number / segments
            model.lr_schedule = FloatSchedule(config.ppo.rate * (1.0 - 0.9 * share))
            model.learn(config.segment, reset_num_timesteps=False, log_interval=10**9)
            self._judge()
            self._store()
        if progress is not None:
            progress(model.num_timesteps, segments * config.segment)
        policy = self._policy()
        policy.save(self._folder / "policy.safetensors")
        return Trained(policy=policy, curve=tuple(self._curve))

    def _policy(self) -> TrainedPolicy:
        # its own copy: what comes later must not change it
        policy = self._config.shape.build()
        policy.load_state_dict(self._model.policy.state_dict())
        policy.set_training_mode(False)
        return TrainedPolicy(
            self._config.shape, policy, self._scenes.base, steps=self._model.num_timesteps,
            provenance={"config": asdict(self._config), **self._scenes.origin},
        )  # fmt: skip

    def _judge(self) -> None:
        """Evaluate on the held-out scenes."""
        reward, figures = self._evaluate(self._policy())
        self._curve.append(CurvePoint(steps=self._model.num_timesteps, reward=reward, figures=figures))
        for name, value in ({"reward": reward} | figures).items():
            self._model.logger.record(f"held_out/{name}", value)
        self._model.logger.dump(self._model.num_timesteps)

    def _store(self) -> None:
        """The checkpoint, whole or not at all; then what people read."""
        model = self._model
        tensors = {f"policy.{name}": value for name, value in model.policy.state_dict().items()}
        for index, slot in model.policy.optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{index}.{name}": value for name, value in slot.items()}
        header = {
            "config": asdict(self._config), "steps": model.num_timesteps, "updates": model._n_updates,
            "curve": [asdict(point) for point in self._curve],
        }  # fmt: skip
        write_tensors(self._folder / "checkpoint.safetensors", CHECKPOINT_FORMAT, header, tensors)
        write_text(self._folder / "curve.jsonl", "".join(json.dumps(asdict(point)) + "\n" for point in self._curve))

    def _restore(self, path: Path) -> None:
        """Go back to the checkpoint. Raises InvalidInput where it is damaged or of another configuration."""
        header, tensors = read_tensors(path, CHECKPOINT_FORMAT)
        mine = json.loads(json.dumps(asdict(self._config)))
        theirs = header.get("config")
        if not isinstance(theirs, dict):
            raise InvalidInput(f"{path}: expected a configuration in the header, got none")
        odd = [key for key in mine if key not in ("steps", "workers") and mine[key] != theirs.get(key)]
        if odd:
            raise InvalidInput(f"{path}: {odd[0]}: expected {theirs.get(odd[0])} as in the run, got {mine[odd[0]]}")
        model = self._model
        policy = {f"policy.{name}": tuple(value.shape) for name, value in model.policy.state_dict().items()}
        check_shapes(path, policy, {name: value for name, value in tensors.items() if name.startswith("policy.")})
        model.policy.load_state_dict({name.removeprefix("policy."): tensors[name] for name in policy})
        state: dict[int, dict[str, Any]] = {}
        for name, value in tensors.items():
            if name.startswith("optimizer."):
                _, index, slot = name.split(".")
                state.setdefault(int(index), {})[slot] = value
        groups = model.policy.optimizer.state_dict()["param_groups"]
        model.policy.optimizer.load_state_dict({"state": state, "param_groups": groups})
        model.num_timesteps, model._n_updates = int(header["steps"]), int(header["updates"])
        self._curve = [CurvePoint(**point) for point in header["curve"]]


def evaluator(config: TrainConfig, scenes: Sequence[Scene]) -> Callable[[Selector], tuple[float, Figures]]:
    """A function that plays every scene once with a policy: mean reward an episode, and figures.

    Selection: ``p1_feasible``, ``p1_infeasible`` (shares that P1 answers as the expert does), ``projected`` (of the
    feasible). Refinement: ``solves`` an episode, ``settled`` (share that ended with a verdict).
    """
    if config.shape.selects:
        selection = EnvelopeSelectionEnv(config.kind, scenes=ListedScenes(scenes))
        return lambda policy: _selection_figures(policy, selection, len(scenes))
    refinement = EnvelopeRefinementEnv(config.kind, budget=config.budget, scenes=ListedScenes(scenes))
    return lambda policy: _refinement_figures(policy, refinement, len(scenes))


def _selection_figures(policy: Selector, env: EnvelopeSelectionEnv, episodes: int) -> tuple[float, Figures]:
    rewards, projected = [], []
    right: dict[int, list[float]] = {0: [], 1: []}
    for _ in range(episodes):
        observation, _ = env.reset()
        _, reward, _, _, info = env.step(policy.predict(observation, deterministic=True)[0])
        rewards.append(reward)
        right[info["label"]].append(float(info["reward_agreement"] > 0.0))
        if info["label"]:
            projected.append(float(info["project_fix_p"]))
    shares = {"p1_feasible": right[1], "p1_infeasible": right[0], "projected": projected}
    return float(np.mean(rewards)), {name: float(np.mean(values)) for name, values in shares.items() if values}


def _refinement_figures(policy: Selector, env: EnvelopeRefinementEnv, episodes: int) -> tuple[float, Figures]:
    rewards, solves, settled = [], [], []
    for _ in range(episodes):
        observation, _ = env.reset()
        total, over = 0.0, False
        while not over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, reward, ended, cut_off, info = env.step(np.int64(action))
            total, over = total + reward, ended or cut_off
        rewards.append(total)
        solves.append(info["solves"])
        settled.append(info["verdict"] >= 0)
    return float(np.mean(rewards)), {"solves": float(np.mean(solves)), "settled": float(np.mean(settled))}


def _training_env(config: TrainConfig, scenes: TrainingScenes) -> VecEnv:
    if not config.shape.selects:
        return refinement_vec_env(config.kind, scenes.train, envs=config.envs, budget=config.budget)
    env = EnvelopeSelectionVectorEnv(
        config.envs, config.kind, scenes=PooledScenes(scenes.train), workers=config.workers
    )
    return SelectionVecEnv(env, base=scenes.base, offset=config.offset)


def _logger(folder: Path, tensorboard: bool) -> Logger:
    """TensorBoard's log where it is wanted and installed, else none: the curve is kept anyway."""
    if tensorboard and importlib.util.find_spec("tensorboard") is None:
        _log.warning("tensorboard is not installed (pip install tensorboard): training goes on without its logs")
        tensorboard = False
    return configure(str(folder / "tensorboard"), ["tensorboard"]) if tensorboard else Logger(None, [])
