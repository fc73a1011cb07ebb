"""Surrogates that ship with the package: their files, by name, and the one for given problems."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import file_or_named, read_json
from stancekit.planners.problem import Problem

from .surrogate import Surrogate


def shipped_surrogates() -> dict[str, Path]:
    """The file of each surrogate that ships, by its name, METHOD-CLASS."""
    folder = Path(str(resources.files("stancekit.learners.surrogates")))
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def surrogate_card(name: str) -> dict[str, Any]:
    """The card of a surrogate that ships: data, seeds, figures, limits, versions.

    Raises KeyError for another name.
    """
    card: dict[str, Any] = read_json(shipped_surrogates()[name].with_suffix(".json"))
    return card


def surrogate_of(given: Any) -> Surrogate:
    """A surrogate: itself, that of a file, or the shipped one of a name.

    Raises InvalidInput.
    """
    if isinstance(given, str | Path):
        return Surrogate.read(file_or_named(given, shipped_surrogates()))
    return Surrogate.of(given)


def surrogate_for(problem: Problem) -> Surrogate:
    """The surrogate that ships for problems like this one.

    Raises InvalidInput where none does.
    """
    for path in shipped_surrogates().values():
        surrogate = Surrogate.read(path)
        try:
            surrogate.check_fits(problem)
        except InvalidInput:
            continue
        return surrogate
    raise InvalidInput(
        f"surrogate: expected a surrogate or its file, since none of those that ship "
        f"({', '.join(shipped_surrogates())}) is for problems like these, got none: "
        "stancekit.fit(rows, 'surrogate') learns one"
    )
