"""The surrogate of a file or a name, and the one that ships for given problems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import file_or_named
from stancekit.planners.problem import Problem

from ..zoo import shipped
from .surrogate import Surrogate


def surrogate_of(given: Any) -> Surrogate:
    """A surrogate: itself, that of a file, or the shipped one of a name.

    Raises InvalidInput.
    """
    if isinstance(given, str | Path):
        return Surrogate.read(file_or_named(given, shipped("surrogates")))
    return Surrogate.of(given)


def surrogate_for(problem: Problem) -> Surrogate:
    """The surrogate that ships for problems like this one.

    Raises InvalidInput where none does.
    """
    files = shipped("surrogates")
    for path in files.values():
        surrogate = Surrogate.read(path)
        try:
            surrogate.check_fits(problem)
        except InvalidInput:
            continue
        return surrogate
    raise InvalidInput(
        f"surrogate: expected a surrogate or its file, since none of those that ship "
        f"({', '.join(files)}) is for problems like these, got none: "
        "stancekit.fit(rows, 'surrogate') learns one"
    )
