"""The file for LeRobot's EnvHub, called as lerobot.envs.factory and lerobot_eval (0.4.4) do it."""

import importlib.util
from pathlib import Path

import gymnasium
import pytest

FILE = Path(__file__).parents[2] / "docs" / "hub" / "env.py"


@pytest.mark.parametrize("use_async_envs", [False, True])
def test_the_hubs_file_makes_vector_environments_that_step(use_async_envs: bool) -> None:
    spec = importlib.util.spec_from_file_location("hub_env", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.make_env(n_envs=2, use_async_envs=use_async_envs)
    assert list(made) == ["stancekit"]
    for env in made["stancekit"].values():
        assert isinstance(env, gymnasium.vector.VectorEnv)
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
