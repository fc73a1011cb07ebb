"""The paired score function: the gradient it estimates, runs that go on bit for bit, and what is
refused.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.data.scenes import scenes_of
from stancekit.learners.data.labelling import label
from stancekit.learners.data.origin import check_unseen
from stancekit.learners.data.quota import Quota
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.learners.training.held_out import TrainingScenes
from stancekit.learners.training.paired import PairedRun
from stancekit.learners.training.reinforce import train
from stancekit.learners.training.train_config import PairedSettings, TrainConfig
from tests.refusals import refuses

SMALL = {"width": 16, "layers": 1, "heads": 2, "corner_width": 8}
START = {"architecture": SMALL, "epochs": 2, "margin_epochs": 0}


def config(**changes) -> TrainConfig:
    given = {
        "environment": "stancekit/EnvelopeSelection-v0",
        "method": "paired",
        "problem": "wall-3",
        "steps": 32,
        "evaluate_every": 16,
        "paired": PairedSettings(scenes=4, pairs=1, start=START),
        "train": Quota(feasible=16, infeasible=16, seed=0),
        "held_out": Quota(feasible=4, infeasible=4, seed=1),
    }
    return TrainConfig(**(given | changes))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> TrainingScenes:
    path = tmp_path_factory.mktemp("data") / "set"
    label(LabelPlan(distribution="wall-3", feasible=20, infeasible=16, shard_size=36, seed=3), path)
    rows = Dataset.open(path)
    listed = scenes_of(rows)
    return TrainingScenes(train=listed[:28], held_out=listed[28:], base=np.zeros(0), rows=rows)


def test_opposite_actions_of_one_scene_give_the_rewards_gradient(scenes, tmp_path):
    run = PairedRun(
        config(paired=PairedSettings(scenes=2, pairs=6000, spread=0.01, start=START)),
        tmp_path,
        scenes,
    )
    ways = {
        id(scene): np.random.default_rng(k).normal(size=36) for k, scene in enumerate(scenes.train)
    }

    def judged(its, actions):
        """Scenes that differ by far more than actions do; a smooth reward in each."""
        own = [ways[id(scene)] for scene in its]
        rewards = [
            100.0 * way[0] + np.sin(action @ way) for way, action in zip(own, actions, strict=True)
        ]
        return [SimpleNamespace(reward=reward) for reward in rewards]

    run._task = SimpleNamespace(judge_all=judged)
    mean, chosen = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 36)), np.array([3, 7])
    found = run._slope(mean, chosen, np.random.default_rng(2))
    for row, index in enumerate(chosen):
        way = ways[id(scenes.train[index])]
        exact = np.cos(mean[row] @ way) * way
        assert np.linalg.norm(found[row] - exact) < 0.15 * np.linalg.norm(
            way
        )  # 36 directions, 6000 samples


def test_a_run_goes_on_bit_for_bit_and_says_what_it_learned_from(scenes, tmp_path):
    whole = train(config(), tmp_path / "whole", scenes=scenes)

    def stop(done: int, _: int) -> None:
        if done == 16:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config(), tmp_path / "cut", scenes=scenes, progress=stop)
    after = train(config(), tmp_path / "cut", scenes=scenes, resume=True)
    assert [point.steps for point in whole.curve] == [0, 16, 32]
    assert whole.curve == after.curve
    name = "policy.safetensors"
    assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "cut" / name).read_bytes()
    assert len((tmp_path / "cut" / "curve.jsonl").read_text().splitlines()) == 3
    found = NeuralSelector.load(tmp_path / "cut" / name)
    with refuses():
        check_unseen(scenes.rows, found.provenance, "policy")


def test_learning_moves_the_network(scenes, tmp_path):
    first = train(config(steps=16), tmp_path / "first", scenes=scenes).policy.network.state_dict()
    second = train(config(), tmp_path / "second", scenes=scenes).policy.network.state_dict()
    assert any(not bool((first[name] == second[name]).all()) for name in first)


def test_what_it_cannot_learn_is_refused(scenes, tmp_path):
    with refuses("method"):
        config(environment="stancekit/EnvelopeRefinement-v0")
    with refuses("paired"):
        train(config(), tmp_path / "none", scenes=replace(scenes, rows=None))
    with refuses("paired"):
        train(config(paired=PairedSettings(start={"epoch": 3})), tmp_path / "odd", scenes=scenes)
