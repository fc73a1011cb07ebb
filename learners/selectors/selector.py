"""What a selector is: scene in, envelopes out, with the same ``predict`` as a stable-baselines3 policy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.answer_file import read_envelopes, write_boxes
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import decoded, parse_json
from stancekit.planners.relaxation.envelope import EnvelopeSet

Observation = Mapping[str, NDArray[Any]]


class Selector(Protocol):
    """Chooses the envelope(s) that P1 may use for an observed scene."""

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return (action, state): one action of ``EnvelopeSelection-v0``, or a row an observation of a batch."""
        ...


class FixedSelector:
    """Answers every scene with the same envelopes: what the clustering and evolutionary methods of paper E learn."""

    def __init__(self, name: str, envelopes: EnvelopeSet) -> None:
        self.name = name
        self.envelopes = envelopes
        self._action = np.concatenate([envelope.to_vector() for envelope in envelopes.envelopes]).astype(np.float32)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return the envelopes' bounds, tiled over a batch of observations."""
        batch = np.shape(observation["friction"])[:-1]
        return np.broadcast_to(self._action, (*batch, self._action.size)).copy(), state


@dataclass(frozen=True, kw_only=True, eq=False)
class Learned:
    """A selector and what it takes to roll it out and to keep it.

    problem_class: what it was learned for; boxes: how many its action holds; write: writes its file; suffix: the
    file's usual one.
    """

    selector: Selector
    problem_class: str
    write: Callable[[Path], None]
    boxes: int = 1
    suffix: str = ".safetensors"

    @classmethod
    def fixed(cls, name: str, envelopes: EnvelopeSet) -> Learned:
        """The selector of a set of envelopes."""
        return cls(
            selector=FixedSelector(name, envelopes), problem_class=envelopes.problem_class,
            write=lambda path: write_boxes(path, envelopes), boxes=len(envelopes.envelopes), suffix=".json",
        )  # fmt: skip

    @property
    def envelopes(self) -> EnvelopeSet:
        """The envelopes that every scene gets. Raises InvalidInput where a network chooses them by the scene."""
        if not isinstance(self.selector, FixedSelector):
            kind = type(self.selector).__name__
            raise InvalidInput(f"envelopes: expected a selector with the same ones for every scene, got a {kind}")
        return self.selector.envelopes


def load_selector(path: str | Path) -> Learned:
    """Read any selector's file: an envelope file (JSON), or weights (safetensors). Nothing is unpickled.

    Raises InvalidInput for what is missing, damaged or foreign.
    """
    path = Path(path)
    kind = _safetensors_format(path) if path.is_file() else None
    if kind is None and path.suffix == ".safetensors" and path.is_file():
        raise InvalidInput(f"{path}: expected a whole safetensors file, got something else")
    if kind is None:
        return Learned.fixed(path.stem, read_envelopes(path))
    try:
        return _network(kind, path)
    except ImportError as error:
        raise InvalidInput(f"{path}: {kind} needs {error.name}, got none: pip install 'stancekit[rl]'") from None


def _network(kind: str, path: Path) -> Learned:
    """A selector that needs torch."""
    if kind == "stancekit/neural/1":
        from .neural import NeuralSelector

        neural = NeuralSelector.load(path)
        return Learned(selector=neural, problem_class=neural.problem_class, write=neural.save)
    if kind == "stancekit/chooser/1":
        from .chooser import Chooser

        chooser = Chooser.load(path)
        return Learned(selector=chooser, problem_class=chooser.envelopes.problem_class, write=chooser.save)
    if kind == "stancekit/policy/1":
        from .policy import TrainedPolicy

        policy = TrainedPolicy.load(path)
        if not policy.shape.selects:
            got = policy.shape.environment
            raise InvalidInput(f"{path}: expected a policy that chooses envelopes, got one for {got}")
        return Learned(selector=policy, problem_class=policy.shape.problem, write=policy.save)
    known = "stancekit/envelope/1, stancekit/neural/1, stancekit/chooser/1 or stancekit/policy/1"
    raise InvalidInput(f"{path}: expected format {known}, got {kind:.60}")


def _safetensors_format(path: Path) -> str | None:
    """The format that a safetensors file says it has; None for a file of another kind."""
    with open(path, "rb") as file:
        size = int.from_bytes(file.read(8), "little")
        if not 2 <= size <= min(path.stat().st_size, 10_000_000) or file.read(1) != b"{":
            return None
        header = b"{" + file.read(size - 1)
    try:
        head = parse_json(decoded(header, "header"), "header")
        return str(parse_json(str(head["__metadata__"]["stancekit"]), "header")["format"])
    except (ValueError, TypeError, KeyError):
        return "a safetensors file of something else"
