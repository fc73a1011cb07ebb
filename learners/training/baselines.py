"""Our environments as stable-baselines3 wants them, and the scenes they are trained on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import LabelledScene, PooledScenes, SceneKind
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.search.exact import BoxSearch

from ..selectors.policy import moved


def open_scenes(scenes: Sequence[LabelledScene]) -> list[LabelledScene]:
    """The scenes that the first box of ``EnvelopeRefinement-v0`` leaves open: those where cuts are
    needed.
    """
    programs = Programs()
    searches = (BoxSearch(scene.problem, Scaled.of(scene.problem), programs) for scene in scenes)
    return [
        scene
        for scene, search in zip(scenes, searches, strict=True)
        if search.verdict is Status.UNDECIDED
    ]


class SelectionVecEnv(VecEnv):
    """``EnvelopeSelection-v0`` in batches, as a stable-baselines3 environment.

    With ``base`` given the actions are moves of its bounds: base + offset · action
    (``policy_file.moved``), so that an untrained policy of small actions answers about as the base
    does.

    Arguments:
        base: shape (12N,).
    """

    def __init__(
        self, env: EnvelopeSelectionVectorEnv, *, base: Array | None = None, offset: float = 0.25
    ) -> None:
        self._env, self._base, self._offset = env, base, offset
        self._actions: NDArray[Any] = np.zeros(0)
        self.render_mode = None
        space = env.single_action_space
        if base is not None and (not isinstance(space, spaces.Box) or space.shape != base.shape):
            raise InvalidInput(f"base: expected bounds of shape {space.shape}, got {base.shape}")
        super().__init__(env.num_envs, env.single_observation_space, space)

    def reset(self) -> dict[str, NDArray[np.float32]]:
        """Draw the next scenes."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observation, _ = self._env.reset(seed=seeds)
        self._reset_seeds()
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions."""
        self._actions = actions if self._base is None else moved(self._base, self._offset, actions)

    def step_wait(
        self,
    ) -> tuple[
        dict[str, NDArray[np.float32]], NDArray[np.float64], NDArray[np.bool_], list[dict[str, Any]]
    ]:
        """Judge them."""
        observation, rewards, ended, _, infos = self._env.step(self._actions)
        final = {
            name: values for name, values in infos["final_info"].items() if not name.startswith("_")
        }
        rows = [
            {name: values[index] for name, values in final.items()}
            | {
                "terminal_observation": infos["final_obs"][index],
                "episode": {"r": rewards[index], "l": 1, "t": 0.0},
            }
            for index in range(self.num_envs)
        ]
        return observation, rewards, ended, rows

    def close(self) -> None:
        """Close the batch."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The batch's attribute, once a sub-environment."""
        return [getattr(self._env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: sub-environments share what they have."""
        raise StancekitError("the sub-environments of a batch have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refused: sub-environments share what they have."""
        raise StancekitError("the sub-environments of a batch have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Nothing is wrapped."""
        return [False for _ in self._get_indices(indices)]


def refinement_vec_env(
    kind: SceneKind, scenes: Sequence[LabelledScene], *, envs: int, budget: int
) -> DummyVecEnv:
    """``EnvelopeRefinement-v0`` in batches, one after the other in this process."""
    pool, programs = PooledScenes(scenes), Programs()
    return DummyVecEnv(
        [
            lambda: EnvelopeRefinementEnv(kind, budget=budget, scenes=pool, programs=programs)
            for _ in range(envs)
        ]
    )
