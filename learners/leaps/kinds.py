"""Kinds of learned scores of leaps' candidates, by name, and what they have without torch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.leap.numbers import LeapNumbers

Kind = Literal["additive", "set"]
KINDS: tuple[Kind, ...] = ("additive", "set")
FORMAT = "stancekit/leap-scorer/1"


@runtime_checkable
class Scores(Protocol):
    """Learned scores that have a file, as ``LeapScorer`` is."""

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, shape (P, options)."""

    def write(self, path: str | Path) -> None:
        """Write the file."""


SCORER = ".safetensors"
"""Ending of the file of learned scores."""
