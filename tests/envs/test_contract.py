"""What every environment keeps to, as those who use it count on: Gymnasium, stable-baselines3,
Minari, and copies.
"""

from __future__ import annotations

import copy
import dataclasses
import importlib.util
import inspect
import pickle
import re
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as checks_of_stable_baselines

import stancekit
import stancekit.envs
from stancekit.envs import leap_choice, refinement, selection, traverse, warped_gait
from stancekit.envs.distributions.postures import GROUND_3
from tests.refusals import refuses

IDS = sorted(name for name in gym.registry if name.startswith("stancekit/"))
QUICK: dict[str, dict[str, Any]] = {
    "stancekit/EnvelopeSelection-v0": {"problem": "ground-3", "weights": {"agreement": 2.0}},
    "stancekit/EnvelopeRefinement-v0": {"problem": "ground-3", "budget": 30},
    "stancekit/Traverse-v0": {"courses": ["stairs"], "frames": 4, "horizon": 1},
    "stancekit/LeapChoice-v0": {"problem": "leap-few"},
    "stancekit/WarpedGait-v0": {
        "terrain": "ripple",
        "charts": ["decoupled"],
        "settings": {"max_iterations": 1},
    },
}
FILE = '''
import numpy as np
import stancekit


class Mine:
    """Counts what it has drawn."""

    def __init__(self):
        self.count = 0

    def sample(self, rng):
        self.count += 1
        return stancekit.sample("ground-3", rng=int(rng.integers(1000)) + self.count)[0]
'''


class Mine:
    """A distribution with nothing but ``sample``."""

    def sample(self, rng: np.random.Generator) -> stancekit.Problem:
        return GROUND_3.sample(rng)


def same(one: Any, other: Any) -> bool:
    """Equal keys, and equal numbers to the last bit."""
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[name], other[name]) for name in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(np.array_equal(np.asarray(one), np.asarray(other)))


MOST_STEPS = {"stancekit/WarpedGait-v0": 1}
"""Where a step is an optimisation of a walk."""


def steps(env: gym.Env, count: int = 3) -> list[Any]:
    """The next steps, with actions of the space's own generator; a new episode where one ends,
    which takes no step more.
    """
    found = []
    for _ in range(count):
        found.append(env.step(action := env.action_space.sample()))
        if found[-1][2] or found[-1][3]:
            with pytest.raises(gym.error.ResetNeeded, match="is over"):
                env.unwrapped.step(action)
            found.append(env.reset())
    return found


def running(name: str, done: int) -> gym.Env:
    """An environment in the middle of what it does, so many steps after its reset, which is needed
    first.
    """
    env = gym.make(name, **QUICK[name])
    for ask in (partial(env.unwrapped.step, None), env.unwrapped.render):
        with pytest.raises(gym.error.ResetNeeded):
            ask()
    env.reset(seed=3)
    env.action_space.seed(5)
    steps(env, done)
    return env


def test_all_environments_are_looked_at():
    assert set(IDS) == set(QUICK)


@pytest.mark.parametrize("name", IDS)
def test_an_environment_passes_both_checkers_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(name, render_mode="rgb_array", **QUICK[name]).unwrapped)
        checks_of_stable_baselines(gym.make(name, **QUICK[name]).unwrapped)


@pytest.mark.parametrize("name", IDS)
def test_info_of_a_reset_has_the_keys_kinds_and_shapes_of_a_step(name):
    env = gym.make(name, **QUICK[name])
    _, before = env.reset(seed=3)
    *_, after = env.step(env.action_space.sample())
    assert list(before) == list(after)
    assert "is_success" in before
    assert before["is_success"] == 0
    for key in before:
        assert np.shape(before[key]) == np.shape(after[key]), key
        assert np.asarray(before[key]).dtype == np.asarray(after[key]).dtype, key


@pytest.mark.parametrize("done", [0, 3])
@pytest.mark.parametrize("name", IDS)
def test_a_running_environment_is_copied_and_the_copy_goes_on_as_it_does(name, done):
    most = MOST_STEPS.get(name, 3)
    env = running(name, min(done, most))
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = steps(env, most)
    for other in copies:
        assert same(steps(other, most), expected)


def test_a_running_batch_is_copied_and_the_copy_goes_on_as_it_does():
    envs = gym.make_vec("stancekit/EnvelopeSelection-v0", num_envs=2, problem="ground-3")
    envs.reset(seed=3)
    actions = np.tile(np.repeat([-1.0, 1.0], 18), (2, 1)).astype(np.float32)
    envs.step(actions)
    copies = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]
    observation, rewards, *_ = envs.step(actions)
    for other in copies:
        found, its, *_ = other.step(actions)
        assert same(found, observation)
        assert same(its, rewards)
        other.close()
    envs.close()


def test_a_copy_takes_the_state_of_a_distribution_of_a_file_with_it(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    env = gym.make("stancekit/EnvelopeSelection-v0", problem=f"{path}:Mine", balanced=False)
    env.reset(seed=0)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = env.reset()
    for other in copies:
        assert same(other.reset(), expected)


@pytest.mark.parametrize("name", IDS)
def test_the_spec_of_an_environment_makes_the_same_one_after_json(name):
    env = gym.make(name, **QUICK[name])
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.action_space == env.action_space
    assert same(again.reset(seed=2), env.reset(seed=2))


def test_weights_and_settings_go_through_json_as_mappings():
    from stancekit.envs.selection import RewardWeights

    name = "stancekit/EnvelopeSelection-v0"
    env = gym.make(
        name, problem="ground-3", weights=RewardWeights(agreement=3.0), projections=("fix-p", "scp")
    )
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    whole = np.repeat([-1.0, 1.0], 18).astype(np.float32)
    for each in (env, again):
        each.reset(seed=2)
    assert same(again.step(whole), env.step(whole))


TERMS = """
def tenth(judged):
    return 0.1


def fails(judged):
    return judged.nothing


def endless(judged):
    return float("inf")
"""


@pytest.mark.parametrize("name", IDS)
def test_a_reward_term_of_ones_own_counts_in_every_environment(name, tmp_path):
    path, usual = tmp_path / "terms.py", QUICK[name].get("weights", {})
    path.write_text(TERMS)

    def rewarded(weights):
        env = gym.make(name, **QUICK[name] | {"weights": usual | weights})
        _, before = env.reset(seed=3)
        env.action_space.seed(3)
        _, reward, *_, info = env.step(env.action_space.sample())
        assert list(before) == list(info)
        return reward, info

    (plain, _), (reward, info) = rewarded({}), rewarded({f"{path}:tenth": 0.5})
    assert (reward - plain, info["reward_tenth"]) == (pytest.approx(0.05), pytest.approx(0.05))
    for wrong in ("absent", "fails", "endless"):
        with refuses(f"weights.{path}:{wrong}"):
            gym.make(name, **QUICK[name] | {"weights": {f"{path}:{wrong}": 1.0}})


@pytest.mark.parametrize("name", IDS)
def test_a_keyword_that_none_takes_is_a_type_error_in_pythons_words(name):
    """TorchRL tries ``frameskip``, and reads what is said of it."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        gym.make(name, **QUICK[name], frameskip=1)


@pytest.mark.parametrize("name", IDS)
def test_actions_of_no_space_are_refused_alike(name):
    env = gym.make(name, **QUICK[name]).unwrapped
    env.reset(seed=0)
    shape = env.action_space.shape
    wrong = [np.full(shape, each) for each in (0.5, 1e30, -2, np.nan, True, None, "a")]
    fits = [1, 2, 3, 4, 5, 6] if isinstance(env.action_space, gym.spaces.Box) else range(7)
    for action in [*(wrong[k] for k in fits), np.zeros((*shape, 2), dtype=int)]:
        with refuses("action"):
            env.step(action)


def test_what_label_takes_make_takes(tmp_path):
    assert len(stancekit.label(Mine(), tmp_path / "rows", rows=(2, 2))) == 4
    for name in ("stancekit/EnvelopeSelection-v0", "stancekit/EnvelopeRefinement-v0"):
        mine, ours = gym.make(name, problem=Mine()), gym.make(name, problem=GROUND_3)
        assert same(mine.reset(seed=0)[0], ours.reset(seed=0)[0])


def test_a_reset_mask_keeps_the_scenes_of_the_others():
    envs = gym.make_vec("stancekit/EnvelopeSelection-v0", num_envs=3, problem="ground-3")
    with pytest.raises(gym.error.ResetNeeded):
        envs.reset(options={"reset_mask": np.array([True, False, False])})
    before, _ = envs.reset(seed=0)
    after, info = envs.reset(options={"reset_mask": np.array([True, False, False])})
    assert [bool((before["vertices"][k] == after["vertices"][k]).all()) for k in range(3)] == [
        False,
        True,
        True,
    ]
    assert len(info["label"]) == len(info["_label"]) == 3
    for mask in ([True, False], [1, 0, 0], np.zeros(3, dtype=bool), "all"):
        with refuses("options", "reset_mask"):
            envs.reset(options={"reset_mask": mask})


def test_the_batch_has_the_info_of_its_resets_and_draws_its_scenes():
    envs = gym.make_vec(
        "stancekit/EnvelopeSelection-v0", num_envs=2, problem="ground-3", render_mode="rgb_array"
    )
    _, info = envs.reset(seed=4)
    single = gym.make("stancekit/EnvelopeSelection-v0", problem="ground-3")
    _, first = single.reset(seed=4)
    assert same({name: info[name][0] for name in first}, first)
    actions = np.tile(np.repeat([-1.0, 1.0], 18), (2, 1)).astype(np.float32)
    *_, infos = envs.step(actions)
    *_, last = single.step(actions[0])
    _, first = single.reset()
    assert same({name: infos["final_info"][name][0] for name in last}, last)
    assert same({name: infos[name][0] for name in first}, first)
    assert [picture.shape[-1] for picture in envs.render()] == [3, 3]


def test_collectors_leave_their_own_option_in():
    env = gym.make("stancekit/EnvelopeSelection-v0", problem="ground-3")
    assert same(env.reset(seed=1, options={"minari_autoseed": False}), env.reset(seed=1))


AGENTS = [(name, "PPO") for name in IDS] + [
    ("stancekit/EnvelopeSelection-v0", agent) for agent in ("SAC", "TD3")
]


@pytest.mark.parametrize(("name", "agent"), AGENTS)
def test_stable_baselines_trains_by_the_name_of_an_environment(name, agent):
    kind = getattr(pytest.importorskip("stable_baselines3"), agent)
    count = 2 if "WarpedGait" in name else 8
    short = (
        {"n_steps": count, "batch_size": count, "n_epochs": 1}
        if agent == "PPO"
        else {"learning_starts": 4}
    )
    model = kind("MultiInputPolicy", name, **short)
    assert model.learn(count).num_timesteps == count
    assert model.env.render_mode == "rgb_array"


def test_agents_of_boxes_are_tried_where_the_actions_are_one():
    boxes = [name for name in IDS if isinstance(gym.make(name).action_space, gym.spaces.Box)]
    assert boxes == ["stancekit/EnvelopeSelection-v0"]


SECTIONS = (
    "Description",
    "Observation Space",
    "Action Space",
    "Reward",
    "Starting State",
    "Episode End",
    "Info",
    "Arguments",
    "Version History",
)
SIZES = {"N": 3, "E": 4}
OF_LEAPS = {"P": 8, "R": 8, "M": 9}
OF_TRAVERSE = {"H": 2, "N": 6, "R": 1, "U": 4}
SETTINGS = {
    selection.EnvelopeSelectionEnv: selection.SelectionSettings,
    refinement.EnvelopeRefinementEnv: refinement.RefinementSettings,
    traverse.TraverseEnv: traverse.TraverseSettings,
    warped_gait.WarpedGaitEnv: warped_gait.GaitEnvSettings,
    leap_choice.LeapChoiceEnv: leap_choice.LeapChoiceSettings,
}


def pages() -> list[tuple[str, type[gym.Env]]]:
    return [
        (name, gym.envs.registration.load_env_creator(gym.spec(name).entry_point)) for name in IDS
    ]


def table(page: str, section: str) -> list[list[str]]:
    """The rows of the table of a section, the first two columns of each."""
    (text,) = re.findall(rf"^## {section}$(.*?)(?=^## |\Z)", page, re.S | re.M)
    rows = [
        line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")
    ]
    return [[cell.strip() for cell in row[:2]] for row in rows[2:]]


@pytest.mark.parametrize(("name", "kind"), pages())
def test_a_page_has_all_sections_in_their_order(name, kind):
    page = inspect.getdoc(kind)
    assert tuple(re.findall(r"^## (.*)$", page, re.M)) == SECTIONS
    assert f"- v{gym.spec(name).version}: " in page


@pytest.mark.parametrize(("name", "kind"), pages())
def test_the_arguments_are_the_real_ones_with_their_defaults(name, kind):
    known = {**vars(selection), **vars(refinement), **vars(traverse), **vars(warped_gait)}
    message = {
        argument: eval(default, known)
        for argument, default in table(inspect.getdoc(kind), "Arguments")
    }
    taken = inspect.signature(kind).parameters.values()
    real = {p.name: p.default for p in taken if p.kind is not p.VAR_KEYWORD}
    if len(real) < len(taken):
        settings = SETTINGS[kind]
        last = real.pop("render_mode")
        real |= {each.name: each.default for each in dataclasses.fields(settings)} | {
            "render_mode": last
        }
    assert message == real
    assert list(message) == list(real)


@pytest.mark.parametrize(("name", "kind"), pages())
def test_the_observation_is_the_real_one(name, kind):
    env = gym.make(name).unwrapped
    sizes = {traverse.TraverseEnv: OF_TRAVERSE, leap_choice.LeapChoiceEnv: OF_LEAPS}.get(
        kind, SIZES
    )
    message = {
        key: eval(shape, dict(sizes))
        for key, shape in table(inspect.getdoc(kind), "Observation Space")
    }
    assert message == {key: box.shape for key, box in env.observation_space.spaces.items()}


HUB_FILE = Path(__file__).parents[2] / "docs" / "hub" / "env.py"


@pytest.mark.parametrize("use_async_envs", [False, True])
def test_the_hubs_file_makes_vector_environments_that_step(use_async_envs: bool) -> None:
    spec = importlib.util.spec_from_file_location("hub_env", HUB_FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.make_env(n_envs=2, use_async_envs=use_async_envs)
    assert list(made) == ["stancekit"]
    for env in made["stancekit"].values():
        assert isinstance(env, gym.vector.VectorEnv)
        observation, _ = env.reset(seed=0)
        assert list(observation) == [
            "environment_state"
        ]  # what lerobot's preprocess_observation takes over
        assert observation["environment_state"] in env.observation_space["environment_state"]
        assert env.call("_max_episode_steps") == (1, 1)  # lerobot's rollout asks for it
        _, _, ended, _, info = env.step(env.action_space.sample())
        assert ended.all()
        final = info["final_info"]  # and reads success from there
        assert (final["is_success"] == (final["p1_feasible"] == final["label"])).all()
        env.close()


@pytest.mark.filterwarnings("ignore:invalid escape sequence")  # of moviepy, where it is compiled
@pytest.mark.parametrize("name", ["EnvelopeSelection-v0", "EnvelopeRefinement-v0"])
def test_gymnasium_records_a_film_of_an_episode(name, tmp_path):
    pytest.importorskip("moviepy")
    env = gym.make(f"stancekit/{name}", render_mode="rgb_array")
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda index: True)
    env.reset(seed=0)
    env.close()
    assert [path.name for path in (tmp_path / "films").iterdir()] == ["rl-video-episode-0.mp4"]
