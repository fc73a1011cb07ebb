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

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.surrogates.rows import LabelledBatch
from stancekit.learners.surrogates.shipped import surrogate_of
from stancekit.learners.surrogates.surrogate import Surrogate

OTHER = {"feasible": "infeasible", "infeasible": "feasible", "trivial": "feasible"}
ERRORS = (0.005, 0.01, 0.02, 0.05)


def upper_end(wrong: int, count: int) -> float:
    """Upper end of the 95 % interval of a share (Clopper and Pearson)."""
    return 1.0 if wrong == count else float(beta.ppf(0.975, wrong + 1, count - wrong))


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


def main() -> None:
    """Print a line of JSON per stated error and true class."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("surrogate", help="a file, or the name of one that ships")
    parser.add_argument("test", type=Path, nargs="+", help="folders of labels, of another seed")
    parser.add_argument("--errors", type=float, nargs="+", default=ERRORS)
    options = parser.parse_args()
    surrogate = surrogate_of(options.surrogate)
    rows = LabelledBatch.of([Dataset.open(path) for path in options.test])
    for row in figures(surrogate, rows, options.errors):
        head = {"class": surrogate.problem_class, "robot": surrogate.robot}
        print(json.dumps(head | row))


if __name__ == "__main__":
    main()
