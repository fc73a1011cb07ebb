"""Interface of a selector: scene in, envelopes out, with the same ``predict`` as a
stable-baselines3 policy.
"""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import KEYS
from stancekit.planners.files.documents import (
    decoded,
    file_or_named,
    open_file,
    parse_json,
    shown,
    validated,
)
from stancekit.planners.formats.question_file import read_envelopes, write_boxes
from stancekit.planners.plugins import Registry, made_or_class, of_file, packed
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet, rule_of_thumb

from ..data.labelling import Quota
from ..leaps.kinds import Scores
from ..zoo import card_of, shipped

if TYPE_CHECKING:
    from stancekit.runner.control.envelope_choice import Predictor


class FixedSelector(MemorylessPolicy):
    """Answers every scene with the same envelopes: what the clustering and evolutionary methods of
    Lin et al. learn.
    """

    def __init__(self, name: str, envelopes: EnvelopeSet) -> None:
        self.name = name
        self.envelopes = envelopes
        self.provenance = envelopes.provenance
        self._action = np.concatenate(
            [envelope.to_vector() for envelope in envelopes.envelopes]
        ).astype(np.float32)

    def action(self, observation: Observation) -> NDArray[Any]:
        """The envelopes' bounds, tiled over a batch of observations."""
        batch = np.shape(observation["friction"])[:-1]
        return np.broadcast_to(self._action, (*batch, self._action.size)).copy()

    def save(self, path: str | Path) -> None:
        """Write the envelopes."""
        write_boxes(path, self.envelopes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Learned:
    """A selector and what it takes to roll it out and to keep it; it can be copied and pickled.

    Arguments:
        selector: chooses boxes for an observation.
        problem_class: what it was learned for.
        boxes: how many its action holds.
        relaxation: the P1 that they are for, a name of ``RELAXATIONS``.
        suffix: its file's usual one.
    Source:
        Lin et al. §III-B.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.fit(train, "quantile").problem_class
        'wall-3'
    """

    selector: Predictor
    problem_class: str
    boxes: int = 1
    relaxation: str = "p1"
    suffix: str = ".safetensors"

    @classmethod
    def fixed(cls, name: str, envelopes: EnvelopeSet) -> Learned:
        """The selector of a set of envelopes."""
        return cls(
            selector=FixedSelector(name, envelopes),
            problem_class=envelopes.problem_class,
            boxes=len(envelopes.envelopes),
            suffix=".json",
        )

    @classmethod
    def of(cls, found: Any, name: str, problem_class: str) -> Learned:
        """Predictor from the result of a fit or from a file: envelopes, or a selector with
        ``predict``.

        Its ``problem_class``, ``boxes`` (how many its action holds), ``relaxation`` and
        ``save(path)`` count where it has them.

        Arguments:
            name: what messages call it.

        Raises:
            InvalidInput: for anything else.
        """
        if isinstance(found, cls):
            return found
        if isinstance(found, EnvelopeSet):
            return cls.fixed(name, found)
        if not callable(getattr(found, "predict", None)):
            message = f"an EnvelopeSet or a selector with predict(observation), got a {type(found).__name__}"
            raise InvalidInput(f"{name}: expected {message}")

        of = getattr(found, "problem_class", problem_class)
        relaxation = str(getattr(found, "relaxation", "p1"))
        return cls(
            selector=found,
            problem_class=of,
            boxes=getattr(found, "boxes", 1),
            relaxation=relaxation,
        )

    def write(self, path: Path) -> None:
        """Write its file.

        Raises InvalidInput for a selector without ``save(path)``.
        """
        if not callable(getattr(self.selector, "save", None)):
            raise _unsaved(path, self.selector)
        self.selector.save(path)  # type: ignore[attr-defined]

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Provenance: the method, and the rows that it learned from (``Dataset.origin``); empty
        where the selector does not say.
        """
        return dict(getattr(self.selector, "provenance", {}))

    @property
    def envelopes(self) -> EnvelopeSet:
        """The envelopes that every scene gets.

        Raises InvalidInput where a network chooses them by the scene.
        """
        if not isinstance(self.selector, FixedSelector):
            kind = type(self.selector).__name__
            raise InvalidInput(
                f"envelopes: expected a selector with the same ones for every scene, got a {kind}"
            )
        return self.selector.envelopes


def _unsaved(path: str | Path, selector: Any) -> InvalidInput:
    """Refusal for a selector that has no file."""
    return InvalidInput(
        f"{path}: expected a selector with save(path), got a {type(selector).__name__}"
    )


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


def _own_selector(name: str) -> Learned:
    """A selector by its entry point's name, or "FILE.py:NAME".

    Raises InvalidInput.
    """
    selector = SELECTORS.get(name)
    return Learned.of(
        _OwnSelector(selector() if isinstance(selector, type) else selector, name), name, ANY
    )


def fitted(selector: Any, method: str, problem_class: str, origin: Mapping[str, Any]) -> Learned:
    """The selector that a fitting method returned.

    Arguments:
        origin: of the rows that one from elsewhere has learned from.

    Raises InvalidInput if the method returned neither envelopes nor a selector.
    """
    if of_file(selector) and callable(getattr(selector, "predict", None)):
        selector = _OwnSelector(selector, method, problem_class, origin)
    return Learned.of(selector, method, problem_class)


class _OwnSelector:
    """A selector from elsewhere.

    It can be copied and pickled, to processes that have not run its file, too.

    Its ``predict`` is given as much of stable-baselines3's arguments as it takes: the observation
    is enough.

    Arguments:
        name: what messages call it.
        problem_class: where it does not say its own.
        origin: what it was learned from, as far as it does not say so itself.
    """

    def __init__(
        self,
        found: Any,
        name: str,
        problem_class: str = ANY,
        origin: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self._found, self._name = found, name
        self.problem_class = str(getattr(found, "problem_class", problem_class))
        parameters = inspect.signature(found.predict).parameters.values()
        everything = any(one.kind is one.VAR_KEYWORD for one in parameters)
        self._takes = None if everything else {one.name for one in parameters}
        self.boxes = int(getattr(found, "boxes", 1))
        self.relaxation = getattr(found, "relaxation", "p1")
        self.provenance = {**origin, **getattr(found, "provenance", {})}

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
            raise _unsaved(path, self._found)
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
        known = self._name, self.problem_class, self.provenance
        if of_file(self._found):
            return _unpacked, (packed(self._found), *known)
        return _OwnSelector, (self._found, *known)


def _unpacked(found: bytes, *known: Any) -> _OwnSelector:
    return _OwnSelector(pickle.loads(found), *known)


def load_selector(path: str | Path) -> Learned:
    """Read any selector's file: an envelope file (JSON), or weights (safetensors).

    Nothing is unpickled.

    Or, of a selector that ships (``shipped``), or that another package registered under
    ``stancekit.selectors``, its name; or "FILE.py:NAME". Raises InvalidInput for what is missing,
    damaged or foreign.
    """
    name = str(path)
    is_own = not Path(name).exists() and name in SELECTORS.names()
    if ".py:" in name or name.endswith(".py") or is_own:
        return _own_selector(name)
    path = file_or_named(path, shipped("selectors"))
    if path.suffix != ".safetensors" and not (path.is_file() and safetensors_format(path)):
        return Learned.fixed(path.stem, read_envelopes(path))
    found = read_weights(path)
    if not isinstance(found, Learned):
        raise InvalidInput(f"{path}: expected a selector, got a {type(found).__name__}")
    return found


_WEIGHTS: Mapping[str, str] = MappingProxyType(
    {
        "stancekit/neural/1": "stancekit.learners.selectors.neural:NeuralSelector.load",
        "stancekit/leap-scorer/1": "stancekit.learners.leaps.policy:LeapScorer.read",
        "stancekit/surrogate/2": "stancekit.learners.surrogates.surrogate:Surrogate.read",
    }
)
"""Readers of files of weights, by the format that a file says it has; they need torch."""


def read_weights(path: Path) -> Any:
    """Read what a file of weights holds: a ``Learned``, the scores of leaps, or a surrogate.

    Raises InvalidInput for what is missing, damaged or foreign, and where torch is missing.
    """
    kind = safetensors_format(path)
    if kind is None:
        raise InvalidInput(f"{path}: expected a whole safetensors file, got something else")
    if kind not in _WEIGHTS:
        raise InvalidInput(f"{path}: expected format {', '.join(_WEIGHTS)}, got {kind:.60}")
    try:
        found = resolve_name(_WEIGHTS[kind])(path)
    except ImportError as error:
        raise not_installed(str(path), error.name, kind, "rl") from None
    return found if isinstance(found, Scores) else Learned.of(found, kind, ANY)


def safetensors_format(path: Path) -> str | None:
    """The format that a safetensors file says it has; None for a file of another kind."""
    with open_file(path) as file:
        size = int.from_bytes(file.read(8), "little")
        if not 2 <= size <= min(path.stat().st_size, 10_000_000) or file.read(1) != b"{":
            return None
        header = b"{" + file.read(size - 1)
    try:
        head = parse_json(decoded(header, "header"), "header")
        return str(parse_json(str(head["__metadata__"]["stancekit"]), "header")["format"])
    except (ValueError, TypeError, KeyError):
        return "a safetensors file of something else"


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


def heuristic_envelope(problem_class: str, problems: Sequence[Problem]) -> EnvelopeSet:
    """Bounds on p from the limbs' workspace, and on f as for climbing if the mean normals are
    level, else as for walking.
    """
    first = problems[0]
    shoulders = np.array([contact.shoulder_m for contact in first.contacts])
    reach = np.array([contact.reach_m for contact in first.contacts])
    normals = np.array(
        [[contact.patch.normal for contact in problem.contacts] for problem in problems]
    ).mean(axis=0)
    envelope = rule_of_thumb(shoulders, reach, np.abs(normals[:, 2]) < 0.5, first.length_scale_m)
    return EnvelopeSet.for_problems(
        problem_class, problems, [envelope], {"method": "heuristic", "source": "paper E §IV-A"}
    )


def quantile_box(points: Array, *, share: float = 0.05) -> Envelope:
    """Bounds that leave ``share`` of the solutions out on each side of each dimension.

    Arguments:
        points: shape (K, N, 6).
    """
    return Envelope(
        low=np.quantile(points, share, axis=0), high=np.quantile(points, 1.0 - share, axis=0)
    )
