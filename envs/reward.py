"""Reward of a step: a sum of terms by name, each with a weight.

A term of one's own is one function and one registration: a line in the table, an entry point of
``stancekit.reward_terms``, or ``weights={"mine.py:spread": 0.3}`` in any environment. The selection
environments hand it a ``Judged``, all others a ``Step``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

from stancekit.planners.answer.motion import Motion
from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import check_numbers, checked
from stancekit.planners.files.documents import typed
from stancekit.planners.plugins import Registry, foreign, takes
from stancekit.planners.problem import Problem
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.walk import Walk
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.relaxed import RelaxationAnswer
from stancekit.planners.verify.margins import stance_margins
from stancekit.planners.verify.stance_margin import compiled

from .scenes import LabelledScene


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weights of the reward of a step: reward = agreement · [P1 says what the expert says] +
    projection · [the chosen projection reaches a verified posture] + tightness · [1 − mean width of
    the box / width of the domain].
    """

    agreement: float = 1.0
    projection: float = 0.5
    tightness: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(self, finite=self.__dataclass_fields__)


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
    """Arguments of a term of one's own in the environments that do not select: a step, judged.

    Arguments:
        reward: of the environment's own terms.
        question: problem, course, leap or walk of the episode.
        answer: posture, plan of the window, leap or motion that the step ended with, as the
            verifier accepted it, or as the optimiser left it in WarpedGait; None where there is
            none, as at steps of a pool of walks.
        action: the action, as it came.
        info: ``info`` of the step, without what terms of one's own come to.
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
class SearchWeights:
    """Weights of the reward of a step of a search: success · [it has come to its end] − solves ·
    (share of the convex problems of an episode that it took).
    """

    success: float = 1.0
    solves: float = 1.0

    def __post_init__(self) -> None:
        check_numbers(self, finite=self.__dataclass_fields__)

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
    """The value of a term of one's own, which a message names where it is no finite number."""
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
