"""WarpedGait-v0 keeps Gymnasium's contract, and says of an attempt what the optimiser and the
verifier say of it.
"""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same

from stancekit.envs.distributions.courses import SampledTasks
from stancekit.envs.warped_gait import (
    PATCH,
    PATCH_M,
    GaitRewardWeights,
    WarpedGaitEnv,
    observe,
)
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.gait.method.attempt import Attempt, Workbench
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import refuses

PLAIN = HeightField.from_function(lambda x, y: 0.1 * x - 0.05 * y, 3.0, 0.25, name="plain")
WALK = Walk(robot=anymal(), terrain=PLAIN, start=[0.0, 0.0], goal=[0.2, 0.1], duration_s=2.0)
SHORT = SampledTasks(duration_s=2.0, distance_m=(0.1, 0.3), difficulty=(0.1, 0.4))
FEW = GaitSettings(max_iterations=4)


def on_plain(_rng):
    """The same short walk every time."""
    return WALK


def made(**settings):
    return WarpedGaitEnv(**{"tasks": on_plain, "charts": ("decoupled", "ambient"), **settings})


def tried(env, *action, seed=0):
    """The step of a first episode."""
    env.reset(seed=seed)
    return env.step(np.array(action))


@pytest.fixture(scope="module")
def stepped():
    """One step on the plain: environment, observation, reward and info."""
    env = made()
    return env, *tried(env, 0, 0, 0, seed=4)


# -----------------------------------------------------------------------------------------------------
# contract


def test_a_seed_reproduces_an_episode_exactly():
    def played(seed):
        env = WarpedGaitEnv(tasks=SHORT, charts=("decoupled", "ambient"), settings=FEW)
        return [env.reset(seed=seed), env.step(np.array([1, 0, 1])), env.reset()]

    first = played(5)
    assert same(first, played(5), exact=True)
    assert not same(first[0], WarpedGaitEnv(tasks=SHORT).reset(seed=6))


def test_observations_lie_in_their_space_and_info_is_finite_numbers(stepped):
    env, observation, reward, terminated, truncated, info = stepped
    assert env.observation_space.contains(observation)
    assert all(
        type(s) is gymnasium.spaces.Box and s.dtype == np.float32
        for s in env.observation_space.values()
    )
    assert [type(value) for value in (reward, terminated, truncated)] == [float, bool, bool]
    assert (terminated, truncated) == (True, False)
    assert all(np.isfinite(value) and np.ndim(value) == 0 for value in info.values())


def test_terrains_have_names():
    with refuses("terrain"):
        WarpedGaitEnv("lava")
    with refuses("difficulty"):
        SampledTasks(difficulty=(0.5, 0.2))


# -----------------------------------------------------------------------------------------------
# what is said


def test_a_step_says_what_the_optimiser_and_the_verifier_say(stepped):
    _, _, reward, _, _, info = stepped
    found = Workbench(on_plain(None), GaitSettings(max_iterations=50)).run(
        Attempt(chart="decoupled")
    )
    verdict = check_trajectory(found.trajectory)
    assert (info["verified"], info["feasible"], info["iterations"]) == (1, 1, found.iterations)
    assert verdict.accepted
    assert info["force_rms"] == verdict.figures["force_rms"]
    assert info["violation"] == found.solution.violation < 1e-4
    assert reward == pytest.approx(1.0 + 0.25 - 0.25 * found.iterations / 50)
    assert info["seconds"] == 0.0


def test_reward_terms_add_up_and_time_counts_only_where_it_is_asked_for():
    env = made(
        timing=True,
        weights=GaitRewardWeights(verified=2.0, feasible=0.5, iterations=1.0, seconds=0.1),
    )
    _, reward, _, _, info = tried(env, 0, 0, 0)
    assert reward == pytest.approx(
        sum(value for name, value in info.items() if name.startswith("reward_"))
    )
    assert info["seconds"] > 0.0
    assert info["reward_seconds"] == pytest.approx(-0.1 * info["seconds"])
    assert (info["reward_verified"], info["reward_feasible"]) == (2.0, 0.5)


def test_a_solve_that_fails_is_worth_less_than_nothing():
    _, reward, _, _, info = tried(made(settings=GaitSettings(max_iterations=1)), 0, 0, 2)
    assert (reward, info["verified"], info["feasible"]) == (-0.25, 0, 0)
    assert info["violation"] > 1e-4


def test_an_environment_is_copied_after_its_step_too():
    env = made(charts=("warped",), settings=GaitSettings(max_iterations=1))
    tried(env, 0, 0, 0)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = env.reset()
    for other in copies:
        assert same(other.reset(), expected)


def test_homotopy_solves_one_height_after_another():
    plain, stages = (tried(made(), 1, heights, 0)[4] for heights in (0, 2))
    assert (plain["feasible"], stages["feasible"]) == (1, 1)
    assert stages["iterations"] > plain["iterations"]


def test_a_noisy_guess_hangs_on_the_seed_of_the_episode():
    env = made(settings=GaitSettings(max_iterations=1))
    first, again, other = (tried(env, 0, 0, 2, seed=seed)[4]["violation"] for seed in (1, 1, 2))
    assert first == again != other


# --------------------------------------------------------------------------------------------- what
# is observed


def test_heights_are_those_of_the_terrain_in_a_frame_that_looks_from_start_to_goal():
    task = on_plain(None)
    seen = observe(task)
    heights = seen["heights"].reshape(PATCH, PATCH).astype(float)
    step = PATCH_M / (PATCH - 1)
    ahead = np.array([0.2, 0.1]) / np.hypot(0.2, 0.1)
    assert np.allclose(np.diff(heights, axis=0), step * ahead @ [0.1, -0.05], atol=1e-6)
    assert np.allclose(
        np.diff(heights, axis=1), step * np.array([-ahead[1], ahead[0]]) @ [0.1, -0.05], atol=1e-6
    )
    assert np.allclose(seen["goal"], [0.5 * np.hypot(0.2, 0.1), 0.0], atol=1e-7)
    assert np.allclose(seen["start"], -seen["goal"])
    assert np.allclose(seen["facing"], [ahead[0], -ahead[1]], atol=1e-7)
    assert seen["friction"] == np.float32(0.75)
    assert seen["adhesive"].tolist() == [0.0] * 4


def test_the_observation_does_not_depend_on_where_north_is():
    turned = HeightField.from_function(lambda x, y: 0.1 * y + 0.05 * x, 3.0, 0.25, name="turned")
    task = on_plain(None)
    other = replace(task, terrain=turned, goal=[-0.1, 0.2], start_yaw_rad=0.5 * np.pi)
    here, there = observe(task), observe(other)
    assert here.keys() == there.keys()
    for name in here:
        assert np.allclose(here[name], there[name], atol=1e-6), name


def test_walks_on_reference_terrains_are_the_papers():
    rng = np.random.default_rng(3)
    task = SampledTasks(terrain="hill")(rng)
    assert task.adhesive == (True, True, False, False)
    assert task.start.tolist() == [-2.6, 0.0]
    assert observe(task)["adhesive"].tolist() == [1.0, 1.0, 0.0, 0.0]


def test_walks_are_drawn_within_their_ranges_until_the_robot_can_stand():
    rng = np.random.default_rng(0)
    tasks = SampledTasks(distance_m=(0.4, 0.6), difficulty=(0.5, 1.0))
    drawn = [tasks(rng) for _ in range(6)]
    assert len({task.terrain.name for task in drawn}) > 3
    for task in drawn:
        way = task.goal - task.start
        assert 0.4 <= np.linalg.norm(way) <= 0.6
        assert np.allclose(
            way / np.linalg.norm(way), [np.cos(task.start_yaw_rad), np.sin(task.start_yaw_rad)]
        )


def test_walks_are_drawn_over_any_family_that_has_ground():
    rng, tasks = np.random.default_rng(1), SampledTasks(terrain="any", difficulty=(0.05, 0.15))
    names = {tasks(rng).terrain.name.partition(":")[0] for _ in range(12)}
    assert len(names & {"stairs", "stones", "gaps", "beams", "rubble", "slopes"}) > 2
    observation, _ = WarpedGaitEnv("stairs", charts=("decoupled",)).reset(seed=0)
    assert np.abs(observation["heights"]).max() > 0.05
    with refuses("terrain"):
        WarpedGaitEnv("walls")


def test_a_robot_that_can_stand_nowhere_is_said_so():
    feet = [
        replace(foot, reach_min_m=foot.nominal_m - 1e-6, reach_max_m=foot.nominal_m + 1e-6)
        for foot in anymal().feet
    ]
    steep = replace(anymal(), feet=tuple(feet))
    waves = SampledTasks(terrain="waves", difficulty=(1.0, 1.0), robot=steep)
    with refuses("waves", "start", kind=PlanningFailed):
        waves(np.random.default_rng(0))


# ------------------------------------------------------------------------------------------------
# what is shown


# --------------------------------------------------------------------------------------------------------
# pools


POOLED = {"tasks": SHORT, "charts": ("decoupled", "ambient"), "settings": FEW}


def test_a_pool_solves_an_attempt_once(monkeypatch):
    solves = []
    monkeypatch.setattr(
        Workbench, "run", lambda self, attempt: solves.append(attempt) or run(self, attempt)
    )
    env = WarpedGaitEnv(pool=2, **POOLED)
    env.reset(seed=1)
    first = env.step(np.array([0, 0, 1]))
    assert (env.pool.solved, len(solves)) == (1, 1)
    for _ in range(30):
        observation, _ = env.reset()
        if same(observation, first[0], exact=True):
            assert same(env.step(np.array([0, 0, 1])), first, exact=True)
        assert env.observation_space.contains(observation)
    assert (env.pool.solved, len(solves)) == (1, 1)
    env.reset(seed=1)
    env.step(np.array([1, 0, 1]))
    assert (env.pool.solved, len(solves)) == (2, 2)


run = Workbench.run


def test_a_pool_of_walks_is_kept_in_a_file(tmp_path, monkeypatch):
    env = WarpedGaitEnv(pool=3, **POOLED)
    env.reset(seed=3)
    expected = env.step(np.array([0, 1, 2]))
    env.pool.write(tmp_path / "walks.npz")
    monkeypatch.setattr(Workbench, "__init__", lambda *_: pytest.fail("about to be solved again"))
    again = WarpedGaitEnv(pool=tmp_path / "walks.npz", **POOLED)
    again.reset(seed=3)
    assert (len(again.pool), again.pool.solved) == (3, 1)
    assert same(again.step(np.array([0, 1, 2])), expected, exact=True)


def test_an_attempt_of_a_pool_comes_to_what_it_comes_to_without():
    env = WarpedGaitEnv(tasks=on_plain, charts=("decoupled",), pool=1)
    env.reset(seed=0)
    alone = made(charts=("decoupled",))
    alone.reset(seed=0)
    assert same(env.step(np.array([0, 0, 0]))[1:], alone.step(np.array([0, 0, 0]))[1:], exact=True)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"charts": ("decoupled",)}, "charts: expected 'decoupled', got 'decoupled, ambient'"),
        (
            {"settings": GaitSettings(max_iterations=5)},
            "settings.max_iterations: expected 5, got 4",
        ),
        ({"tasks": replace(SHORT, duration_s=2.5)}, "tasks.duration_s: expected 2.5, got 2.0"),
    ],
)
def test_a_pool_of_other_walks_is_refused(other, said, tmp_path):
    path = tmp_path / "walks.npz"
    WarpedGaitEnv(pool=1, **POOLED).pool.write(path)
    with refuses(path):
        WarpedGaitEnv(pool=path, **{**POOLED, **other})


@pytest.mark.parametrize(
    ("pool", "name"),
    [
        (0, "pool"),
        ("none.npz", "none.npz"),
    ],
)
def test_a_pool_that_is_none_is_refused(pool, name):
    with refuses(name):
        WarpedGaitEnv(pool=pool, **POOLED)


def test_another_file_is_no_pool(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with refuses("other.npz"):
        WarpedGaitEnv(pool=tmp_path / "other.npz", **POOLED)
