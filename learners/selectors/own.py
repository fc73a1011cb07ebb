"""Selectors from elsewhere: an entry point of another package, or a file."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.envs.memoryless import Observation
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown
from stancekit.planners.plugins import Registry, made_or_class

from .selector import Learned

ANY = "any"
"""Class of problems of a selector that does not say for which it was made."""
SELECTORS: Registry[Any] = Registry(
    "selector", "stancekit.selectors", {},
    expected="something with predict(observation), or a class of it that is made without arguments",
    accepts=lambda it: made_or_class(it, "predict"),
)  # fmt: skip
"""Selectors by name. A class is made without arguments."""


def is_own(name: str) -> bool:
    """Whether a text names a selector from elsewhere, and no file of weights or envelopes."""
    return ".py:" in name or name.endswith(".py") or (not Path(name).exists() and name in SELECTORS.names())


def own_selector(name: str) -> Learned:
    """A selector by its entry point's name, or "FILE.py:NAME". Raises InvalidInput."""
    return Learned.of(OwnSelector(name), name, ANY)


class OwnSelector:
    """A selector from elsewhere; to other processes it goes by its name.

    Its ``predict`` is given as much of stable-baselines3's arguments as it takes: the observation is enough.
    """

    def __init__(self, name: str) -> None:
        found = SELECTORS.get(name)
        self._found = found() if isinstance(found, type) else found
        path, colon, attribute = name.rpartition(":")
        self._name = f"{Path(path).resolve()}:{attribute}" if colon else name
        self.problem_class = str(getattr(self._found, "problem_class", ANY))
        parameters = inspect.signature(self._found.predict).parameters.values()
        everything = any(one.kind is one.VAR_KEYWORD for one in parameters)
        self._takes = None if everything else {one.name for one in parameters}
        self.boxes = int(getattr(self._found, "boxes", 1))
        self.relaxation = getattr(self._found, "relaxation", "p1")

    def predict(
        self, observation: Observation, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return (action, state), as every selector."""
        given = {"state": state, "episode_start": episode_start, "deterministic": deterministic}
        asked = given if self._takes is None else {name: given[name] for name in given if name in self._takes}
        found = self._found.predict(observation, **asked)
        if not isinstance(found, tuple) or len(found) != 2:
            raise InvalidInput(f"selector {self._name}: expected (action, state), got a {type(found).__name__}")
        self._check(observation, found[0])
        return found

    def _check(self, observation: Observation, action: Any) -> None:
        """Raise InvalidInput for what is no box. How much a library or a point adds, the environment knows."""
        bounds = np.asarray(action)
        if bounds.dtype.kind == "f" and not np.all(np.isfinite(bounds)):
            raise InvalidInput(f"selector {self._name}: action: expected finite numbers, got {shown(action)}")
        expected = 12 * np.shape(observation["friction"])[-1]
        if self.relaxation == "p1" and self.boxes == 1 and np.shape(action)[-1:] != (expected,):
            wanted = f"shape ({expected},), all lower bounds, then all upper"
            raise InvalidInput(f"selector {self._name}: action: expected {wanted}, got shape {np.shape(action)}")

    def __reduce__(self) -> tuple[Any, ...]:
        return OwnSelector, (self._name,)
