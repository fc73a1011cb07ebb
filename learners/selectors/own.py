"""Selectors from elsewhere: an entry point of another package, or a file."""

from __future__ import annotations

import inspect
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.envs.episodes import Observation
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown
from stancekit.planners.plugins import Registry, made_or_class, of_file, packed

from .selector import Learned, unsaved

ANY = "any"
"""Class of problems of a selector that does not say for which it was made."""
SELECTORS: Registry[Any] = Registry(
    "selector",
    "stancekit.selectors",
    {},
    expected="something with predict(observation), or a class of it that is made without arguments",
    accepts=lambda it: made_or_class(it, "predict"),
)
"""Selectors by name. A class is made without arguments."""


def is_own(name: str) -> bool:
    """Tell whether a text names a selector from elsewhere, and no file of weights or envelopes."""
    return (
        ".py:" in name
        or name.endswith(".py")
        or (not Path(name).exists() and name in SELECTORS.names())
    )


def own_selector(name: str) -> Learned:
    """A selector by its entry point's name, or "FILE.py:NAME".

    Raises InvalidInput.
    """
    selector = SELECTORS.get(name)
    return Learned.of(
        OwnSelector(selector() if isinstance(selector, type) else selector, name), name, ANY
    )


def fitted(selector: Any, method: str, problem_class: str) -> Learned:
    """The selector that a fitting method returned.

    Raises InvalidInput if the method returned neither envelopes nor a selector.
    """
    if of_file(selector) and callable(getattr(selector, "predict", None)):
        selector = OwnSelector(selector, method, problem_class)
    return Learned.of(selector, method, problem_class)


class OwnSelector:
    """A selector from elsewhere.

    It can be copied and pickled, to processes that have not run its file, too.

    Its ``predict`` is given as much of stable-baselines3's arguments as it takes: the observation
    is enough.

    Arguments:
        name: what messages call it.
        problem_class: where it does not say its own.
    """

    def __init__(self, found: Any, name: str, problem_class: str = ANY) -> None:
        self._found, self._name = found, name
        self.problem_class = str(getattr(found, "problem_class", problem_class))
        parameters = inspect.signature(found.predict).parameters.values()
        everything = any(one.kind is one.VAR_KEYWORD for one in parameters)
        self._takes = None if everything else {one.name for one in parameters}
        self.boxes = int(getattr(found, "boxes", 1))
        self.relaxation = getattr(found, "relaxation", "p1")
        self.provenance = dict(getattr(found, "provenance", {}))

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Return (action, state), as every selector."""
        options = {"state": state, "episode_start": episode_start, "deterministic": deterministic}
        arguments = (
            options
            if self._takes is None
            else {name: options[name] for name in options if name in self._takes}
        )
        action = self._found.predict(observation, **arguments)
        if not isinstance(action, tuple) or len(action) != 2:
            raise InvalidInput(
                f"selector {self._name}: expected (action, state), got a {type(action).__name__}"
            )
        self._check(observation, action[0])
        return action

    def save(self, path: str | Path) -> None:
        """Write its file.

        Raises InvalidInput where it has no ``save`` of its own.
        """
        if not callable(getattr(self._found, "save", None)):
            raise unsaved(path, self._found)
        self._found.save(path)

    def _check(self, observation: Observation, action: Any) -> None:
        """Raise InvalidInput for what is no box.

        How much a library or a point adds, the environment knows.
        """
        bounds = np.asarray(action)
        if bounds.dtype.kind == "f" and not np.all(np.isfinite(bounds)):
            raise InvalidInput(
                f"selector {self._name}: action: expected finite numbers, got {shown(action)}"
            )
        expected = 12 * np.shape(observation["friction"])[-1]
        if self.relaxation == "p1" and self.boxes == 1 and np.shape(action)[-1:] != (expected,):
            wanted = f"shape ({expected},), all lower bounds, then all upper"
            raise InvalidInput(
                f"selector {self._name}: action: expected {wanted}, got shape {np.shape(action)}"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        if of_file(self._found):
            return _unpacked, (packed(self._found), self._name, self.problem_class)
        return OwnSelector, (self._found, self._name, self.problem_class)


def _unpacked(found: bytes, name: str, problem_class: str) -> OwnSelector:
    return OwnSelector(pickle.loads(found), name, problem_class)
