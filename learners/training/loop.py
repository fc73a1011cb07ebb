"""The loop of every fit: one step after the other, each with its record, kept in a checkpoint from
which a run that was stopped, however hard, goes on and ends as one that was not.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, located
from stancekit.planners.files.arrays import archive_of, read_archive
from stancekit.planners.files.documents import parse_json
from stancekit.planners.files.writing import first_difference, write_bytes

FORMAT = "stancekit/fit/1"
_MOST_BYTES = 2_000_000_000
"""Largest checkpoint that is read: weights, and twice as much that the optimiser has seen."""
Record = dict[str, Any]
"""Figures of a step, JSON-ready."""
State = Mapping[str, NDArray[Any]]
"""Arrays by name."""
StepsDone = Callable[[int, int], None]


class Fit(ABC):
    """Base of fits, which go step by step: a step is an epoch or a generation."""

    total: int

    @abstractmethod
    def step(self, number: int) -> Record:
        """Do the step of this number, from 0."""

    @abstractmethod
    def state(self) -> State:
        """Everything but the records that later steps depend on."""

    @abstractmethod
    def restore(self, state: State, history: list[Record]) -> None:
        """Take a state up again, that after the steps of these records."""


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """Checkpoint file of a run, written whole or not at all.

    Arguments:
        about: settings and data of the run, JSON-ready.
    """

    path: Path
    about: Mapping[str, Any]

    @classmethod
    def of(cls, path: Path | None, about: Mapping[str, Any]) -> Checkpoint | None:
        """The checkpoint of a run in this file; None without a file."""
        return None if path is None else cls(path=path, about=about)

    def write(self, fit: Fit, history: list[Record]) -> None:
        """Write the state of a run, as it is: weights hardly become smaller, and to press them takes
        as long as tens of batches.
        """
        header = {"format": FORMAT, "about": self.about, "history": history}
        arrays = {"header": json.dumps(header), **fit.state()}
        write_bytes(self.path, archive_of(arrays, compressed=False))

    def read(self, fit: Fit) -> list[Record]:
        """Restore the state of a fit, and return its records; no records if the file does not exist.

        Raises InvalidInput for a damaged or foreign file, and for the file of another run.
        """
        if not self.path.exists():
            return []
        state = read_archive(self.path, _MOST_BYTES)
        with located(str(self.path)):
            try:
                header = parse_json(str(state.pop("header", '{"format": null}')), "header")
                history: list[Record] = header.pop("history", [])
                mine = json.loads(json.dumps({"format": FORMAT, "about": self.about}))
                if other := first_difference(header, mine):
                    raise InvalidInput(f"expected a checkpoint of these settings and data: {other}")
                fit.restore(state, history)
            except (LookupError, TypeError, ValueError, ArithmeticError, RuntimeError) as error:
                if isinstance(error, InvalidInput):
                    raise
                raise InvalidInput(f"expected a whole checkpoint: {error}") from None
        return history


def run(
    fit: Fit, progress: StepsDone | None = None, checkpoint: Checkpoint | None = None
) -> list[Record]:
    """Do the remaining steps of a fit, and return the records of all of them.

    Arguments:
        progress: called after each step with the steps done and the total.
        checkpoint: written after every step; the fit continues from it if its file exists.
    """
    history = [] if checkpoint is None else checkpoint.read(fit)
    while len(history) < fit.total:
        history.append(fit.step(len(history)))
        if checkpoint is not None:
            checkpoint.write(fit, history)
        if progress is not None:
            progress(len(history), fit.total)
    return history


def drawn_from(rng: np.random.Generator) -> NDArray[Any]:
    """State of a random generator, as an array."""
    return np.array(json.dumps(rng.bit_generator.state))


def draw_on(rng: np.random.Generator, state: NDArray[Any]) -> None:
    """Restore the state of a random generator."""
    rng.bit_generator.state = parse_json(str(state), "state of chance")
