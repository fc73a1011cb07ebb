"""Cards of the selectors that ship with the package, which say what they are good for."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict

from stancekit.planners.files.codec import KEYS
from stancekit.planners.files.validation import validated

from ..data.labelling import Quota
from ..zoo import card_of, shipped


class Figure(BaseModel):
    """A share of test rows with its Wilson 95 % interval."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True)
    share: float
    low: float
    high: float


class Card(BaseModel):
    """Card of a selector that ships.

    Arguments:
        method: of ``stancekit fit``.
        problem_class, legs: what it is for.
        sha256: of its file.
        seed: of training.
        train, calibration, test: rows.
        figures: shares of the test rows: ``p1_feasible`` and ``p1_infeasible``, that P1 answers
            right, and ``project_fix_p``, of the feasible ones, from which fix-p reaches a verified
            posture.
        lift: the same of the lift, which learns nothing.
        limits: where it is of no use.
        software: versions that made it.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True)
    method: str
    problem_class: str
    legs: list[str]
    sha256: str
    seed: int
    train: Annotated[Quota, KEYS]
    calibration: Annotated[Quota, KEYS]
    test: Annotated[Quota, KEYS]
    figures: dict[str, Figure]
    lift: dict[str, Figure]
    limits: list[str]
    software: dict[str, str]


def card(name: str) -> Card:
    """The card of a selector that ships.

    Raises KeyError for another name.
    """
    file = shipped("selectors")[name]
    return validated(Card, card_of(file), str(file.with_suffix(".json")))
