"""Selectors that ship with the package, by name: their files, and their cards, which say what they
are good for.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict

from stancekit.planners.files.codec import KEYS
from stancekit.planners.files.documents import read_json
from stancekit.planners.files.validation import validated

from ..data.quota import Quota


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


def shipped() -> dict[str, Path]:
    """The file of each selector that ships, by its name, METHOD-CLASS."""
    return {path.stem: path for path in sorted(_folder().glob("*.safetensors"))}


def card(name: str) -> Card:
    """The card of a selector that ships.

    Raises KeyError for another name.
    """
    path = shipped()[name].with_suffix(".json")
    record: Any = read_json(path)
    return validated(Card, record, str(path))


def _folder() -> Path:
    return Path(str(resources.files("stancekit.learners.zoo")))
