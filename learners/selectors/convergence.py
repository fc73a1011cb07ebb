"""Record of an evolutionary run: its history and its checkpoint."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.archive import read_archive
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import parse_json
from stancekit.planners.files.validation import shown
from stancekit.planners.files.writing import write_bytes

from .feasibility import VerdictCounts

FORMAT = "stancekit/evolution/1"


@dataclass(frozen=True, kw_only=True)
class Generation:
    """One tested generation.

    Arguments:
        mean, variance, best: of the fitness, to be maximised.
        a, b: of the best individual, over the problems drawn.
        mutation_rate: with which the next one is bred.
        evaluations: verdicts of P1 asked for.
        cached: of them, without a solve.
        counts: how.
    """

    number: int
    mean: float
    variance: float
    best: float
    a: float
    b: float
    mutation_rate: float
    evaluations: int
    cached: int
    counts: VerdictCounts


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneticRun:
    """State of a run.

    Arguments:
        population: to be tested next, or the last one in order of rank, shape (P, 2, N, 6).
    """

    population: Array
    history: Sequence[Generation]


def write_checkpoint(
    path: Path, about: Mapping[str, Any], rng: np.random.Generator, run: GeneticRun
) -> None:
    """Write population, history and the state of the generator, whole or not at all.

    Arguments:
        about: what the run is of.
    """
    content = io.BytesIO()
    numbers = [
        [value for value in asdict(done).values() if not isinstance(value, dict)]
        for done in run.history
    ]
    np.savez(
        content,
        format=np.array(FORMAT),
        digest=np.array(_digest(about)),
        state=np.array(json.dumps(rng.bit_generator.state)),
        population=run.population,
        history=np.array(numbers, dtype=np.float64),
        counts=np.array([astuple(done.counts) for done in run.history], dtype=np.int64),
    )
    write_bytes(path, content.getvalue())


def read_checkpoint(path: Path, about: Mapping[str, Any], rng: np.random.Generator) -> GeneticRun:
    """Read what ``write_checkpoint`` wrote and set the generator to where it was.

    Raises InvalidInput for what is damaged, foreign, or of a run with other settings or data.
    """
    arrays = read_archive(path)
    if set(arrays) != {"format", "digest", "state", "population", "history", "counts"}:
        raise InvalidInput(
            f"{path}: expected a checkpoint ({FORMAT}), got the arrays {shown(sorted(arrays))}"
        )
    if str(arrays["format"]) != FORMAT:
        raise InvalidInput(
            f"{path}: format: expected {FORMAT!r}, got {shown(str(arrays['format']))}"
        )
    if str(arrays["digest"]) != _digest(about):
        raise InvalidInput(
            f"{path}: expected the checkpoint of a run with these settings and data, got another's"
        )
    try:
        rng.bit_generator.state = parse_json(str(arrays["state"]), "state")
        history = [
            Generation(
                number=int(row[0]),
                **dict(zip(_REALS, map(float, row[1:7]), strict=True)),
                evaluations=int(row[7]),
                cached=int(row[8]),
                counts=VerdictCounts(**dict(zip(_KINDS, map(int, counts), strict=True))),
            )
            for row, counts in zip(arrays["history"], arrays["counts"], strict=True)
        ]
    except (ValueError, TypeError, IndexError, KeyError, OverflowError) as error:
        raise InvalidInput(
            f"{path}: expected a checkpoint ({FORMAT}), got a damaged one: {error}"
        ) from None
    return GeneticRun(population=arrays["population"], history=history)


def _digest(about: Mapping[str, Any]) -> str:
    """SHA-256 of settings and data."""
    plain = {name: value for name, value in about.items() if not isinstance(value, np.ndarray)}
    whole = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
    for name in sorted(set(about) - set(plain)):
        whole.update(np.ascontiguousarray(about[name], dtype=np.float64).tobytes())
    return whole.hexdigest()


_REALS = ("mean", "variance", "best", "a", "b", "mutation_rate")
_KINDS = tuple(f.name for f in fields(VerdictCounts))
