"""``stancekit/EnvelopeSelection-v0`` in batches: shared compiled models, one process or several.

``gymnasium.make_vec("stancekit.envs:stancekit/EnvelopeSelection-v0", num_envs=8)`` gives this
environment.
"""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stancekit.planners.arguments import settings_from
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import shown

from .episodes import check_options, checked_mask, checked_render_mode, checked_seed
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
    after ``reset(seed=s + i)``, whatever ``workers`` is.

    One thread at a time may use it. A copy (deepcopy, pickle) goes on as the original, with
    processes of its own.

    scenes: a source that keeps count of what it drew is copied for every sub-environment; a folder
    is read once a process.

    Arguments:
        workers: processes that draw and judge, each for an equal part of the batch, this one among
            them: with more than 1 the others need a main module that can be imported (``if __name__
            == "__main__"``). The other arguments are those of ``EnvelopeSelectionEnv``.
    """

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 — Gymnasium's convention

    def __init__(
        self,
        num_envs: int = 1,
        problem: ProblemSource = "wall-3",
        *,
        workers: int = 1,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata)
        checked_int(num_envs, "num_envs", least=1)
        checked_int(workers, "workers", least=1, most=num_envs)
        beside = ("num_envs", "problem", "workers", "render_mode")
        task = SelectionTask(problem, settings_from(SelectionSettings, options, beside=beside))
        self.num_envs, self.autoreset_mode = num_envs, self.metadata["autoreset_mode"]
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        self._ready, self._last = False, list[_Observation]()  # by part, what was seen last
        self._cuts = [round(k * num_envs / workers) for k in range(workers + 1)]
        sizes = np.diff(self._cuts).tolist()
        others = [_Worker(partial(_made, problem, options, size)) for size in sizes[1:]]
        self._parts: list[_Batch | _Worker] = [_Batch(task, sizes[0]), *others]

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
            if not self._ready and not mask.all():
                raise gym.error.ResetNeeded("reset all sub-environments before some of them")
        result: list[_Begun] = self._each(
            "reset", [(seeds[part], mask[part]) for part in self._slices()]
        )
        self._ready, self._last = True, [begun.observation for begun in result]
        return _joined(self._last), self._of_all(_gathered([begun.info for begun in result]))

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        _Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Judge an action a sub-environment; every episode ends and the next one begins."""
        if not self._ready:
            raise gym.error.ResetNeeded("reset the environment before the first step")
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise InvalidInput(
                f"actions: expected shape {self.action_space.shape}, got {actions.shape}"
            )
        results: list[_Stepped] = self._each("step", [actions[part] for part in self._slices()])
        final, rows = _joined(self._last), np.full(self.num_envs, None, dtype=object)
        rows[:] = [
            {name: values[index] for name, values in final.items()}
            for index in range(self.num_envs)
        ]
        infos_of_all = _gathered([result.info for result in results])
        begun = _gathered([result.begun.info for result in results])
        infos = self._of_all({**begun, "final_obs": rows, "final_info": self._of_all(infos_of_all)})
        rewards = np.array([reward for result in results for reward in result.rewards])
        ended, not_cut = (
            np.ones(self.num_envs, dtype=np.bool_),
            np.zeros(self.num_envs, dtype=np.bool_),
        )
        self._last = [result.begun.observation for result in results]
        return _joined(self._last), rewards, ended, not_cut, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Draw the scenes that the next actions are for, one picture per sub-environment."""
        if not self._ready:
            raise gym.error.ResetNeeded("reset the environment before rendering")
        pictures: list[list[NDArray[np.uint8]]] = self._each("render", [None] * len(self._parts))
        return tuple(picture for part in pictures for picture in part)

    def _of_all(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """Join the infos of all sub-environments, as Gymnasium's ``_add_info`` does: each beside
        the mask of who has.
        """
        masked = dict[str, Any]()
        for name, values in info.items():
            masked |= {name: values, f"_{name}": np.ones(self.num_envs, dtype=np.bool_)}
        return masked

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes."""
        for part in self._parts:
            part.close()

    def _slices(self) -> list[slice]:
        return [
            slice(begin, end) for begin, end in zip(self._cuts[:-1], self._cuts[1:], strict=True)
        ]

    def _each(self, method: str, arguments: Sequence[Any]) -> list[Any]:
        """Let all parts do this, at the same time; an error of one is raised after all have
        ended.
        """
        for part, argument in reversed(
            list(zip(self._parts, arguments, strict=True))
        ):  # this process is the first
            part.begin(method, argument)
        answers = [part.end() for part in self._parts]
        for answer in answers:
            if isinstance(answer, Exception):
                raise answer
        return answers


Rows = dict[str, list[Any]]
"""Info of some sub-environments, one entry per sub-environment under each key."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Begun:
    """The episodes that some sub-environments are in: observations, and info from before any
    action.
    """

    observation: _Observation
    info: Rows


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stepped:
    """A step of some sub-environments: rewards and info of the old scenes, and the episodes that
    begin.
    """

    rewards: list[float]
    info: Rows
    begun: _Begun


class _Batch:
    """Some sub-environments in one process: a task, and for each a generator, a source and the
    scene it is at.
    """

    def __init__(self, task: SelectionTask, size: int) -> None:
        self._task = task
        self._sources = [copy.copy(task.scenes) for _ in range(size)]
        self._rngs: list[np.random.Generator | None] = [None] * size
        self._at: list[LabelledScene] = []
        self._answer: Any = None

    def begin(self, method: str, argument: Any) -> None:
        """Do it now."""
        try:
            answers: dict[str, Callable[[Any], Any]] = {
                "reset": self.reset,
                "step": self.step,
                "render": self.render,
                "state": self.state,
            }
            self._answer = answers[method](argument)
        except Exception as error:  # raised by whoever asks for the answer
            self._answer = error

    def end(self) -> Any:
        """The answer, or the exception that came instead."""
        answer, self._answer = self._answer, None
        return answer

    def close(self) -> None:
        """Do nothing: there is no process to end."""

    def reset(self, asked: tuple[_Seeds, NDArray[np.bool_]]) -> _Begun:
        """Draw the next scenes of those in the mask; the seed None goes on with the generator that
        one has.
        """
        seeds, mask = asked
        for index, seed in enumerate(seeds):
            if mask[index] and (seed is not None or self._rngs[index] is None):
                self._rngs[index] = seeding.np_random(seed)[0]
        return self._draw(mask)

    def step(self, actions: NDArray[Any]) -> _Stepped:
        """Judge, and draw the next scenes."""
        verdicts = self._task.judge_all(self._at, actions)
        rewards = [verdict.reward for verdict in verdicts]
        return _Stepped(
            rewards=rewards,
            info=_by_key([verdict.info for verdict in verdicts]),
            begun=self._draw(),
        )

    def render(self, _: None) -> list[NDArray[np.uint8]]:
        """Draw every scene that there is."""
        from stancekit.views.sheet import to_rgb

        return [to_rgb(picture(scene)) for scene in self._at]

    def state(self, _: None) -> bytes:
        """Everything that a copy of this goes on from."""
        return pickle.dumps(self)

    def _draw(self, mask: NDArray[np.bool_] | None = None) -> _Begun:
        at: Sequence[LabelledScene | None] = self._at or [None] * len(self._sources)
        scenes = zip(
            self._sources,
            self._rngs,
            at,
            mask if mask is not None else [True] * len(at),
            strict=True,
        )
        self._at = [
            source.draw(rng) if draws or scene is None else scene
            for source, rng, scene, draws in scenes
            if rng is not None
        ]
        for scene in self._at:
            self._task.check(scene)
        return _Begun(
            observation=all_seen(self._at),
            info=_by_key([self._task.before(scene) for scene in self._at]),
        )


class _Worker:
    """A ``_Batch`` in a process of its own, which ends with this one."""

    def __init__(self, make: Callable[[], _Batch]) -> None:
        self._start(make)

    def _start(self, make: Callable[[], _Batch]) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_serve, args=(theirs, make), daemon=True
        )
        self._process.start()
        theirs.close()

    def __getstate__(self) -> bytes:
        self.begin("state", None)
        state = self.end()
        if isinstance(state, Exception):
            raise state
        return bytes(state)

    def __setstate__(self, state: bytes) -> None:
        self._start(partial(pickle.loads, state))

    def begin(self, method: str, argument: Any) -> None:
        """Send the call of a method; ``end`` reads its answer."""
        with suppress(BrokenPipeError):  # ``end`` tells
            self._pipe.send((method, argument))

    def end(self) -> Any:
        """Wait for the answer, or the exception that came instead."""
        try:
            return self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            return StancekitError(
                f"a worker process of the environment ended with code {self._process.exitcode}"
            )

    def close(self) -> None:
        """End the process."""
        with suppress(BrokenPipeError):
            self._pipe.send(None)
        self._pipe.close()
        self._process.join(timeout=5.0)
        if self._process.is_alive():
            self._process.terminate()


def _made(problem: ProblemSource, options: dict[str, Any], size: int) -> _Batch:
    return _Batch(SelectionTask(problem, SelectionSettings(**options)), size)


def _serve(pipe: Connection, make: Callable[[], _Batch]) -> None:
    """A worker's life: answer until None comes or the other end is gone."""
    batch = make()
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        while (request := pipe.recv()) is not None:
            batch.begin(*request)
            pipe.send(batch.end())


def _by_key(infos: Sequence[Mapping[str, Any]]) -> Rows:
    return {name: [info[name] for info in infos] for name in infos[0]}


def _gathered(parts: Sequence[Rows]) -> dict[str, NDArray[Any]]:
    """The info of all parts, in order, in one array under each key."""
    return {name: np.array([row for part in parts for row in part[name]]) for name in parts[0]}


def _joined(parts: Sequence[_Observation]) -> _Observation:
    """The rows of all parts, in order, in arrays of their own."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
