"""Wrong and decided shares of a surrogate's answers on rows that nobody learned from.

    stancekit label wall-5 train --feasible 4000 --infeasible 4000
    stancekit label wall-5 test --feasible 1000 --infeasible 1000 --seed 101
    stancekit fit train --method surrogate --out s.safetensors
    python benchmarks/screening.py s.safetensors test

Per stated error and true class: rows, how many are called the other class, the upper end of the
95 % interval of that share, and the share that is decided; and the time per problem. In place of a
file a surrogate that ships goes by its name, as surrogate-wall-3.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, launch, upper_end

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.surrogates.surrogate import LabelledBatch, Surrogate, surrogate_of

OTHER = {"feasible": "infeasible", "infeasible": "feasible", "trivial": "feasible"}
ERRORS = (0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """A surrogate and rows.

    Arguments:
        surrogate: a file, or the name of one that ships.
        test: folders of labels, of another seed.
        errors: stated errors.
    """

    surrogate: Annotated[str, tyro.conf.Positional]
    test: Annotated[tuple[Path, ...], tyro.conf.Positional]
    errors: tuple[float, ...] = ERRORS


def figures(
    surrogate: Surrogate, rows: LabelledBatch, errors: Sequence[float] = ERRORS
) -> Iterator[dict[str, Any]]:
    """A row per stated error and true class."""
    for error in errors:
        begin = time.process_time()
        screened = surrogate.screen(rows.batch, error)
        each_us = 1e6 * (time.process_time() - begin) / len(rows)
        if screened.shifted:
            raise SystemExit(screened.shifted)
        for kind, other in OTHER.items():
            of_kind = rows.kinds == kind
            if not of_kind.any():
                continue
            count, wrong = int(of_kind.sum()), int((screened.answers[of_kind] == other).sum())
            yield {
                "error": error,
                "truly": kind,
                "rows": count,
                "wrong": wrong,
                "at_most": round(upper_end(wrong, count), 5),
                "decided": round(float(np.mean(screened.answers[of_kind] != "ask")), 3),
                "us": round(each_us, 1),
            }


def main(asked: Asked) -> None:
    """Print a row per stated error and true class."""
    surrogate = surrogate_of(asked.surrogate)
    rows = LabelledBatch.of([Dataset.open(path) for path in asked.test])
    for row in figures(surrogate, rows, asked.errors):
        asked.say({"class": surrogate.problem_class, "robot": surrogate.robot} | row)


if __name__ == "__main__":
    launch(main, Asked, __doc__)
