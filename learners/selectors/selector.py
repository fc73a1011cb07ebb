"""Interface of a selector: scene in, envelopes out, with the same ``predict`` as a
stable-baselines3 policy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.answer_file import write_boxes
from stancekit.planners.relaxation.envelope import EnvelopeSet

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
            raise unsaved(path, self.selector)
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


def unsaved(path: str | Path, selector: Any) -> InvalidInput:
    """Refusal for a selector that has no file."""
    return InvalidInput(
        f"{path}: expected a selector with save(path), got a {type(selector).__name__}"
    )
