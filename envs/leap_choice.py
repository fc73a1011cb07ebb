"""``stancekit/LeapChoice-v0``: choose where the toes of a leap push off and land, in a few
tries.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.plan import LeapPlan
from stancekit.planners.arguments import settings_from
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.leap.numbers import LeapNumbers, LeapPoint
from stancekit.planners.leap.scp import (
    OF_CANDIDATE,
    OF_LEAP,
    LeapFeatures,
    attempt,
    plan_from,
    plan_of,
)
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

from .episodes import (
    USUAL_SEARCH,
    SearchWeights,
    Step,
    TaskEnv,
    boxes,
    checked_action,
    flat,
    weighted,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Observation = dict[str, NDArray[np.float32]]
_ROOM = 10.0
"""Bound on the numbers of an observation."""
INFO: Mapping[str, int | float] = MappingProxyType(
    {
        "is_success": 0,
        "tries": 0,
        "solves": 0,
        "masked": 0,
        "repeated": 0,
        "refuted": 0,
        "cost": 0.0,
    }
)
"""``info`` before anything was tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapChoiceSettings:
    """Keywords of ``LeapChoiceEnv``; its page has their meaning.

    Raises InvalidInput.
    """

    problem: str = "leap-hard"
    scenes: str | Path | None = None
    tries: int = 6
    solves: int = 12
    weights: SearchWeights | Mapping[str, float] = USUAL_SEARCH

    def __post_init__(self) -> None:
        weighted(self.weights, SearchWeights)
        leap_class(self.problem)
        checked_int(self.tries, "tries", least=1)
        checked_int(self.solves, "solves", least=1)

    def source(self) -> list[Leap] | None:
        """The scenes of a folder's part, None where they are drawn.

        Raises InvalidInput.
        """
        if self.scenes is None:
            return None
        from .data.leap_tries import LeapTries  # Arrow takes a while to load
        from .data.ledger import folder_and_part

        folder, part = folder_and_part(self.scenes)
        tries = LeapTries.open(folder)
        if tries.problem_class != self.problem:
            raise InvalidInput(
                f"scenes: expected tries of {self.problem}, got {tries.problem_class} in {folder}"
            )
        leaps = [
            leap
            for leap, their_part in zip(tries.leaps(), tries.parts(), strict=True)
            if part in ("all", their_part)
        ]
        if not leaps:
            raise InvalidInput(f"scenes: expected scenes in the part {part}, got none in {folder}")
        return leaps


class _Episode:
    """One leap, and what was tried of it.

    Arguments:
        options: R, to which features are padded.
    """

    def __init__(
        self, leap: Leap, settings: LeapChoiceSettings, programs: Programs, options: int
    ) -> None:
        self._settings, self._programs = settings, programs
        self._timings = [LeapNumbers.of(leap, k) for k in range(len(leap.timings_s))]
        self._features = [LeapFeatures.of(each).padded(options) for each in self._timings]
        self._tried: set[tuple[int, ...]] = set()
        self._last: tuple[LeapNumbers, LeapPoint] | None = None
        self._choice: NDArray[np.int64] | None = None
        self._note: dict[str, int | float] = {}
        self.tries = self.solves = 0
        self.plan: LeapPlan | None = None

    @property
    def _turn(self) -> int:
        return self.tries % len(self._timings)

    @property
    def numbers(self) -> LeapNumbers:
        """The leap with the timing whose turn it is."""
        return self._timings[self._turn]

    @property
    def seen(self) -> LeapFeatures:
        """Features that the agent sees at this turn."""
        return self._features[self._turn]

    @property
    def shape(self) -> tuple[int, int]:
        """P and R."""
        feet, options = self.seen.mask.shape
        return feet, options

    @property
    def solved(self) -> bool:
        """Tell whether there is a leap."""
        return self.plan is not None

    @property
    def over(self) -> bool:
        """Tell whether there is a leap, or no try left."""
        spent = self.tries >= self._settings.tries or self.solves >= self._settings.solves
        return self.solved or spent

    def attempt(self, choice: NDArray[np.int64]) -> None:
        """Try a choice."""
        numbers, mask, turn = self.numbers, self.seen.mask, self._turn
        masked = bool((mask[np.arange(len(choice)), choice] == 0.0).any())
        repeated = (turn, *choice.tolist()) in self._tried
        self._tried.add((turn, *choice.tolist()))
        self.tries += 1
        self._choice, self._last = choice, None
        solution = None
        if masked or repeated:
            self.solves += 1
        else:
            solution = attempt(self._programs, numbers, choice)
            self._last = None if solution.point is None else (numbers, solution.point)
            self.solves += solution.solves
            if self.solves <= self._settings.solves and solution.solved:
                plan = plan_of(numbers, solution, "choice")
                self.plan = plan if check_leap(plan).accepted else None
        cost = -1.0 if solution is None or not math.isfinite(solution.cost) else solution.cost
        self._note = {
            "masked": int(masked),
            "repeated": int(repeated),
            "refuted": int(solution is not None and solution.refuted),
            "cost": float(cost),
        }

    def observe(self) -> _Observation:
        """Observation of the agent."""
        seen, mask = self.seen, self.seen.mask
        last = np.zeros(mask.shape)
        if self._choice is not None:
            last[np.arange(len(last)), self._choice] = 1.0
        left = (1.0 - self.tries / self._settings.tries, 1.0 - self.solves / self._settings.solves)
        parts = {
            "candidates": seen.candidates,
            "mask": mask,
            "leap": seen.leap,
            "last": last,
            "residual": self._residual(),
            "left": np.maximum(left, 0.0),
        }
        return {name: flat(each, _ROOM) for name, each in parts.items()}

    def _residual(self) -> Array:
        """Per interval, how far L and Θ of the last try are from what its forces give, shape (2,
        M).
        """
        if self._last is None:
            return np.zeros((2, self.numbers.intervals))
        numbers, point = self._last
        change, turned = numbers.turned(point)
        off = (
            np.diff(point.momentum, axis=0) - change,
            np.diff(point.rotation[::2], axis=0) - turned,
        )
        return np.array([np.log10(1.0 + 1e3 * np.linalg.norm(each, axis=1)) for each in off])

    def info(self) -> dict[str, Any]:
        """Numbers of fixed shape."""
        figures = {"is_success": int(self.solved), "tries": self.tries, "solves": self.solves}
        return {**INFO, **self._note, **figures}

    def drawn(self) -> Any:
        """The plan of the last try, or the first candidates with the nominal motion."""
        if self._last is not None and self._choice is not None:
            (numbers, point), choice = self._last, self._choice
            toes = point.toes
        else:
            numbers, point = self.numbers, self.numbers.nominal
            choice = (
                np.zeros(self.shape[0], dtype=np.int64) if self._choice is None else self._choice
            )
            choice = np.where(self.seen.mask[np.arange(len(choice)), choice] > 0.0, choice, 0)
            toes = np.array([piece.mean(axis=0) for piece in numbers.scaled.chosen(choice).pieces])
        forces = np.zeros((numbers.intervals, len(numbers.leap.robot.limbs), 3))
        forces[numbers.contact_intervals, numbers.layout.contacts[1]] = (
            point.forces * numbers.leap.weight_n
        )
        return plan_from(numbers, choice, toes, forces, "choice")


class LeapChoiceEnv(TaskEnv[_Episode]):
    """Choose where the toes of a leap push off and land; a convex program and the verifier judge
    the choice.

    ## Description

    One leap per episode: a body stands, flies and stands again, and each of its P toes has R
    candidate patches at most. The agent picks one candidate per toe. A sequence of convex programs
    tries the choice; it gives up after the first program if the violation that is left there is so
    large that the others would hardly remove it. A choice that is solved goes to the verifier. If
    the leap has several timings, each of them is tried in turn.

    ## Observation Space

    A ``Dict`` of flat float32 ``Box``es, in SI units, clipped to ± 10; P footholds, R candidates, M
    intervals:

    | name | shape | meaning |
    |---|---|---|
    | candidates | (22 * P * R,) | features of each candidate, ``planners.leap.features.OF_CANDIDATE``; 0 without one |
    | mask | (P * R,) | 1 where there is a candidate |
    | leap | (10,) | features of the leap and its timing, ``planners.leap.features.OF_LEAP`` |
    | last | (P * R,) | 1 at the candidates of the last try |
    | residual | (2 * M,) | per interval, errors x of momentum and rotation in the last try, as log10(1 + 1000 x) |
    | left | (2,) | shares of the tries and of the solves that are left |

    ## Action Space

    ``MultiDiscrete`` with P numbers below R: a candidate per foothold. ``action_masks()`` says
    which there are, shape (P * R,), as MaskablePPO asks for it.

    ## Reward

    −solves · (convex problems solved in the step) / ``solves``, and +success with a leap that the
    verifier accepts, with the weights of ``SearchWeights``, which are 1. A choice that names a
    missing candidate, or that was tried before, counts as a failed try of one convex problem.

    ## Starting State

    A scene of the class ``problem``, drawn with the environment's generator, or one of ``scenes``.
    Some of the scenes have no leap; which ones is not known.

    ## Episode End

    Terminated when the verifier accepts a leap. Truncated when ``tries`` choices or ``solves``
    convex problems are spent.

    ## Info

    After a reset and a step (numeric, fixed shapes): ``is_success``, ``tries`` and ``solves`` so
    far, whether the last choice was ``masked`` (no such candidate), ``repeated``, or ``refuted``
    (its hard constraints have no solution), and its ``cost`` (the remaining violation of its
    constraints; −1 if the first convex program has no solution).

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | problem | 'leap-hard' | a class of leaps, of ``configs/leaps.yaml`` |
    | scenes | None | folder of labelled tries, whose part "train" is drawn from; or FOLDER:test, :calibration, :all |
    | tries | 6 | choices per episode |
    | solves | 12 | convex problems per episode |
    | weights | SearchWeights() | weights of the reward; or a mapping with some of its keys, and terms of your own |
    | render_mode | None | "rgb_array" |

    ## Version History

    - v0: the first version
    """

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(render_mode)
        self._settings = settings_from(LeapChoiceSettings, options, beside=("render_mode",))
        self._class = leap_class(self._settings.problem)
        self._scenes = self._settings.source()
        self._programs = Programs()
        self._weights, self._terms = weighted(self._settings.weights, SearchWeights)
        leap = self._class.draw(np.random.default_rng(0))
        like = self._begun(leap)
        self.observation_space = _space(like)
        self.action_space = spaces.MultiDiscrete(np.full(like.shape[0], like.shape[1]))
        self._try_terms(leap, INFO)

    def _begin(self) -> tuple[_Episode, dict[str, Any]]:
        if self._scenes is None:
            leap = self._class.draw(self.np_random)
        else:
            leap = self._scenes[int(self.np_random.integers(len(self._scenes)))]
        episode = self._begun(leap)
        return episode, episode.info()

    def _begun(self, leap: Leap) -> _Episode:
        return _Episode(leap, self._settings, self._programs, self._class.candidates)

    def _act(self, episode: _Episode, action: NDArray[np.int64]) -> Step:
        """Try a candidate per foothold."""
        before = episode.solves
        episode.attempt(checked_action(action, self.action_space))
        spent = max(episode.solves - before, 1)
        return Step(
            reward=self._weights.of(episode.solved, spent / self._settings.solves),
            terminated=episode.solved,
            truncated=episode.over and not episode.solved,
            info=episode.info(),
            question=episode.numbers.leap,
            answer=episode.plan,
            action=action,
        )

    def _observe(self, episode: _Episode) -> _Observation:
        return episode.observe()

    def action_masks(self) -> NDArray[np.bool_]:
        """Mask of the candidates that exist, shape (P * R,), foothold by foothold."""
        return np.asarray(self._now("asking for its masks").seen.mask.ravel() > 0.0)

    @property
    def numbers(self) -> LeapNumbers:
        """The leap with the timing of the next try, for policies that look at more than the
        observation.
        """
        return self._now("asking for its leap").numbers

    def _drawn(self, episode: _Episode) -> Figure:
        """The leap of the last try; on its toes the nominal motion where it has none, and before
        there is one.
        """
        from stancekit.views.leaps import draw_leap
        from stancekit.views.sheet import SIZE_PX

        return draw_leap(episode.drawn(), size_px=SIZE_PX)


def _space(like: _Episode) -> spaces.Dict:
    feet, options = like.shape
    return boxes(
        {
            "candidates": (-_ROOM, _ROOM, len(OF_CANDIDATE) * feet * options),
            "mask": (0.0, 1.0, feet * options),
            "leap": (-_ROOM, _ROOM, len(OF_LEAP)),
            "last": (0.0, 1.0, feet * options),
            "residual": (0.0, _ROOM, 2 * like.numbers.intervals),
            "left": (0.0, 1.0, 2),
        }
    )
