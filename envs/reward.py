"""Reward of a step of the selection environments: a sum of terms by name, each with a weight.

A term of one's own is one function of a ``Judged`` and one registration: a line in the table, an
entry point of ``stancekit.reward_terms``, or ``weights={"mine.py:spread": 0.3}``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import check_numbers, checked
from stancekit.planners.files.documents import typed
from stancekit.planners.plugins import Registry, takes
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.relaxed import RelaxationAnswer

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
    return 1.0 - float((judged.envelope.high - judged.envelope.low).mean()) / 2.0


Term = Callable[[Judged], float]
_TERMS: Registry[Term] = Registry(
    "reward term",
    "stancekit.reward_terms",
    {name: f"{__name__}:{name}" for name in ("agreement", "projection", "tightness")},
    expected="a function of a Judged",
    accepts=lambda it: takes(it, 1),
)
"""All terms of the reward of the selection environments."""


def weighted(weights: RewardWeights | Mapping[str, float]) -> dict[str, tuple[float, Term]]:
    """Weight and function of every term, by the key of ``info`` that has what it came to.

    Arguments:
        weights: a mapping has some keys of ``RewardWeights``, whose others keep their defaults, and
            names of further terms.

    Raises:
        InvalidInput: for a term that there is not, a weight that is no number, and two terms of one
            key.
    """
    values = asdict(weights) if isinstance(weights, RewardWeights) else dict(weights)
    usual = {
        name: value for name, value in values.items() if name in RewardWeights.__dataclass_fields__
    }
    every = asdict(typed(RewardWeights, usual, "weights")) | {
        name: checked(value, f"weights.{name}")
        for name, value in values.items()
        if name not in usual
    }
    terms: dict[str, tuple[float, Term]] = {}
    for name, weight in every.items():
        key = f"reward_{re.sub(r'[^0-9A-Za-z]+', '_', name.rpartition(':')[2])}"
        if key in terms:
            raise InvalidInput(f"weights: expected terms of different names, got {key} twice")
        try:
            terms[key] = weight, _TERMS.get(name)
        except InvalidInput as error:
            raise InvalidInput(
                f"weights.{name}: {str(error).removeprefix('reward term: ')}"
            ) from None
    return terms
