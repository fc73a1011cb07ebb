"""``stancekit/EnvelopeSelection-v0`` in batches: shared compiled models, one process or several.

``gymnasium.make_vec("stancekit.envs:stancekit/EnvelopeSelection-v0", num_envs=8)`` gives this environment.
"""

from __future__ import annotations

import copy
import multiprocessing
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import checked_int

from .distributions.postures import Distribution
from .scenes import Scene, SceneKind, all_seen
from .selection_task import SelectionOptions, SelectionSettings, SelectionTask

Observation = dict[str, NDArray[np.float32]]
Seeds = Sequence[int | None]


class EnvelopeSelectionVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """``num_envs`` copies of ``EnvelopeSelectionEnv`` in one: a step judges an action each and draws the next scenes.

    Autoreset is SAME_STEP: what ``step`` returns is the observation of the next scenes; ``infos["final_obs"]`` and
    ``infos["final_info"]`` are those of the scenes that the actions were for. Sub-environment i with seed s + i lives
    through exactly what the single environment does after ``reset(seed=s + i)``, whatever ``workers`` is.

    scenes: a source that keeps count of what it drew is copied for every sub-environment; a folder is read once a
    process. workers: processes that draw and judge, each for an equal part of the batch, this one among them: with
    more than 1 the others need a main module that can be imported (``if __name__ == "__main__"``). The other arguments
    are those of ``EnvelopeSelectionEnv``.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 — Gymnasium's convention

    def __init__(
        self,
        num_envs: int = 1,
        problem: str | Distribution | SceneKind = "wall-3",
        *,
        workers: int = 1,
        render_mode: str | None = None,
        **options: Unpack[SelectionOptions],
    ) -> None:
        if render_mode is not None:
            raise InvalidInput(f"render_mode: expected None for a batch of environments, got {render_mode!r}")
        checked_int(num_envs, "num_envs", least=1)
        if not 1 <= workers <= num_envs:
            raise InvalidInput(f"workers: expected 1 to num_envs = {num_envs}, got {workers}")
        task = SelectionTask(problem, SelectionSettings(**options))
        self.num_envs = num_envs
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        self._ready, self._last = False, list[Observation]()  # by part, what was seen last
        self._cuts = [round(k * num_envs / workers) for k in range(workers + 1)]
        sizes = np.diff(self._cuts).tolist()
        others = [_Worker(problem, options, size) for size in sizes[1:]]
        self._parts: list[_Batch | _Worker] = [_Batch(task, sizes[0]), *others]

    def reset(
        self, *, seed: int | Seeds | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw the next scenes. seed: s seeds sub-environment i with s + i; or one a sub-environment."""
        if seed is None or isinstance(seed, int | np.integer):
            seeds: Seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InvalidInput(f"seed: expected one number or {self.num_envs}, got {len(seeds)}")
        found = self._each("reset", [seeds[part] for part in self._slices()])
        self._ready, self._last = True, found
        return _joined(found), {}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Judge an action a sub-environment; every episode ends and the next one begins."""
        if not self._ready:
            raise gym.error.ResetNeeded("reset the environment before the first step")
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise InvalidInput(f"actions: expected shape {self.action_space.shape}, got {actions.shape}")
        results: list[_Stepped] = self._each("step", [actions[part] for part in self._slices()])
        final, rows = _joined(self._last), np.full(self.num_envs, None, dtype=object)
        rows[:] = [{name: values[index] for name, values in final.items()} for index in range(self.num_envs)]
        told = {name: np.array([row for one in results for row in one.info[name]]) for name in results[0].info}
        infos = self._of_all({"final_obs": rows, "final_info": self._of_all(told)})
        rewards = np.array([reward for result in results for reward in result.rewards])
        ended, not_cut = np.ones(self.num_envs, dtype=np.bool_), np.zeros(self.num_envs, dtype=np.bool_)
        self._last = [result.observation for result in results]
        return _joined(self._last), rewards, ended, not_cut, infos

    def _of_all(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """What Gymnasium's ``_add_info`` makes of what all sub-environments have: each beside the mask of who has."""
        masked = dict[str, Any]()
        for name, values in info.items():
            masked |= {name: values, f"_{name}": np.ones(self.num_envs, dtype=np.bool_)}
        return masked

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes."""
        for part in self._parts:
            part.close()

    def _slices(self) -> list[slice]:
        return [slice(begin, end) for begin, end in zip(self._cuts[:-1], self._cuts[1:], strict=True)]

    def _each(self, method: str, arguments: Sequence[Any]) -> list[Any]:
        """Let all parts do this, at the same time; an error of one is raised after all have ended."""
        for part, argument in reversed(list(zip(self._parts, arguments, strict=True))):  # this process is the first
            part.begin(method, argument)
        answers = [part.end() for part in self._parts]
        for answer in answers:
            if isinstance(answer, Exception):
                raise answer
        return answers


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stepped:
    """A step of some sub-environments: rewards and info of the old scenes, a row each, observations of the new."""

    rewards: list[float]
    info: dict[str, list[Any]]
    observation: Observation


class _Batch:
    """Some sub-environments in one process: a task, and for each a generator, a source and the scene it is at."""

    def __init__(self, task: SelectionTask, size: int) -> None:
        self._task = task
        self._sources = [copy.copy(task.scenes) for _ in range(size)]
        self._rngs: list[np.random.Generator | None] = [None] * size
        self._at: list[Scene] = []
        self._answer: Any = None

    def begin(self, method: str, argument: Any) -> None:
        """Do it now."""
        try:
            self._answer = self.reset(argument) if method == "reset" else self.step(argument)
        except Exception as error:  # raised by whoever asks for the answer
            self._answer = error

    def end(self) -> Any:
        """The answer, or the exception that came instead."""
        answer, self._answer = self._answer, None
        return answer

    def close(self) -> None:
        """Nothing is open."""

    def reset(self, seeds: Seeds) -> Observation:
        """Draw the next scenes; None goes on with the generator that a sub-environment has."""
        for index, seed in enumerate(seeds):
            if seed is not None or self._rngs[index] is None:
                self._rngs[index] = seeding.np_random(seed)[0]
        return self._draw()

    def step(self, actions: NDArray[Any]) -> _Stepped:
        """Judge, and draw the next scenes."""
        verdicts = self._task.judge_all(self._at, actions)
        return _Stepped(
            rewards=[verdict.reward for verdict in verdicts],
            info={name: [verdict.info[name] for verdict in verdicts] for name in verdicts[0].info},
            observation=self._draw(),
        )

    def _draw(self) -> Observation:
        self._at = [source.draw(rng) for source, rng in zip(self._sources, self._rngs, strict=True) if rng is not None]
        for scene in self._at:
            self._task.check(scene)
        return all_seen(self._at)


class _Worker:
    """A ``_Batch`` in a process of its own, which ends with this one."""

    def __init__(self, problem: str | Distribution | SceneKind, options: SelectionOptions, size: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs, problem, options, size), daemon=True)
        self._process.start()
        theirs.close()

    def begin(self, method: str, argument: Any) -> None:
        """Ask for it."""
        with suppress(BrokenPipeError):  # ``end`` tells
            self._pipe.send((method, argument))

    def end(self) -> Any:
        """Wait for the answer, or the exception that came instead."""
        try:
            return self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            return StancekitError(f"a worker process of the environment ended with code {self._process.exitcode}")

    def close(self) -> None:
        """End the process."""
        with suppress(BrokenPipeError):
            self._pipe.send(None)
        self._pipe.close()
        self._process.join(timeout=5.0)
        if self._process.is_alive():
            self._process.terminate()


def _serve(pipe: Connection, problem: str | Distribution | SceneKind, options: SelectionOptions, size: int) -> None:
    """A worker's life: answer until None comes or the other end is gone."""
    batch = _Batch(SelectionTask(problem, SelectionSettings(**options)), size)
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        while (request := pipe.recv()) is not None:
            batch.begin(*request)
            pipe.send(batch.end())


def _joined(parts: Sequence[Observation]) -> Observation:
    """The rows of all parts, in order, in arrays of their own."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
