"""Interface of environments and policies to a learned selector: whom to ask, and for which
problems.
"""

from __future__ import annotations

from typing import Protocol

from stancekit.planners.errors import InvalidInput
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.expert import expert_envelopes
from stancekit.runner.control.envelope_choice import Predictor

from .distributions.postures import PostureDistribution, distribution


class LearnedSelector(Protocol):
    """A selector with its class of problems: what ``fit`` returns, and ``load`` reads."""

    @property
    def selector(self) -> Predictor:
        """Chooses boxes for an observation."""

    @property
    def problem_class(self) -> str:
        """Name of the distribution that it was learned for."""

    @property
    def relaxation(self) -> str:
        """The P1 that its boxes are for."""


def class_envelopes(learned: LearnedSelector) -> EnvelopeSet:
    """Envelopes of a selector's class of problems: its own, where it has some; else the expert's.

    Raises InvalidInput for a selector for another P1, and for a class that is neither of the ground
    nor of walls.
    """
    if learned.relaxation != "p1":
        raise InvalidInput(
            f"selector: expected one of boxes for P1 alone, got one for P1 {learned.relaxation}"
        )
    envelopes = getattr(learned.selector, "envelopes", None)
    if isinstance(envelopes, EnvelopeSet):
        return envelopes
    kind = distribution(learned.problem_class)
    if not isinstance(kind, PostureDistribution):
        got = learned.problem_class
        raise InvalidInput(f"problem class: expected one of the ground or of walls, got {got}")
    return expert_envelopes(kind.terrain, legs=kind.legs)
