"""Trained weights that ship, by name, each with its card: selectors, one per class of problems, lie
here, scorers of leaps and surrogates beside their code.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from stancekit.planners.files.documents import read_json

FOLDERS = MappingProxyType(
    {
        "selectors": "stancekit.learners.zoo",
        "scorers": "stancekit.learners.leaps",
        "surrogates": "stancekit.learners.surrogates",
    }
)


def shipped(kind: Literal["selectors", "scorers", "surrogates"]) -> dict[str, Path]:
    """The file of each of a kind that ships, by its name, METHOD-CLASS."""
    folder = Path(str(resources.files(FOLDERS[kind])))
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def card_of(file: Path) -> dict[str, Any]:
    """The card of a file that ships: data, seeds, figures, limits, versions."""
    card: dict[str, Any] = read_json(file.with_suffix(".json"))
    return card
