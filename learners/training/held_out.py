"""Scenes of a training run, and its evaluation: labelled scenes, and episodes on those held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import LabelledScene, ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.runner.control.envelope_choice import Predictor

from ..data.labelling import Progress, label
from ..selectors.policy import TrainedPolicy, bounds_of
from .baselines import open_scenes
from .fitting import fit
from .train_config import TrainConfig

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
