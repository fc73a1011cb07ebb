"""Reinforcement: PPO on both environments, in segments that can be resumed bit for bit.

A run is cut into segments of ``evaluate_every`` steps. Before each one every random stream is
seeded from the run's seed and the segment's number, and after each one the policy is evaluated on
held-out scenes and a checkpoint written. So a run that was stopped, however hard, goes on from its
last segment and ends with the same policy.
"""

from __future__ import annotations

import importlib.util
import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.utils import FloatSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor

from stancekit.envs.scenes import PooledScenes
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.writing import make_folder, write_text

from ..selectors.network import (
    check_shapes,
    load_optimiser,
    of_optimiser,
    read_tensors,
    undisturbed,
    write_tensors,
)
from ..selectors.policy import TrainedPolicy
from .baselines import SelectionVecEnv, refinement_vec_env
from .held_out import CurvePoint, Trained, TrainingScenes, evaluator
from .train_config import TrainConfig

_CHECKPOINT_FORMAT = "stancekit/training/2"
NAME = "checkpoint.safetensors"


def _write_checkpoint(
    folder: Path,
    config: TrainConfig,
    curve: Sequence[CurvePoint],
    weights: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
    **more: Any,
) -> None:
    """Write the checkpoint; then ``curve.jsonl``, which people read.

    Arguments:
        more: JSON-ready, into the header.
    """
    tensors = {f"policy.{name}": value for name, value in weights.items()}
    tensors |= of_optimiser(optimizer)
    header = {"config": asdict(config), "curve": [asdict(point) for point in curve], **more}
    write_tensors(folder / NAME, _CHECKPOINT_FORMAT, header, tensors)
    write_text(folder / "curve.jsonl", "".join(json.dumps(asdict(point)) + "\n" for point in curve))


def _read_checkpoint(
    path: Path, config: TrainConfig, module: torch.nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[dict[str, Any], list[CurvePoint]]:
    """Put weights and optimiser back as they were; return the header and the curve.

    Raises InvalidInput where the file is damaged, or of another configuration in more than
    ``steps``.
    """
    header, tensors = read_tensors(path, _CHECKPOINT_FORMAT)
    mine, theirs = json.loads(json.dumps(asdict(config))), header.get("config")
    if not isinstance(theirs, dict):
        raise InvalidInput(f"{path}: expected a configuration in the header, got none")
    odd = [key for key in mine if key not in ("steps", "workers") and mine[key] != theirs.get(key)]
    if odd:
        raise InvalidInput(
            f"{path}: {odd[0]}: expected {theirs.get(odd[0])} as in the run, got {mine[odd[0]]}"
        )
    wanted = {f"policy.{name}": tuple(value.shape) for name, value in module.state_dict().items()}
    check_shapes(
        path, wanted, {name: value for name, value in tensors.items() if name.startswith("policy.")}
    )
    module.load_state_dict({name.removeprefix("policy."): tensors[name] for name in wanted})
    load_optimiser(optimizer, tensors)
    return header, [CurvePoint(**point) for point in header["curve"]]


Progress = Callable[[int, int], None]
_log = logging.getLogger(__name__)


@undisturbed(0)
def train(
    config: TrainConfig,
    folder: Path,
    *,
    resume: bool = False,
    scenes: TrainingScenes | None = None,
    progress: Progress | None = None,
    labelling: Callable[[str, int, int], None] | None = None,
) -> Trained:
    """Train, and write ``policy.safetensors``, ``checkpoint.safetensors`` and ``curve.jsonl`` into
    the folder.

    Raises InvalidInput.

    Arguments:
        resume: go on from the folder's checkpoint, or from its labels where a run was stopped before
            there was one; the configuration must be the same but for ``steps``.
        scenes: None labels them in the folder.
        progress: gets steps done and in all.
        labelling: which data set, its rows done and in all.
    """
    checkpoint = folder / NAME
    if checkpoint.exists() and not resume:
        raise InvalidInput(f"{folder}: holds a run already: resume it, or choose another folder")
    if resume and not (folder.is_dir() and any(folder.iterdir())):
        raise InvalidInput(
            f"{folder}: expected labels or checkpoint.safetensors to resume from, got nothing"
        )
    make_folder(folder)
    scenes = scenes or TrainingScenes.label(config, folder, progress=labelling)
    env = _training_env(config, scenes)
    try:
        begun = checkpoint if resume and checkpoint.exists() else None
        return _Run(config, folder, scenes, env).go(begun, progress)
    finally:
        env.close()


class _Run:
    """A run between its environment and its folder."""

    def __init__(
        self, config: TrainConfig, folder: Path, scenes: TrainingScenes, env: VecEnv
    ) -> None:
        self._config, self._folder, self._scenes, self._env = config, folder, scenes, env
        self._curve: list[CurvePoint] = []
        kind, arguments = config.shape.policy
        ppo = config.ppo
        set_random_seed(config.seed)
        self._model = PPO(
            kind,
            env,
            learning_rate=ppo.rate,
            n_steps=ppo.rollout,
            n_epochs=ppo.epochs,
            batch_size=min(ppo.batch, ppo.rollout * config.envs),
            gamma=ppo.discount,
            gae_lambda=0.95,
            clip_range=ppo.clip,
            ent_coef=ppo.entropy,
            policy_kwargs=arguments,
            device="cpu",
            seed=config.seed,
        )
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
            self._config.shape,
            policy,
            self._scenes.base,
            steps=self._model.num_timesteps,
            provenance={"config": asdict(self._config), **self._scenes.origin},
        )

    def _judge(self) -> None:
        """Evaluate on the held-out scenes."""
        reward, figures = self._evaluate(self._policy())
        self._curve.append(
            CurvePoint(steps=self._model.num_timesteps, reward=reward, figures=figures)
        )
        for name, value in ({"reward": reward} | figures).items():
            self._model.logger.record(f"held_out/{name}", value)
        self._model.logger.dump(self._model.num_timesteps)

    def _store(self) -> None:
        """The checkpoint."""
        model, policy = self._model, self._model.policy
        _write_checkpoint(
            self._folder,
            self._config,
            self._curve,
            policy.state_dict(),
            policy.optimizer,
            steps=model.num_timesteps,
            updates=model._n_updates,
        )

    def _restore(self, path: Path) -> None:
        """Go back to the checkpoint.

        Raises InvalidInput where it is damaged or of another configuration.
        """
        model = self._model
        header, self._curve = _read_checkpoint(
            path, self._config, model.policy, model.policy.optimizer
        )
        model.num_timesteps, model._n_updates = int(header["steps"]), int(header["updates"])


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
        _log.warning(
            "tensorboard is not installed (pip install tensorboard): training goes on without its "
            "logs"
        )
        tensorboard = False
    return (
        configure(str(folder / "tensorboard"), ["tensorboard"]) if tensorboard else Logger(None, [])
    )
