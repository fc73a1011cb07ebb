"""The batched environment lives through what single environments do."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import ListedScenes, SampledScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.errors import InvalidInput

NAME = "stancekit.envs:stancekit/EnvelopeSelection-v0"


def played(env, steps=3, seed=7):
    """Everything that an environment returns, with actions that depend on the seed only."""
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)]
    for _ in range(steps):
        middle = rng.uniform(-0.3, 0.3, size=(env.num_envs, 2, 18))
        seen.append(
            env.step(
                np.concatenate([middle[:, 0] - 0.5, middle[:, 1] + 0.5], axis=1).astype(np.float32)
            )
        )
    return seen


def assert_same(one, other):
    """Equal to the last bit, through dictionaries, tuples and arrays of objects."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, tuple | list) or (isinstance(one, np.ndarray) and one.dtype == object):
        assert len(one) == len(other)
        for mine, theirs in zip(one, other, strict=True):
            assert_same(mine, theirs)
    else:
        np.testing.assert_array_equal(one, other)
        assert np.asarray(one).dtype == np.asarray(other).dtype


@pytest.fixture(scope="module")
def ours():
    env = gymnasium.make_vec(NAME, num_envs=4)
    yield env
    env.close()


@pytest.fixture(scope="module")
def history(ours):
    return played(ours)


def test_make_vec_gives_the_batched_environment_by_default(ours):
    assert isinstance(ours, EnvelopeSelectionVectorEnv)
    assert ours.autoreset_mode is ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert isinstance(
        gymnasium.make_vec(NAME, num_envs=1, vectorization_mode="vector_entry_point"),
        EnvelopeSelectionVectorEnv,
    )


def test_every_bit_is_that_of_gymnasiums_own_vector_of_single_environments(history):
    single = [EnvelopeSelectionEnv for _ in range(4)]
    theirs = SyncVectorEnv(single, autoreset_mode=AutoresetMode.SAME_STEP)
    for mine, other in zip(history, played(theirs), strict=True):
        assert_same(mine, other)


def test_a_step_ends_every_episode_and_tells_of_the_old_scene(ours, history):
    (first, _), (second, rewards, ended, cut, infos) = history[:2]
    assert ours.observation_space.contains(second)
    assert ended.all()
    assert not cut.any()
    for name, values in first.items():
        np.testing.assert_array_equal(np.stack([row[name] for row in infos["final_obs"]]), values)
        assert not np.array_equal(values, second[name]) or name in ("shoulders", "reach")
    final = infos["final_info"]
    total = final["reward_agreement"] + final["reward_projection"] + final["reward_tightness"]
    np.testing.assert_allclose(rewards, total, rtol=0, atol=1e-15)


def test_reset_without_a_seed_goes_on(ours, history):
    again = ours.reset(seed=7)[0]
    assert_same(again, history[0][0])
    further = ours.reset()[0]
    assert_same(further, history[1][0])  # judging draws nothing


def test_listed_scenes_are_listed_to_every_sub_environment():
    source, rng = SampledScenes(distribution("wall-3")), np.random.default_rng(0)
    listed = ListedScenes([source.draw(rng) for _ in range(2)])
    env = EnvelopeSelectionVectorEnv(3, scenes=listed)
    for _ in range(2):
        seen = env.reset(seed=0)[0]["vertices"]
        np.testing.assert_array_equal(seen[0], seen[2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs: expected 1 or more, got 0"),
        ({"num_envs": 2, "render_mode": "human"}, "render_mode: expected one of"),
        ({"num_envs": 2, "problem": "ceiling-3"}, "distribution: expected one of"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        EnvelopeSelectionVectorEnv(**arguments)


def test_misuse_is_told(ours):
    with pytest.raises(gymnasium.error.ResetNeeded):
        EnvelopeSelectionVectorEnv(1).step(np.zeros((1, 36), dtype=np.float32))
    with pytest.raises(InvalidInput, match="seed: expected one number or 4, got 2"):
        ours.reset(seed=[1, 2])
    ours.reset(seed=0)
    with pytest.raises(InvalidInput, match=r"actions: expected shape \(4, 36\), got \(3, 36\)"):
        ours.step(np.zeros((3, 36), dtype=np.float32))
