"""``stancekit/EnvelopeSelection-v0`` in batches that share compiled models and are judged together.

``gymnasium.make_vec("stancekit.envs:stancekit/EnvelopeSelection-v0", num_envs=8)`` gives this
environment.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stancekit.planners.answer.motion import doubts_of
from stancekit.planners.arguments import settings_from
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import shown

from .episodes import (
    check_options,
    checked_action,
    checked_mask,
    checked_render_mode,
    checked_seed,
)
from .scenes import LabelledScene, ProblemSource, all_seen
from .selection import SelectionSettings, SelectionTask, picture

_Observation = dict[str, NDArray[np.float32]]
_Seeds = Sequence[int | None]


class EnvelopeSelectionVectorEnv(VectorEnv[_Observation, NDArray[Any], NDArray[Any]]):
    """``num_envs`` copies of ``EnvelopeSelectionEnv`` in one: a step judges an action each and
    draws the next scenes.

    Autoreset is SAME_STEP: ``step`` returns the observation of the next scenes, with the info of
    their reset; ``infos["final_obs"]`` and ``infos["final_info"]`` are those of the scenes that the
    actions were for. Wrappers that are written for NEXT_STEP, Gymnasium's default, do not fit: they
    take every second step for a reset (``RecordEpisodeStatistics`` and ``DictInfoToList`` know both
    modes). Sub-environment i with seed s + i lives through exactly what the single environment does
    after ``reset(seed=s + i)``. In several processes Gymnasium's ``AsyncVectorEnv`` runs them.

    One thread at a time may use it. A copy (deepcopy, pickle) goes on as the original.

    Arguments:
        scenes: a source that keeps count of what it drew is copied for every sub-environment. The
            other arguments are those of ``EnvelopeSelectionEnv``.
    """

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 — Gymnasium's convention

    def __init__(
        self,
        num_envs: int = 1,
        problem: ProblemSource = "wall-3",
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata)
        checked_int(num_envs, "num_envs", least=1)
        beside = ("num_envs", "problem", "render_mode")
        task = SelectionTask(problem, settings_from(SelectionSettings, options, beside=beside))
        self.num_envs, self.autoreset_mode = num_envs, self.metadata["autoreset_mode"]
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        self._task = task
        self._sources = [copy.copy(task.scenes) for _ in range(num_envs)]
        self._rngs = [seeding.np_random()[0] for _ in range(num_envs)]
        self._at: list[LabelledScene] = []

    def reset(
        self, *, seed: int | _Seeds | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Observation, dict[str, Any]]:
        """Draw the next scenes.

        Arguments:
            seed: s seeds sub-environment i with s + i; or one per sub-environment.
            options: ``reset_mask``, shape (num_envs,), says which sub-environments draw; the others
                stay.

        Raises:
            InvalidInput: for another option, a mask of another shape or kind, and a seed that is
                none.
        """
        check_options(options, ("reset_mask",))
        if seed is None or isinstance(seed, int | np.integer):
            first = checked_seed(seed)
            seeds: _Seeds = [None if first is None else first + i for i in range(self.num_envs)]
        elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
            seeds = [checked_seed(one) for one in seed]
        else:
            raise InvalidInput(f"seed: expected one integer or {self.num_envs}, got {shown(seed)}")
        if len(seeds) != self.num_envs:
            raise InvalidInput(f"seed: expected one number or {self.num_envs}, got {len(seeds)}")
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = checked_mask(options["reset_mask"], self.num_envs)
            if not self._at and not mask.all():
                raise gym.error.ResetNeeded("reset all sub-environments before some of them")
        for index, given in enumerate(seeds):
            if mask[index] and given is not None:
                self._rngs[index] = seeding.np_random(given)[0]
        info = self._begin(mask)
        return all_seen(self._at), self._of_all(info)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        _Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Judge an action a sub-environment; every episode ends and the next one begins."""
        if not self._at:
            raise gym.error.ResetNeeded("reset the environment before the first step")
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise InvalidInput(
                f"actions: expected shape {self.action_space.shape}, got {actions.shape}"
            )
        verdicts = self._task.judge_all(
            self._at, [checked_action(action, self.single_action_space) for action in actions]
        )
        final, rows = all_seen(self._at), np.empty(self.num_envs, dtype=object)
        rows[:] = [
            {name: values[index] for name, values in final.items()}
            for index in range(self.num_envs)
        ]
        judged = self._of_all(_by_key([verdict.info for verdict in verdicts]))
        begun = self._begin(np.ones(self.num_envs, dtype=np.bool_))
        infos = self._of_all({**begun, "final_obs": rows, "final_info": judged})
        ended = np.ones(self.num_envs, dtype=np.bool_)
        rewards = np.array([verdict.reward for verdict in verdicts])
        return all_seen(self._at), rewards, ended, ~ended, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Draw the scenes that the next actions are for, one picture per sub-environment."""
        if not self._at:
            raise gym.error.ResetNeeded("reset the environment before rendering")
        from stancekit.views.sheet import to_rgb

        return tuple(to_rgb(picture(scene)) for scene in self._at)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts of the robot and the ground, as those of ``EnvelopeSelectionEnv``."""
        return doubts_of(self._task.law)

    def _begin(self, mask: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
        """Draw the next scenes of those in the mask; what is known of all before any action."""
        at: Sequence[LabelledScene | None] = self._at or [None] * self.num_envs
        drawn = zip(self._sources, self._rngs, at, mask, strict=True)
        self._at = [
            source.draw(rng) if draws or scene is None else scene
            for source, rng, scene, draws in drawn
        ]
        for scene in self._at:
            self._task.check(scene)
        return _by_key([self._task.before(scene) for scene in self._at])

    def _of_all(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """Join the infos of all sub-environments, as Gymnasium's ``_add_info`` does: each beside
        the mask of who has.
        """
        return {
            key: value
            for name, values in info.items()
            for key, value in ((name, values), (f"_{name}", np.ones(self.num_envs, dtype=np.bool_)))
        }


def _by_key(infos: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """The info of all sub-environments in one array under each key."""
    return {name: np.array([info[name] for info in infos]) for name in infos[0]}
