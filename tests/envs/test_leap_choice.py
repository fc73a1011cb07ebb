"""Choosing the candidates of a leap: what is seen, what a try costs, and that success is a leap of
the verifier's.
"""

import gymnasium as gym
import numpy as np
import pytest

import stancekit
import stancekit.envs
from stancekit.envs.leap_choice import LeapChoiceEnv
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, LeapSearch
from stancekit.planners.leap.scp import OF_CANDIDATE, Rule, plan_of
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap
from tests.refusals import refuses

NAME = "stancekit.envs:stancekit/LeapChoice-v0"


def table(observation, name, env):
    """A flat part of the observation by foothold and candidate."""
    feet, options = env.action_space.nvec.shape[0], int(env.action_space.nvec[0])
    return observation[name].reshape(feet, options, -1)


@pytest.fixture(scope="module")
def few():
    return LeapChoiceEnv(problem="leap-few")


def test_friction_and_normals_that_are_seen_are_those_of_the_patches(few):
    observation, _ = few.reset(seed=4)
    seen, leap = table(observation, "candidates", few), few.numbers.leap
    for j, foothold in enumerate(leap.footholds):
        for r, patch in enumerate(foothold.candidates):
            own = dict(zip(OF_CANDIDATE, seen[j, r], strict=True))
            assert own["friction"] == np.float32(patch.friction)
            normal = [own[f"normal_{axis}"] for axis in "xyz"]
            np.testing.assert_allclose(normal, patch.frame[:, 0], atol=1e-6)
    assert few.action_masks().sum() == sum(len(foothold.candidates) for foothold in leap.footholds)


def test_an_episode_of_the_rules_choices_is_the_search_of_the_rule():
    env, wins = LeapChoiceEnv(problem="leap-base", tries=1), 0
    for seed in range(6):
        env.reset(seed=seed)
        numbers = env.numbers
        _, reward, ended, cut_off, info = env.step(Rule().scores(numbers).argmax(axis=1))
        search = LeapSearch(numbers.leap, LeapFinder(order="rule"), Programs())
        found = next(search.attempts())
        solved = found.solved and check_leap(plan_of(search.last.numbers, found, "rule")).accepted
        assert (ended, info["is_success"], info["solves"]) == (solved, int(solved), found.solves)
        assert cut_off == (not solved)
        assert reward == pytest.approx(solved - found.solves / 12)
        wins += solved
    assert wins > 0


def test_masked_and_repeated_choices_are_failed_tries_and_say_so():
    env = LeapChoiceEnv(problem="leap-stairs", tries=3)
    for seed in range(60):
        env.reset(seed=seed)
        mask = env.action_masks().reshape(8, -1)
        if not mask.all():
            break
    assert not mask.all()
    _, reward, ended, _, info = env.step((mask == 0).argmax(axis=1) * (mask == 0).any(axis=1))
    assert (reward, ended, info["masked"], info["tries"], info["solves"]) == (
        pytest.approx(-1 / 12),
        False,
        1,
        1,
        1,
    )
    choice = np.zeros(8, dtype=np.int64)
    _, _, ended, _, first = env.step(choice)
    if not ended:
        _, _, _, cut_off, again = env.step(choice)
        assert (
            first["repeated"],
            again["repeated"],
            again["solves"] - first["solves"],
            cut_off,
        ) == (0, 1, 1, True)


@pytest.mark.parametrize("problem", ["leap-stairs", "leap-given"])
def test_every_scene_has_the_shape_of_the_class_whatever_candidates_it_has(problem):
    env, options = LeapChoiceEnv(problem=problem), leap_class(problem).candidates
    counts = set()
    for seed in range(8):
        observation, _ = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        mask = env.action_masks().reshape(8, options)
        own = [len(foothold.candidates) for foothold in env.numbers.leap.footholds]
        assert mask.sum(axis=1).tolist() == own
        counts |= set(own)
    assert len(counts) > 1


def test_what_the_last_try_lacks_is_in_the_next_observation():
    env = LeapChoiceEnv(problem="leap-hard", solves=25)
    lacking = 0
    for seed in range(4):
        env.reset(seed=seed)
        choice = Rule().scores(env.numbers).argmax(axis=1)
        observation, _, ended, _, info = env.step(choice)
        last = table(observation, "last", env)[..., 0]
        np.testing.assert_array_equal(last.argmax(axis=1), choice)
        if not ended and info["cost"] > 1e-3:
            lacking += 1
            assert observation["residual"].max() > 0.0
        if ended:
            assert observation["residual"].max() < 0.1
    assert lacking


def test_scenes_of_a_folder_are_of_the_part_that_was_asked_for(tmp_path):
    tries = stancekit.label("leap-few", tmp_path / "few", scenes=12, tries={"random": 1}, seed=3)
    parts = tries.parts()
    assert set(parts) == {"train", "test", "calibration"}
    names = {
        part: {leap.name for leap, own in zip(tries.leaps(), parts, strict=True) if own == part}
        for part in parts
    }
    for given, part in (("", "train"), (":test", "test"), (":calibration", "calibration")):
        env = LeapChoiceEnv(problem="leap-few", scenes=f"{tmp_path / 'few'}{given}")
        for seed in range(5):
            env.reset(seed=seed)
            assert env.numbers.leap.name in names[part]
    with refuses("leap-hard", "leap-few"):
        LeapChoiceEnv(scenes=tmp_path / "few")


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"problem": "leap-none"}, "distribution"),
        ({"tries": 0}, "tries"),
        ({"solves": 0}, "solves"),
        ({"budget": 3}, "budget"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(given, name):
    with refuses(name):
        LeapChoiceEnv(**given)


def test_a_missing_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        LeapChoiceEnv(problem="leap-few").action_masks()


def test_equal_seeds_draw_the_scenes_of_the_class(few):
    observation, _ = few.reset(seed=11)
    again, _ = LeapChoiceEnv(problem="leap-few").reset(seed=11)
    assert all(np.array_equal(observation[name], again[name]) for name in observation)
    rng = np.random.default_rng(11)
    drawn = leap_class("leap-few").draw(rng)
    np.testing.assert_array_equal(few.numbers.leap.goal.com_m, drawn.goal.com_m)
