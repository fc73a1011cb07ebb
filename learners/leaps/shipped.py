"""Scores of leaps' candidates that ship with the package, by name: their files, and their cards."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from stancekit.planners.files.documents import read_json


def shipped_scorers() -> dict[str, Path]:
    """The file of each scorer that ships, by its name, METHOD-CLASS."""
    folder = Path(str(resources.files("stancekit.learners.leaps")))
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def scorer_card(name: str) -> dict[str, Any]:
    """The card of a scorer that ships: data, seeds, figures, limits, versions.

    Raises KeyError for another name.
    """
    card: dict[str, Any] = read_json(shipped_scorers()[name].with_suffix(".json"))
    return card
