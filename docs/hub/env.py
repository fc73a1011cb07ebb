"""Stancekit's environments for LeRobot's EnvHub: one file, to be put into a repository of the hub
as ``env.py``.

LeRobot calls ``make_env(n_envs, use_async_envs)`` of it
(``lerobot.envs.factory.make_env("USER/REPO", trust_remote_code=True)``) and takes a mapping of
suite and task to vector environments. ``info["is_success"]`` says whether P1 over the chosen box
answers as the scene's label does. Observations are ``environment_state``, as LeRobot's policies
read them: the environment's own arrays, one after another, in the order of their names.
"""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.spaces import Dict, flatten, flatten_space

TASKS = {
    "wall-3": "Choose the box over positions and forces for three limbs on walls.",
    "ground-3": "Choose the box over positions and forces for three limbs on the ground.",
}
ONE_STEP = 1
"""An episode is one choice."""


class ForLeRobot(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The same environment as LeRobot's evaluation calls it: flat observations, a task in words,
    and success.
    """

    def __init__(self, env: Any, task: str) -> None:
        super().__init__(env)
        self.task, self.task_description, self._max_episode_steps = task, TASKS[task], ONE_STEP
        self.observation_space = Dict({"environment_state": flatten_space(env.observation_space)})

    def reset(self, **options: Any) -> Any:
        """A new scene."""
        observation, info = self.env.reset(**options)
        return self._flat(observation), info

    def step(self, action: Any) -> Any:
        """A step, and ``is_success``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info["is_success"] = bool(info["p1_feasible"] == info["label"])
        return self._flat(observation), reward, terminated, truncated, info

    def _flat(self, observation: Any) -> Any:
        return {"environment_state": flatten(self.env.observation_space, observation)}


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None
) -> dict[str, dict[int, Any]]:
    """A vector environment per task."""
    vector: Any = (
        gymnasium.vector.AsyncVectorEnv if use_async_envs else gymnasium.vector.SyncVectorEnv
    )
    same_step = (
        gymnasium.vector.AutoresetMode.SAME_STEP
    )  # "final_info" comes with the step that ends an episode

    def made(task: str) -> Any:
        name = "stancekit.envs:stancekit/EnvelopeSelection-v0"
        return lambda: ForLeRobot(gymnasium.make(name, problem=task), task)

    return {
        "stancekit": {
            k: vector([made(task)] * n_envs, autoreset_mode=same_step)
            for k, task in enumerate(TASKS)
        }
    }
