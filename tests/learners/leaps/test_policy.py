"""Scores as a policy of MaskablePPO: what it begins with, what it plays, what it gives back."""

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib import MaskablePPO

import stancekit
import stancekit.envs
from stancekit.learners.leaps.policy import LeapScorer, ScorePolicy
from tests.refusals import refuses


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tries")
    tries = stancekit.label(
        "leap-base", folder / "base", scenes=5, tries={"random": 3, "rule": 3}, seed=8
    )
    stancekit.fit(tries, "set", epochs=2).write(folder / "set.safetensors")
    return folder / "set.safetensors"


def agent(begun, **options):
    env = gymnasium.make("stancekit/LeapChoice-v0", problem="leap-stairs", tries=1)
    return MaskablePPO(
        ScorePolicy,
        env,
        n_steps=4,
        batch_size=4,
        n_epochs=1,
        seed=0,
        device="cpu",
        policy_kwargs={"scorer": begun},
        **options,
    )


def test_before_it_learns_it_plays_the_scores_it_began_with_and_never_a_masked_candidate(begun):
    policy, scorer = agent(begun).policy, LeapScorer.read(begun)
    env, masked = gymnasium.make("stancekit/LeapChoice-v0", problem="leap-stairs", tries=1), 0
    for seed in range(6):
        observation, _ = env.reset(seed=seed)
        mask = env.unwrapped.action_masks().reshape(8, -1)
        masked += int((~mask).sum())
        best, _ = scorer.predict(observation)
        np.testing.assert_array_equal(policy.predict(observation, deterministic=True)[0], best)
        scores, best_scores = scorer.scores(env.unwrapped.numbers), np.arange(8)
        np.testing.assert_allclose(scores[best_scores, best], scores.max(axis=1), atol=1e-3)
        for chosen in (
            policy.predict(observation)[0],
            scorer.predict(observation, deterministic=False)[0],
        ):
            assert mask[np.arange(8), chosen].all()
    assert masked


def test_what_it_learned_is_given_back_and_saved(begun, tmp_path):
    trained = agent(begun, learning_rate=1e-2)
    trained.learn(8)
    scorer = trained.policy.scorer()
    scorer.write(tmp_path / "ppo.safetensors")
    again = LeapScorer.read(tmp_path / "ppo.safetensors")
    before, after = (each.network.state_dict() for each in (LeapScorer.read(begun), again))
    assert not torch.equal(before["linear.weight"], after["linear.weight"])
    trained.save(tmp_path / "agent")
    loaded = MaskablePPO.load(tmp_path / "agent")
    observation, _ = trained.env.envs[0].reset(seed=1)
    for each in (loaded, again):
        np.testing.assert_array_equal(
            each.predict(observation, deterministic=True)[0],
            trained.predict(observation, deterministic=True)[0],
        )


def test_another_environment_and_another_kind_are_refused():
    with refuses("environment"):
        MaskablePPO(ScorePolicy, "stancekit/Traverse-v0", n_steps=8, batch_size=8)
    env = gymnasium.make("stancekit/LeapChoice-v0", problem="leap-few", tries=1)
    with refuses("kind"):
        MaskablePPO(ScorePolicy, env, n_steps=8, batch_size=8, policy_kwargs={"kind": "tree"})


def test_batches_are_played_one_by_one(begun):
    scorer = LeapScorer.read(begun)
    envs = gymnasium.make_vec(
        "stancekit/LeapChoice-v0", 3, problem="leap-base", vectorization_mode="sync"
    )
    observation, _ = envs.reset(seed=5)
    choices, _ = scorer.predict(observation)
    for k in range(3):
        one = {name: value[k] for name, value in observation.items()}
        np.testing.assert_array_equal(scorer.predict(one)[0], choices[k])
