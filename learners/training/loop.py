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
Record = dict[str, Any]
"""What is told of a step, JSON-ready."""
State = Mapping[str, NDArray[Any]]
"""Arrays by name."""
StepsDone = Callable[[int, int], None]


class Fit(ABC):
    """What is fitted, step by step: an epoch, a generation, a segment each."""

    total: int

    @abstractmethod
    def step(self, number: int) -> Record:
        """Do the step of this number, from 0."""

    @abstractmethod
    def state(self) -> State:
        """Everything beside the records that later steps follow from."""

    @abstractmethod
    def restore(self, state: State, history: list[Record]) -> None:
        """Be as after these records."""


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """File of a run, written whole or not at all.

    Arguments:
        about: what the run is of, JSON-ready: settings and data.
    """

    path: Path
    about: Mapping[str, Any]

    @classmethod
    def of(cls, path: Path | None, about: Mapping[str, Any]) -> Checkpoint | None:
        """That of a run in this file; None without one."""
        return None if path is None else cls(path=path, about=about)

    def write(self, fit: Fit, history: list[Record]) -> None:
        """Keep where a run is."""
        header = {"format": FORMAT, "about": self.about, "history": history}
        write_bytes(self.path, archive_of({"header": json.dumps(header), **fit.state()}))

    def read(self, fit: Fit) -> list[Record]:
        """Put a fit to where it was, and return its records; none where there is no file.

        Raises InvalidInput for a file that is damaged or foreign, and for that of another run.
        """
        if not self.path.exists():
            return []
        state = read_archive(self.path)
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
    """Do what is left of a fit; the records of all its steps.

    Arguments:
        progress: gets steps done and in all after each.
        checkpoint: is written after every step, and gone on from where it is there.
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
    """Where a generator is, as a part of a state."""
    return np.array(json.dumps(rng.bit_generator.state))


def draw_on(rng: np.random.Generator, state: NDArray[Any]) -> None:
    """Put a generator to where it was."""
    rng.bit_generator.state = parse_json(str(state), "state of chance")
