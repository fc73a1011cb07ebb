"""Reinforcement learns what it should, resumes bit for bit, and its files are read without
pickle.
"""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.episodes import MemorylessPolicy, RewardWeights, largest_gap
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import ListedScenes, PooledScenes, SampledScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.learners.data.labelling import Quota
from stancekit.learners.selectors.policy import PolicyShape, TrainedPolicy, bounds_of, moved
from stancekit.learners.selectors.selector import FixedSelector, heuristic_envelope
from stancekit.learners.training.reinforce import (
    PpoSettings,
    SelectionVecEnv,
    TrainConfig,
    TrainingScenes,
    evaluator,
    open_scenes,
    refinement_vec_env,
    train,
)
from tests.refusals import refuses

SELECTION, REFINEMENT = "stancekit/EnvelopeSelection-v0", "stancekit/EnvelopeRefinement-v0"


def config(**changes):
    given = {
        "environment": SELECTION,
        "problem": "wall-3",
        "steps": 64,
        "envs": 4,
        "evaluate_every": 32,
        "base": "heuristic",
        "train": Quota(feasible=6, infeasible=6, seed=0),
        "held_out": Quota(feasible=4, infeasible=4, seed=1),
        "ppo": PpoSettings(rollout=8, batch=16, epochs=2, hidden=(16,)),
    }
    return TrainConfig(**(given | changes))


@pytest.fixture(scope="module")
def drawn():
    source, rng = SampledScenes(distribution("wall-3")), np.random.default_rng(0)
    return [source.draw(rng) for _ in range(40)]


@pytest.fixture(scope="module")
def scenes(drawn):
    base = bounds_of(heuristic_envelope("wall-3", [scene.problem for scene in drawn]).envelopes[0])
    return TrainingScenes(train=drawn[:28], held_out=drawn[28:], base=base)


@pytest.fixture(scope="module")
def cut(drawn):
    found = open_scenes(drawn)
    return TrainingScenes(train=found, held_out=found[:3], base=np.zeros(0))


def tensors_of(policy):
    return {name: value.numpy() for name, value in policy.policy.state_dict().items()}


def assert_equal(one, other):
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("name", [SELECTION, REFINEMENT])
def test_a_run_that_was_stopped_ends_as_one_that_was_not(name, scenes, cut, tmp_path):
    given = scenes if name == SELECTION else cut
    whole = config(environment=name, budget=30)
    straight = train(whole, tmp_path / "straight", scenes=given)
    first = train(replace(whole, steps=32), tmp_path / "halves", scenes=given)
    halves = train(whole, tmp_path / "halves", resume=True, scenes=given)
    assert [point.steps for point in halves.curve] == [0, 32, 64]
    assert [asdict_(point) for point in halves.curve] == [
        asdict_(point) for point in straight.curve
    ]
    assert_equal(tensors_of(halves.policy), tensors_of(straight.policy))
    changed = [
        not np.array_equal(a, b)
        for a, b in zip(
            tensors_of(first.policy).values(), tensors_of(halves.policy).values(), strict=True
        )
    ]
    assert any(changed)
    loaded = TrainedPolicy.load(tmp_path / "halves" / "policy.safetensors")
    assert loaded.steps == 64
    assert_equal(tensors_of(loaded), tensors_of(straight.policy))
    env = (
        EnvelopeSelectionEnv()
        if name == SELECTION
        else EnvelopeRefinementEnv(scenes=ListedScenes(given.held_out))
    )
    observation, _ = env.reset(seed=1)
    action, state = loaded.predict(observation)
    assert state is None
    assert env.action_space.contains(action if name == SELECTION else np.int64(action))
    np.testing.assert_array_equal(action, straight.policy.predict(observation)[0])
    lines = (tmp_path / "halves" / "curve.jsonl").read_text().splitlines()
    assert [json.loads(line)["steps"] for line in lines] == [0, 32, 64]


def asdict_(point):
    return {"steps": point.steps, "reward": point.reward, **point.figures}


def test_it_learns_what_the_reward_says(drawn, tmp_path):
    """Only tightness is paid for: the boxes must shrink, and the reward rise."""
    env = EnvelopeSelectionVectorEnv(
        16,
        scenes=PooledScenes(drawn),
        weights=RewardWeights(agreement=0.0, projection=0.0, tightness=1.0),
    )
    base = np.concatenate([np.full(18, -0.5), np.full(18, 0.5)])
    torch.set_num_threads(1)
    vec = SelectionVecEnv(env, base=base, offset=0.25)
    kind, arguments = PolicyShape(environment=SELECTION, problem="wall-3", hidden=(16,)).policy
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = PPO(
            kind, vec, n_steps=16, learning_rate=3e-3, policy_kwargs=arguments, seed=0, device="cpu"
        )
    before, _ = evaluate_policy(model, vec, n_eval_episodes=16, warn=False)
    model.learn(2560)
    after, _ = evaluate_policy(model, vec, n_eval_episodes=16, warn=False)
    assert before == pytest.approx(0.5, abs=0.02)
    assert after > before + 0.03


def test_an_untrained_selector_answers_about_as_its_base(scenes):
    policy = TrainedPolicy(PolicyShape(environment=SELECTION, problem="wall-3"), None, scenes.base)
    policy.policy = policy.shape.build()
    observation, _ = EnvelopeSelectionEnv().reset(seed=0)
    np.testing.assert_allclose(policy.predict(observation)[0], scenes.base, atol=0.02)


def test_an_untrained_brancher_leans_to_the_largest_gap(cut):
    torch.manual_seed(0)
    policy = PolicyShape(environment=REFINEMENT, problem="wall-3", hidden=(16,)).build()
    env = EnvelopeRefinementEnv(scenes=ListedScenes(cut.train))
    agree = []
    for _ in range(12):
        observation, _ = env.reset(seed=0 if not agree else None)
        action, _ = policy.predict(observation, deterministic=True)
        gap = observation["gap"]
        agree.append(gap[int(action)] > 0.9 * gap.max())
        assert int(MemorylessPolicy(largest_gap).predict(observation)[0]) < 18
    assert np.mean(agree) > 0.9


def test_moves_stay_in_the_domain():
    base = np.array([-0.95, 0.0, 0.95])
    found = moved(base, 0.1, np.array([[-1.0, 1.0, 1.0]], dtype=np.float32))
    np.testing.assert_allclose(found, [[-1.0, 0.1, 1.0]], rtol=1e-6)
    assert found.dtype == np.float32


def test_adapters_reset_and_seed_as_the_batch_does(drawn):
    env = EnvelopeSelectionVectorEnv(3, scenes=PooledScenes(drawn))
    vec = SelectionVecEnv(env)
    vec.seed(4)
    seen = vec.reset()
    expected, _ = EnvelopeSelectionVectorEnv(3, scenes=PooledScenes(drawn)).reset(seed=4)
    assert_equal(seen, expected)
    actions = np.tile(
        np.concatenate([np.full(18, -0.4), np.full(18, 0.4)]).astype(np.float32), (3, 1)
    )
    _, rewards, ended, infos = vec.step(actions)
    assert ended.all()
    for index, info in enumerate(infos):
        assert info["episode"]["r"] == rewards[index]
        np.testing.assert_array_equal(
            info["terminal_observation"]["friction"], expected["friction"][index]
        )
    assert vec.get_attr("num_envs") == [3, 3, 3]
    with refuses("base"):
        SelectionVecEnv(env, base=np.zeros(3))


def test_evaluation_counts_what_it_says(drawn, cut):
    heuristic = heuristic_envelope("wall-3", [scene.problem for scene in drawn])
    reward, figures = evaluator(config(), drawn)(FixedSelector("heuristic", heuristic))
    assert set(figures) == {"p1_feasible", "p1_infeasible", "projected"}
    assert 0.3 < reward < 1.6
    assert all(0.0 <= value <= 1.0 for value in figures.values())
    rule = evaluator(config(environment=REFINEMENT, budget=40), cut.held_out)
    reward, figures = rule(MemorylessPolicy(largest_gap))
    assert reward == rule(MemorylessPolicy(largest_gap))[0]
    assert 2 <= figures["solves"] <= 50
    assert len(refinement_vec_env("wall-3", cut.train, envs=2, budget=40).reset()["gap"]) == 2


def test_files_that_are_not_policies_are_refused(scenes, tmp_path):
    shape = PolicyShape(environment=SELECTION, problem="wall-3", hidden=(8,))
    good = tmp_path / "policy.safetensors"
    TrainedPolicy(shape, shape.build(), scenes.base).save(good)
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(good.read_bytes()[:-100])
    with refuses("bad.safetensors"):
        TrainedPolicy.load(bad)
    torch.save({"policy": torch.zeros(3)}, bad)
    with refuses("bad.safetensors"):
        TrainedPolicy.load(bad)
    other = replace(shape, hidden=(9,))
    TrainedPolicy(shape, other.build(), scenes.base).save(bad)
    with refuses("bad.safetensors"):
        TrainedPolicy.load(bad)


def test_runs_are_not_mixed_up(scenes, tmp_path):
    train(config(steps=32), tmp_path / "run", scenes=scenes)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "checkpoint.safetensors").touch()
    for folder, resume, changes, name in (
        ("none", True, {}, "checkpoint.npz"),
        ("run", False, {}, "run"),
        ("run", True, {"offset": 0.3}, "offset"),
        ("old", False, {}, "old"),
        ("old", True, {}, "checkpoint.safetensors"),
    ):
        with refuses(name):
            train(config(**changes), tmp_path / folder, resume=resume, scenes=scenes)


GOOD = """
environment: stancekit/EnvelopeSelection-v0
problem: wall-3
steps: 100
train: {feasible: 2, infeasible: 2, seed: 0}
held_out: {feasible: 2, infeasible: 2, seed: 1}
"""


def test_a_config_tells_every_key_that_is_wrong(tmp_path):
    path = tmp_path / "train.yaml"
    path.write_text(GOOD)
    assert TrainConfig.from_yaml(path, {"steps": 7}).steps == 7
    path.write_text(GOOD + "speed: 9\nenvs: 0\nppo: {rate: fast, bathc: 3}\n")
    with refuses("speed", "envs", "ppo.rate", "ppo.bathc"):
        TrainConfig.from_yaml(path)
    for content, name in (
        (GOOD.replace("seed: 1", "seed: 0"), "held_out.seed"),
        (GOOD.replace("wall-3", "ceiling-3"), "distribution"),
        ("[1, 2]", "train.yaml"),
    ):
        path.write_text(content)
        with refuses(name):
            TrainConfig.from_yaml(path)
