"""The paired score function: a network of boxes that follows rewards of opposite actions on the
same scene.

One step ends an episode of ``EnvelopeSelection-v0``, so its return is the reward r(x, a) of one
action. About the network's action μ(x) the gradient of its mean over normal actions a = μ + σ e is
E[r(x, μ + σ e) e] / σ. Asking for opposite actions of the same scene,

    ∇_μ ≈ 1/K Σ_k (r(x, μ + σ e_k) − r(x, μ − σ e_k)) e_k / 2σ,

takes the scene itself out of the noise, which is by far its largest part: scenes differ by 1,
actions by hundredths. A run begins with a network that imitates the solutions (``NeuralSettings``),
and goes on from a checkpoint bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from stancekit.envs.scenes import ListedScenes
from stancekit.envs.selection_task import SelectionSettings, SelectionTask
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.validation import typed

from ..selectors.network import BoxNetwork, SceneTensors, as_arrays
from ..selectors.neural import NeuralSelector, fit_neural
from ..selectors.neural_training import NeuralSettings
from .checkpoint import read_checkpoint, write_checkpoint
from .held_out import CurvePoint, Trained, TrainingScenes, evaluator
from .train_config import TrainConfig

Progress = Callable[[int, int], None]


class PairedRun:
    """A run between its scenes and its folder.

    Raises InvalidInput where the scenes are no data set's rows.
    """

    def __init__(self, config: TrainConfig, folder: Path, scenes: TrainingScenes) -> None:
        if scenes.rows is None:
            raise InvalidInput("paired: expected rows of a data set to imitate, got scenes alone")
        self._config, self._folder, self._scenes, self._rows = config, folder, scenes, scenes.rows
        self._task = SelectionTask(
            config.kind, SelectionSettings(scenes=ListedScenes(scenes.train))
        )
        self._tensors = SceneTensors.of_problems([scene.scaled for scene in scenes.train])
        self._evaluate = evaluator(config, scenes.held_out)
        self._start = typed(
            NeuralSettings, {"seed": config.seed, **config.paired.start}, "paired.start"
        )
        self._curve: list[CurvePoint] = []
        self._steps = 0

    def go(self, checkpoint: Path | None, progress: Progress | None) -> Trained:
        """Imitate, or go on from a checkpoint; then update, segment by segment."""
        config = self._config
        if checkpoint is None:
            start = fit_neural(self._rows, self._start)
            self._network, self._room = start.network.train(), start.room
        else:
            self._network, self._room = BoxNetwork(self._start.architecture), 0.0
        self._optimizer = torch.optim.Adam(self._network.parameters(), lr=config.paired.rate)
        if checkpoint is None:
            self._judge()
        else:
            header, self._curve = read_checkpoint(
                checkpoint, config, self._network, self._optimizer
            )
            self._steps, self._room = int(header["steps"]), float(header["room"])
        total = -(-config.steps // config.segment) * config.segment
        while self._steps < total:
            if progress is not None:
                progress(self._steps, total)
            for _ in range(config.segment // config.paired.steps):
                self._update(self._steps / total)
            self._judge()
            write_checkpoint(
                self._folder,
                config,
                self._curve,
                self._network.state_dict(),
                self._optimizer,
                steps=self._steps,
                room=self._room,
            )
        if progress is not None:
            progress(self._steps, total)
        selector = self._selector()
        selector.save(self._folder / "policy.safetensors")
        return Trained(policy=selector, curve=tuple(self._curve))

    def _update(self, done: float) -> None:
        """One step of Adam.

        Arguments:
            done: share of the run.
        """
        settings = self._config.paired
        rng = np.random.default_rng(np.random.SeedSequence((self._config.seed, self._steps)))
        chosen = rng.integers(len(self._scenes.train), size=settings.scenes)
        mean = self._actions(self._tensors[torch.as_tensor(chosen)])
        slope = self._slope(as_arrays(mean)[0], chosen, rng)
        loss = -(torch.as_tensor(slope, dtype=mean.dtype) * mean).sum() / settings.scenes
        for group in self._optimizer.param_groups:
            group["lr"] = settings.rate * (1.0 - 0.9 * done)
        self._optimizer.zero_grad()
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(self._network.parameters(), 1.0)
        self._optimizer.step()
        self._steps += settings.steps

    def _actions(self, scenes: SceneTensors) -> Tensor:
        """The network's bounds, as the selector gives them but for the ends of the domain, shape
        (B, 12N).
        """
        low, high, _ = self._network(scenes)
        return torch.cat([(low - self._room).flatten(1), (high + self._room).flatten(1)], dim=1)

    def _slope(self, mean: Array, chosen: np.ndarray, rng: np.random.Generator) -> Array:
        """Slope of the mean reward of each scene in its action, shape (B, 12N)."""
        settings = self._config.paired
        noise = rng.standard_normal((len(mean), settings.pairs, mean.shape[1]))
        slopes = np.zeros_like(mean)
        for row, index in enumerate(chosen.tolist()):
            moved = settings.spread * np.concatenate([noise[row], -noise[row]])
            actions = np.clip(mean[row] + moved, -1.0, 1.0).astype(np.float32)
            verdicts = self._task.judge_all([self._scenes.train[index]] * len(actions), actions)
            ahead, behind = np.array([verdict.reward for verdict in verdicts]).reshape(2, -1)
            slopes[row] = (ahead - behind) @ noise[row] / (2.0 * settings.spread * settings.pairs)
        return slopes

    def _selector(self) -> NeuralSelector:
        """Selector that has been learned so far; its network is a copy."""
        network, like = BoxNetwork(self._network.architecture), self._scenes.train[0].scaled
        network.load_state_dict(self._network.state_dict())
        return NeuralSelector(
            network,
            problem_class=self._rows.problem_class,
            legs=self._rows.header.legs,
            force_scale_n=like.force_n,
            length_scale_m=like.length_m,
            room=self._room,
            provenance={**self._scenes.origin, "method": "paired", "config": asdict(self._config)},
        )

    def _judge(self) -> None:
        """Evaluate on the held-out scenes."""
        reward, figures = self._evaluate(self._selector())
        self._curve.append(CurvePoint(steps=self._steps, reward=reward, figures=figures))
