"""The file for LeRobot's EnvHub, loaded and called as lerobot.envs.utils (0.4.4) does it."""

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
        env.reset(seed=0)
        *_, info = env.step(env.action_space.sample())
        assert info["is_success"].shape == (2,)
        env.close()
