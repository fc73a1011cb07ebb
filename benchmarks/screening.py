"""Wrong and decided shares of a surrogate's answers on rows that nobody learned from.

    stancekit label wall-5 train --feasible 4000 --infeasible 4000
    stancekit label wall-5 test --feasible 1000 --infeasible 1000 --seed 101
    stancekit fit train --method surrogate --out s.safetensors
    python benchmarks/screening.py s.safetensors test

Per stated error and true class: rows, how many are called the other class, the upper end of the
95 % interval of that share, and the share that is decided; and the time per problem.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from scipy.stats import beta

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.surrogates.rows import LabelledBatch
from stancekit.learners.surrogates.surrogate import Surrogate

OTHER = {"feasible": "infeasible", "infeasible": "feasible", "trivial": "feasible"}


def upper_end(wrong: int, count: int) -> float:
    """Upper end of the 95 % interval of a share (Clopper and Pearson)."""
    return 1.0 if wrong == count else float(beta.ppf(0.975, wrong + 1, count - wrong))


def main() -> None:
    """Print a line of JSON per stated error and true class."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("surrogate", type=Path)
    parser.add_argument("test", type=Path, help="a folder of labels, of another seed")
    parser.add_argument("--errors", type=float, nargs="+", default=[0.005, 0.01, 0.02, 0.05])
    options = parser.parse_args()
    surrogate = Surrogate.read(options.surrogate)
    rows = LabelledBatch.of([Dataset.open(options.test)])
    for error in options.errors:
        begin = time.process_time()
        answers = surrogate.screen(rows.batch, error).answers
        each_us = 1e6 * (time.process_time() - begin) / len(rows)
        for kind, other in OTHER.items():
            of_kind = rows.kinds == kind
            if not of_kind.any():
                continue
            count, wrong = int(of_kind.sum()), int((answers[of_kind] == other).sum())
            line = {
                "class": surrogate.problem_class,
                "robot": surrogate.robot,
                "error": error,
                "truly": kind,
                "rows": count,
                "wrong": wrong,
                "at_most": round(upper_end(wrong, count), 5),
                "decided": round(float(np.mean(answers[of_kind] != "ask")), 3),
                "us": round(each_us, 1),
            }
            print(json.dumps(line))


if __name__ == "__main__":
    main()
