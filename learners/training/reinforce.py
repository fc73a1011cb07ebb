"""Reinforcement: PPO on both environments, in segments that can be resumed bit for bit; its file,
its scenes, and how it is judged.

A run is cut into segments of ``evaluate_every`` steps. Before each one every random stream is
seeded from the run's seed and the segment's number, and after each one the policy is evaluated on
held-out scenes and a checkpoint written. So a run that was stopped, however hard, goes on from its
last segment and ends with the same policy.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import Field
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.utils import FloatSchedule, set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import LabelledScene, ListedScenes, PooledScenes, SceneKind
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.answer.answer import Status
from stancekit.planners.arguments import cached_property
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput, StancekitError, package_command
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import Strict, read_yaml, typed, validated
from stancekit.planners.files.writing import make_folder, write_text
from stancekit.planners.search.exact import BoxSearch
from stancekit.runner.control.envelope_choice import Predictor

from ..data.labelling import Progress, Quota, label
from ..selectors.network import Descent, undisturbed
from ..selectors.neural import NeuralSelector, NeuralSettings, fit_neural, kept_apart
from ..selectors.policy import (
    EnvironmentName,
    PolicyShape,
    TrainedPolicy,
    bounds_of,
    moved,
)
from .fitting import FitRequest, fit
from .loop import Checkpoint, Record, State, StepsDone, run


@dataclass(frozen=True, kw_only=True)
class PpoSettings(Strict):
    """Knobs of PPO.

    Arguments:
        rollout: steps of every sub-environment between updates.
        rate: falls linearly to a tenth.
    """

    rate: Annotated[float, Field(gt=0.0)] = 1e-3
    rollout: Annotated[int, Field(ge=1)] = 64
    batch: Annotated[int, Field(ge=2)] = 512
    epochs: Annotated[int, Field(ge=1)] = 10
    clip: Annotated[float, Field(gt=0.0)] = 0.2
    entropy: Annotated[float, Field(ge=0.0)] = 0.0
    discount: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    hidden: Annotated[tuple[int, ...], Field(min_length=1)] = (128, 128)


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Strict):
    """One training run.

    Steps are rounded up to whole segments, and segments to whole rollouts.

    Arguments:
        problem: name of the distribution.
        robot, terrain: files of the robot and the terrain; by default the hexapod, and none.
        legs: limbs of a class whose scenes are given, and which no distribution draws.
        train: labelled scenes to learn from.
        held_out: labelled scenes to evaluate on.
        envs: number of sub-environments.
        workers: number of their processes (selection only).
        base, offset, spread: the envelope whose bounds the policy moves, how far it may, and the
            initial standard deviation of that, as a share of offset (selection only).
        budget: solves per episode (refinement only).
        tensorboard: write its logs, too.
    """

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


_Figures = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """A point of the learning curve: steps so far, mean reward an episode on held-out scenes, and
    further figures.
    """

    steps: int
    reward: float
    figures: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """Result of a run."""

    policy: TrainedPolicy
    curve: tuple[CurvePoint, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingScenes:
    """Scenes that a run learns from, and scenes on which it is evaluated.

    Arguments:
        base: bounds, shape (12N,), empty where nothing is selected.
        rows: those that ``train`` are of, where they are a data set's.
    """

    train: Sequence[LabelledScene]
    held_out: Sequence[LabelledScene]
    base: Array
    rows: Dataset | None = None

    @property
    def origin(self) -> dict[str, str]:
        """Origin of the rows learned from, see ``Dataset.origin``; empty where they come from no
        data set.
        """
        return {} if self.rows is None else self.rows.origin

    @classmethod
    def label(
        cls,
        config: TrainConfig,
        folder: Path,
        *,
        workers: int = 1,
        progress: Callable[[str, int, int], None] | None = None,
    ) -> TrainingScenes:
        """Make both data sets in a folder, or use those that are there.

        Arguments:
            progress: gets the stage, rows done and all.
        """
        sets = []
        for name, quota in (("train", config.train), ("held-out", config.held_out)):
            plan = LabelPlan(
                distribution=config.problem,
                robot=config.robot,
                terrain=config.terrain,
                shard_size=125,
                **asdict(quota),
            )
            watched = (
                None if progress is None else partial(_tell, progress, f"label {name}", plan.rows)
            )
            label(plan, folder / name, workers=workers, progress=watched)
            sets.append(Dataset.open(folder / name))
        scenes = [scenes_of(dataset) for dataset in sets]
        if config.shape.selects:
            base = bounds_of(fit(config.base, sets[0]).envelopes[0])
            return cls(train=scenes[0], held_out=scenes[1], base=base, rows=sets[0])
        cut = [open_scenes(part) for part in scenes]
        for name, quota, left in zip(
            ("train", "held_out"), (config.train, config.held_out), cut, strict=True
        ):
            if not left:
                wanted = quota.feasible + quota.infeasible
                raise InvalidInput(
                    f"{name}: expected scenes that need cuts, found none among {wanted}: ask for "
                    "more"
                )
        return cls(train=cut[0], held_out=cut[1], base=np.zeros(0), rows=sets[0])


def _tell(
    progress: Callable[[str, int, int], None], stage: str, rows: int, state: Progress
) -> None:
    progress(f"{stage}: {rows} rows", state.rows, rows)


def evaluator(
    config: TrainConfig, scenes: Sequence[LabelledScene]
) -> Callable[[Predictor], tuple[float, _Figures]]:
    """A function that plays every scene once with a policy: mean reward an episode, and figures.

    Selection: ``p1_feasible``, ``p1_infeasible`` (shares that P1 answers as the expert does),
    ``projected`` (of the feasible). Refinement: ``solves`` an episode, ``settled`` (share that
    ended with a verdict).
    """
    if config.shape.selects:
        selection = EnvelopeSelectionEnv(config.kind, scenes=ListedScenes(scenes))
        return lambda policy: _selection_figures(policy, selection, len(scenes))
    refinement = EnvelopeRefinementEnv(
        config.kind, budget=config.budget, scenes=ListedScenes(scenes)
    )
    return lambda policy: _refinement_figures(policy, refinement, len(scenes))


def _selection_figures(
    policy: Predictor, env: EnvelopeSelectionEnv, episodes: int
) -> tuple[float, _Figures]:
    rewards, projected = [], []
    right: dict[int, list[float]] = {0: [], 1: []}
    for _ in range(episodes):
        observation, _ = env.reset()
        _, reward, _, _, info = env.step(policy.predict(observation, deterministic=True)[0])
        rewards.append(reward)
        right[info["label"]].append(float(info["p1_right"]))
        if info["label"]:
            projected.append(float(info["project_fix_p"]))
    shares = {"p1_feasible": right[1], "p1_infeasible": right[0], "projected": projected}
    return float(np.mean(rewards)), {
        name: float(np.mean(values)) for name, values in shares.items() if values
    }


def _refinement_figures(
    policy: Predictor, env: EnvelopeRefinementEnv, episodes: int
) -> tuple[float, _Figures]:
    reward, solves, settled = refinement_episodes(policy, env, episodes).mean(axis=0).tolist()
    return reward, {"solves": solves, "settled": settled}


def refinement_episodes(policy: Predictor, env: EnvelopeRefinementEnv, episodes: int) -> Array:
    """Reward, solves, and whether it ended with a verdict (1 or 0), of every episode, shape
    (episodes, 3).
    """
    figures = np.zeros((episodes, 3))
    for row in figures:
        observation, _ = env.reset()
        total, over = 0.0, False
        while not over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, reward, ended, cut_off, info = env.step(np.int64(action))
            total, over = total + reward, ended or cut_off
        row[:] = total, info["solves"], info["verdict"] >= 0
    return figures


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


NAME = "checkpoint.npz"
_FREE = ("steps", "workers")
"""Settings in which a run that is gone on with may be another."""
_log = logging.getLogger(__name__)


@undisturbed(0)
def train(
    config: TrainConfig,
    folder: Path,
    *,
    resume: bool = False,
    scenes: TrainingScenes | None = None,
    progress: StepsDone | None = None,
    labelling: Callable[[str, int, int], None] | None = None,
) -> Trained:
    """Train, and write ``policy.safetensors``, ``checkpoint.npz`` and ``curve.jsonl`` into
    the folder.

    Raises InvalidInput.

    Arguments:
        resume: go on from the folder's checkpoint, or from its labels where a run was stopped before
            there was one; the configuration must be the same but for ``steps``.
        scenes: None labels them in the folder.
        progress: gets steps done and in all.
        labelling: which data set, its rows done and in all.
    """
    checkpoint, kept = folder / NAME, sorted(folder.glob("checkpoint.*"))
    if kept and not resume:
        raise InvalidInput(f"{folder}: holds a run already: resume it, or choose another folder")
    if kept and checkpoint not in kept:
        raise InvalidInput(f"{kept[0]}: expected {NAME} to resume from, got another kind's")
    if resume and not (folder.is_dir() and any(folder.iterdir())):
        raise InvalidInput(f"{folder}: expected labels or {NAME} to resume from, got nothing")
    make_folder(folder)
    scenes = scenes or TrainingScenes.label(config, folder, progress=labelling)
    env = _training_env(config, scenes)
    about = {name: value for name, value in asdict(config).items() if name not in _FREE}
    try:
        fit = _Run(config, folder, scenes, env)
        run(
            fit,
            None if progress is None else partial(_steps_done, progress, config.segment),
            Checkpoint(path=checkpoint, about=about),
        )
        policy = fit.policy()
    finally:
        env.close()
    policy.save(folder / "policy.safetensors")
    return Trained(policy=policy, curve=tuple(fit.curve))


def _steps_done(progress: StepsDone, segment: int, done: int, total: int) -> None:
    progress((done - 1) * segment, (total - 1) * segment)


class _Run(Descent):
    """A run between its environment and its folder: first the untrained policy is judged, then every
    step is a segment.
    """

    def __init__(
        self, config: TrainConfig, folder: Path, scenes: TrainingScenes, env: VecEnv
    ) -> None:
        self._config, self._folder, self._scenes, self._env = config, folder, scenes, env
        self.curve: list[CurvePoint] = []
        self.total = 1 - (-config.steps // config.segment)
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
        self.network, self.optimiser = self._model.policy, self._model.policy.optimizer
        self._evaluate = evaluator(config, scenes.held_out)

    def step(self, number: int) -> Record:
        """Train a segment, from the second step on, and judge on the held-out scenes."""
        config, model = self._config, self._model
        if number:
            entropy = np.random.SeedSequence((config.seed, number - 1))
            seed = int(entropy.generate_state(1)[0]) >> 1
            set_random_seed(seed)
            self._env.seed(seed)
            model._last_obs = None  # the environments begin anew
            share = (number - 1) / (self.total - 1)
            model.lr_schedule = FloatSchedule(config.ppo.rate * (1.0 - 0.9 * share))
            model.learn(config.segment, reset_num_timesteps=False, log_interval=10**9)
        reward, figures = self._evaluate(self.policy())
        for name, value in ({"reward": reward} | figures).items():
            model.logger.record(f"held_out/{name}", value)
        model.logger.dump(model.num_timesteps)
        self.curve.append(CurvePoint(steps=model.num_timesteps, reward=reward, figures=figures))
        lines = [json.dumps(asdict(point)) + "\n" for point in self.curve]
        write_text(self._folder / "curve.jsonl", "".join(lines))
        return asdict(self.curve[-1])

    def policy(self) -> TrainedPolicy:
        """A copy of the policy as it is now, which what comes later does not change."""
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

    def state(self) -> State:
        """Weights and optimiser, and how often they were updated."""
        return {**super().state(), "updates": np.array(self._model._n_updates)}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back, with the curve."""
        super().restore(state, history)
        self.curve = [CurvePoint(**record) for record in history]
        self._model.num_timesteps = self.curve[-1].steps
        self._model._n_updates = int(state["updates"])


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
        how = package_command("tensorboard")
        _log.warning(f"tensorboard is not installed ({how}): training goes on without its logs")
        tensorboard = False
    return (
        configure(str(folder / "tensorboard"), ["tensorboard"]) if tensorboard else Logger(None, [])
    )


_JOINT_TARGET = 0.99
"""Share of the feasible rows that the joint P1 must admit where nothing is said: chosen on
validation rows."""


def neural(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box."""
    knobs = typed(NeuralSettings, request.settings.neural, "neural")
    return fit_neural(
        request.dataset,
        knobs,
        request.progress,
        calibration=request.calibration,
        checkpoint=request.checkpoint,
    )


def joint(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box and point, for the P1 that is joined with the lift."""
    settings = request.settings
    joint_settings = replace(
        settings, neural={"target": _JOINT_TARGET, **settings.neural, "relaxation": "joint"}
    )
    return neural(replace(request, settings=joint_settings))


def reinforcement(request: FitRequest) -> TrainedPolicy | NeuralSelector:
    """A policy trained on the data set's scenes; its learning curve is drawn on the calibration
    rows.
    """
    dataset, calibration, settings = request.dataset, request.calibration, request.settings
    learned, held_out = (
        (dataset, calibration)
        if calibration is not None
        else kept_apart(dataset, 0.15, ("feasible", "infeasible"))
    )
    count = {
        "feasible": len(learned.feasible),
        "infeasible": len(learned.infeasible),
        "seed": learned.header.plan.seed,
    }
    config = settings.training(
        dataset.problem_class, dataset.header.legs if dataset.robot else None, count
    )
    base = bounds_of(fit(config.base, dataset, settings).envelopes[0])
    scenes = TrainingScenes(
        train=scenes_of(learned), held_out=scenes_of(held_out), base=base, rows=learned
    )
    with tempfile.TemporaryDirectory() as spare:
        where = request.checkpoint or Path(spare)
        make_folder(where)
        resume = (where / NAME).exists()
        return train(config, where, resume=resume, scenes=scenes, progress=request.progress).policy
