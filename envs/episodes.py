"""What all environments do alike: how a step is rewarded, how an episode is begun, gone on with and
drawn, and what is refused before any work is done.

A reward is a sum of terms by name, each with a weight. A user's term is one function and one
registration: a line in the table, an entry point of ``stancekit.reward_terms``, or
``weights={"mine.py:spread": 0.3}`` in any environment. The selection environments hand it a
``Judged``, all others a ``Step``.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.motion import Motion, doubts_of
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import check_numbers, checked, checked_int
from stancekit.planners.files.documents import shown, typed
from stancekit.planners.plugins import Registry, foreign, takes
from stancekit.planners.problem import Problem
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.walk import Walk
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import Envelope, RelaxationAnswer
from stancekit.planners.verify.margins import stance_margins
from stancekit.planners.verify.stance_margin import compiled

from .scenes import LabelledScene


class Finite:
    """Base of weights: each is a finite number."""

    def __post_init__(self) -> None:
        check_numbers(self, finite=vars(self))


@dataclass(frozen=True, kw_only=True)
class RewardWeights(Finite):
    """Weights of the reward of a step: reward = agreement · [P1 says what the expert says] +
    projection · [the chosen projection reaches a verified posture] + tightness · [1 − mean width of
    the box / width of the domain].
    """

    agreement: float = 1.0
    projection: float = 0.5
    tightness: float = 0.1


USUAL = RewardWeights()


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """Arguments of the terms of a reward: an action on one scene, judged.

    Arguments:
        scene: the scene, with the expert's label.
        answer: answer of P1 over the chosen envelope.
        envelope: the chosen one.
        projections: the projections that were tried, in their order.
        postures: posture that the verifier accepted, by the projection that ends in it.
    """

    scene: LabelledScene
    answer: RelaxationAnswer
    envelope: Envelope
    projections: tuple[Projection, ...]
    postures: Mapping[Projection, Plan]

    @property
    def right(self) -> bool:
        """True if P1 agrees with the expert."""
        return self.answer.known and self.answer.feasible == self.scene.feasible

    @property
    def reached(self) -> bool:
        """True if the first projection ends in a verified posture."""
        return self.projections[0] in self.postures

    @property
    def posture(self) -> Plan | None:
        """The posture of the first projection that has one."""
        return next((self.postures[way] for way in self.projections if way in self.postures), None)


def agreement(judged: Judged) -> float:
    """1 where P1 says what the expert says."""
    return float(judged.right)


def projection(judged: Judged) -> float:
    """1 where the first projection reaches a verified posture."""
    return float(judged.reached)


def tightness(judged: Judged) -> float:
    """1 for a box without width, 0 for one as wide as the domain."""
    widths = judged.envelope.high - judged.envelope.low
    return 1.0 - float(widths.sum()) / widths.size / 2.0


def support(step: Judged | Step) -> float:
    """How far the centre of mass of the posture or plan that the step ended with may move in every
    direction before some stance no longer carries it [m]; 0 where there is none.
    """
    return _least_margin(step, "support_m")


def push(step: Judged | Step) -> float:
    """The largest horizontal push that every stance of it bears, in units of the weight, likewise."""
    return _least_margin(step, "push_n")


def _least_margin(step: Judged | Step, name: str) -> float:
    plan = step.posture if isinstance(step, Judged) else step.answer
    if not isinstance(plan, Motion) or not plan.keyed:
        return 0.0
    compiled()  # as there are many steps
    return float(
        stance_margins(plan, (name,))[name].min()
        / (plan.problem.weight_n if name == "push_n" else 1.0)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """Arguments of a user's term in the environments that do not select: a step, judged.

    Arguments:
        reward: of the environment's own terms.
        question: problem, course, leap or walk of the episode.
        answer: posture, plan of the window, leap or motion that the step ended with, as the
            verifier accepted it, or as the optimiser left it in WarpedGait; None where there is
            none, as at steps of a pool of walks.
        action: the action, as it came.
        info: ``info`` of the step, without what users' terms come to.
        terminated, truncated: whether the step ended the episode, and how.
    """

    reward: float = 0.0
    question: Problem | Leap | Walk | None = None
    answer: Any = None
    action: Any
    info: Mapping[str, Any]
    terminated: bool
    truncated: bool = False


@dataclass(frozen=True, kw_only=True)
class SearchWeights(Finite):
    """Weights of the reward of a step of a search: success · [it has come to its end] − solves ·
    (share of the convex problems of an episode that it took).
    """

    success: float = 1.0
    solves: float = 1.0

    def of(self, ended: bool, share: float) -> float:
        """The reward of a step."""
        return self.success * float(ended) - self.solves * share


USUAL_SEARCH = SearchWeights()
Term = Callable[[Any], float]
Weights = TypeVar("Weights")
_TERMS: Registry[Term] = Registry(
    "reward term",
    "stancekit.reward_terms",
    {
        name: f"{__name__}:{name}"
        for name in ("agreement", "projection", "tightness", "support", "push")
    },
    expected="a function of a Judged or a Step",
    accepts=lambda it: takes(it, 1),
)
"""All terms by name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Terms:
    """Terms of a reward.

    Arguments:
        by_key: weight and function of each, by the key of ``info`` that has what it comes to.
    """

    by_key: Mapping[str, tuple[float, Term]]

    @property
    def nothing(self) -> dict[str, float]:
        """The values before a step."""
        return dict.fromkeys(self.by_key, 0.0)

    def of(self, judged: Judged | Step) -> dict[str, float]:
        """The value of each, times its weight.

        Raises InvalidInput where one fails, or gives no finite number.
        """
        return {key: weight * term(judged) for key, (weight, term) in self.by_key.items()}


def _guarded(term: Term, name: str, judged: Judged | Step) -> float:
    """The value of a user's term, which a message names where it is no finite number."""
    with foreign(f"weights.{name}: expected a number, got"):
        value = float(term(judged))
    return checked(value, f"weights.{name}")


def weighted(weights: Any, kind: type[Weights], *, named: bool = False) -> tuple[Weights, Terms]:
    """Weights of the environment's own terms, and further terms.

    Arguments:
        weights: some of ``kind``; or a mapping with some of its keys, whose others keep their
            defaults, and names of further terms.
        named: whether the keys of ``kind`` name terms themselves, which are then among them.

    Raises:
        InvalidInput: for a term that there is not, a weight that is no number, and two terms of one
            key.
    """
    known = list(kind.__dataclass_fields__)  # type: ignore[attr-defined]
    values = asdict(weights) if isinstance(weights, kind) else dict(weights)  # type: ignore[call-overload]
    own = typed(kind, {name: values[name] for name in known if name in values}, "weights")
    every = {name: value for name, value in values.items() if name not in known}
    terms: dict[str, tuple[float, Term]] = {}
    for name, weight in ({**asdict(own), **every} if named else every).items():  # type: ignore[call-overload]
        last = re.sub(r"[^0-9A-Za-z]+", "_", name.rpartition(":")[2])
        key = f"reward_{last}"
        if key in terms or (last in known and name != last):
            raise InvalidInput(f"weights: expected terms of different names, got {key} twice")
        try:
            factor = checked(weight, f"weights.{name}")
            term = _TERMS.get(name, known=(*known, "support", "push"))
            ours = term.__module__ == __name__
            terms[key] = factor, term if ours else partial(_guarded, term, name)
        except InvalidInput as error:
            said = re.sub(r"^(reward term|weights\.\S+): ", "", str(error))
            raise InvalidInput(f"weights.{name}: {said}") from None
    return own, Terms(by_key=terms)


Observation = Mapping[str, NDArray[Any]]


class MemorylessPolicy:
    """Adapter to call a rule, or a selector, which has an ``action`` alone, as policies of
    stable-baselines3 are called.

    Arguments:
        rule: from an observation, or a batch of them, to the action; classes with an ``action`` of
            their own need none.
    """

    def __init__(self, rule: Callable[[Observation], NDArray[Any]]) -> None:
        self._rule = rule

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return (action, state), the state as it came: an action of the environment, or a row an
        observation.
        """
        return self.action(observation), state

    def action(self, observation: Observation) -> NDArray[Any]:
        """The action; of a batch of observations one a row.

        Raises InvalidInput where it was made for others.
        """
        return self._rule(observation)


LEAST = 1e-9
"""Least value of gaps and widths, so that they have logarithms."""


def largest_gap(observation: Observation) -> NDArray[np.int64]:
    """The wider dimension of the largest gap, where P1's answer is farthest off the bilinear
    surface, or the widest one where there is no gap: the textbook rule for bilinear problems.

    Both factors of the worst product have its gap as their score; the width tells which of them to
    cut.
    """
    gap, width = observation["gap"], observation["high"] - observation["low"]
    worst = gap >= gap.max(axis=-1, keepdims=True)
    return np.asarray(np.argmax(np.where(worst, width, -1.0), axis=-1))


def widest(observation: Observation) -> NDArray[np.int64]:
    """The longest edge of the box."""
    return np.asarray(np.argmax(observation["high"] - observation["low"], axis=-1))


def noisy_gap(rng: np.random.Generator, *, spread: float) -> MemorylessPolicy:
    """Policy that branches on the largest product of gap and width, up to chance: log(gap · width)
    + spread · Gumbel noise.
    """
    return MemorylessPolicy(partial(_noisy, rng=rng, spread=spread))


def _noisy(
    observation: Observation, *, rng: np.random.Generator, spread: float
) -> NDArray[np.int64]:
    score = np.log(np.maximum(observation["gap"], LEAST)) + np.log(
        np.maximum(observation["high"] - observation["low"], LEAST)
    )
    return np.asarray(np.argmax(score + spread * rng.gumbel(size=score.shape), axis=-1))


def any_dimension(rng: np.random.Generator) -> MemorylessPolicy:
    """Policy that branches on any dimension, each as likely."""
    return MemorylessPolicy(partial(_drawn, rng=rng))


def _drawn(observation: Observation, *, rng: np.random.Generator) -> NDArray[np.int64]:
    shape = np.shape(observation["gap"])
    return np.asarray(rng.integers(shape[-1], size=shape[:-1]))


_IGNORED = ("minari_autoseed",)
"""Options of ``reset`` that are for a collector around an environment, which hands them on."""


def checked_render_mode(mode: Any, metadata: Mapping[str, Any]) -> str | None:
    """Return a render mode that the metadata of an environment has, or None.

    Raises InvalidInput.
    """
    modes = metadata["render_modes"]
    if mode is not None and mode not in modes:
        raise InvalidInput(f"render_mode: expected one of {modes}, got {shown(mode)}")
    return None if mode is None else str(mode)


def checked_seed(seed: Any) -> int | None:
    """Return the seed of ``reset`` as an int of 0 or more, or None.

    Raises InvalidInput.
    """
    return None if seed is None else checked_int(seed, "seed")


def check_options(options: Any, known: Collection[str] = ()) -> None:
    """Raise InvalidInput for options of ``reset`` that an environment does not have."""
    if options is not None and not isinstance(options, Mapping):
        raise InvalidInput(f"options: expected a mapping or None, got {shown(options)}")
    strange = [name for name in options or () if name not in known and name not in _IGNORED]
    if strange:
        wanted = f"one of {', '.join(known)}" if known else "none"
        raise InvalidInput(f"options: expected {wanted}, got {', '.join(map(str, strange))}")


_BEYOND = 1e-6
"""Distance by which rounding may carry the numbers of an action out of their box."""


def checked_action(action: Any, space: spaces.Space[Any]) -> NDArray[Any]:
    """Return an action of a space: whole numbers as int64, those of a box as float64.

    Raises InvalidInput for another shape, what is beyond its limits, fractions of whole numbers,
    truth values, and what is no number.
    """
    array = np.asarray(action)
    if isinstance(space, spaces.Box):
        low, high, kinds = space.low, space.high, "fiu"
    else:
        low, kinds = np.asarray(getattr(space, "start", 0)), "iu"
        high = np.asarray(getattr(space, "nvec", getattr(space, "n", 0))) - 1 + low
    if array.shape != space.shape:
        raise InvalidInput(f"action: expected shape {space.shape}, got {array.shape}")
    if array.dtype.kind not in kinds or not (
        (array >= low - _BEYOND).all() and (array <= high + _BEYOND).all()
    ):
        ends = np.unique(high).tolist()
        most = f"{ends[0]:g}" if len(ends) == 1 else tuple(high.ravel().tolist())
        numbers = f"{'finite' if kinds == 'fiu' else 'whole'} numbers, {low.min():g} to {most}"
        raise InvalidInput(f"action: expected {numbers}, got {shown(action)}")
    return array.astype(np.float64 if kinds == "fiu" else np.int64)


def checked_mask(mask: Any, count: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return a ``reset_mask`` of Gymnasium: which of ``count`` sub-environments are reset, one at
    least.

    Raises InvalidInput for anything but truth values, shape (count,), of which one is true.
    """
    array = np.asarray(mask)
    if array.shape != (count,) or array.dtype != np.bool_ or not array.any():
        wanted = f"an array of truth values, shape ({count},), one or more of them true"
        raise InvalidInput(f"options: reset_mask: expected {wanted}, got {shown(mask)}")
    return array


_WINDOW = "stancekit"
Episode = TypeVar("Episode")


class TaskEnv(gym.Env[dict[str, NDArray[np.float32]], Any], ABC, Generic[Episode]):
    """An environment but for its task, which has the spaces, and says how an episode begins, what
    an action does, what is seen then, and how it is drawn.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 — Gymnasium's own convention
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    _terms = Terms(by_key={})
    _law: Any = None

    def __init__(self, render_mode: str | None) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata)
        self._episode: Episode | None = None
        self._ended = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw the next episode."""
        check_options(options)
        super().reset(seed=checked_seed(seed))
        (self._episode, info), self._ended = self._begin(), False
        if self.render_mode == "human":
            self.render()
        return self._observe(self._episode), info | self._terms.nothing

    def step(
        self, action: Any
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Do as the action says, and judge it."""
        episode = self._now("the first step")
        if self._ended:
            raise gym.error.ResetNeeded("the episode is over: reset the environment")
        done = self._act(episode, action)
        self._ended = done.terminated or done.truncated
        own = self._terms.of(done)
        if self.render_mode == "human":
            self.render()
        reward = float(sum((done.reward, *own.values())))
        info = {**done.info, **own}
        return self._observe(episode), reward, done.terminated, done.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the episode as it is now; for "human" on the screen, or, on a machine without one,
        nowhere.
        """
        from stancekit.views.sheet import to_rgb

        pixels = to_rgb(self._drawn(self._now("rendering")))
        if self.render_mode != "human":
            return pixels
        import matplotlib.pyplot as plt

        plt.figure(_WINDOW, clear=True).figimage(pixels, resize=True)
        plt.pause(0.001)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.render_mode == "human":
            import matplotlib.pyplot as plt

            plt.close(_WINDOW)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts of the robot and the ground, one line each, as an answer has them, which ``info``,
        numbers alone, cannot say; where courses are drawn those of this episode's.
        """
        return doubts_of(self._law or self._now("asking for its doubts"))

    def _now(self, before: str) -> Episode:
        """The episode.

        Raises ResetNeeded before the first one.
        """
        if self._episode is None:
            raise gym.error.ResetNeeded(f"reset the environment before {before}")
        return self._episode

    def _try_terms(self, question: Any, info: Mapping[str, Any], terminated: bool = False) -> None:
        """Ask users' terms about a question of which nothing was tried: what they may not bear
        is told at once.
        """
        action = np.zeros(self.action_space.shape or (), dtype=np.int64)[()]
        self._terms.of(Step(question=question, action=action, info=info, terminated=terminated))

    @abstractmethod
    def _begin(self) -> tuple[Episode, dict[str, Any]]:
        """An episode drawn with the environment's generator, and its info."""

    @abstractmethod
    def _act(self, episode: Episode, action: Any) -> Step:
        """What an action comes to."""

    @abstractmethod
    def _observe(self, episode: Episode) -> dict[str, NDArray[np.float32]]:
        """What the agent sees."""

    @abstractmethod
    def _drawn(self, episode: Episode) -> Any:
        """A figure of it."""


def flat(values: Any, room: float) -> NDArray[np.float32]:
    """Numbers of an observation, those beyond ``room`` clipped."""
    return np.clip(np.ravel(values), -room, room).astype(np.float32)


def boxes(bounds: Mapping[str, tuple[float, float, int]]) -> spaces.Dict:
    """The space of flat float32 boxes, each with its lowest and highest number and its size."""
    return spaces.Dict(
        {
            name: spaces.Box(low, high, (size,), np.float32)
            for name, (low, high, size) in bounds.items()
        }
    )
