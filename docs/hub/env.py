"""Stancekit's environments for LeRobot's EnvHub: one file, to be put into a repository of the hub as ``env.py``.

LeRobot calls ``make_env(n_envs, use_async_envs)`` of it (``lerobot.envs.factory.make_env("USER/REPO",
trust_remote_code=True)``) and takes a mapping of suite and task to vector environments. ``info["is_success"]`` says
whether P1 over the chosen box answers as the scene's label does.
"""

from __future__ import annotations

from typing import Any

import gymnasium

TASKS = ("wall-3", "ground-3")


class WithSuccess(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The same environment, whose info says whether a step succeeded."""

    def step(self, action: Any) -> Any:
        """A step, and ``is_success``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info["is_success"] = bool(info["p1_feasible"] == info["label"])
        return observation, reward, terminated, truncated, info


def make_env(n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None) -> dict[str, dict[int, Any]]:
    """A vector environment per task."""
    vector = gymnasium.vector.AsyncVectorEnv if use_async_envs else gymnasium.vector.SyncVectorEnv

    def made(task: str) -> Any:
        return lambda: WithSuccess(gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0", problem=task))

    return {"stancekit": {k: vector([made(task)] * n_envs) for k, task in enumerate(TASKS)}}
