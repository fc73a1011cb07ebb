"""How much the house adds to the solver: P1 through ``McCormick.solve`` against bare Clarabel on the same data.

    python benchmarks/p1_speed.py [--problem wall-3] [--count 400] [--seed 0] [--json]

Both are timed in turn, problem by problem, in one process on one thread. "bare" hands finished numbers to a solver of
the same settings: `update + solve` to one that was set up before, `set up + solve` what a program without data updates
pays. Our total is everything from the scaled problem to the margin, gap and point.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from stancekit.envs.terrains import DISTRIBUTIONS, distribution
from stancekit.planners.equilibrium.scaled import Scaled

ROUNDS = 3
"""Every problem is timed so often, and its fastest counts: other work on the machine comes in bursts."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problem", choices=list(DISTRIBUTIONS), default="wall-3")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    problems = [distribution(arguments.problem).sample(rng) for _ in range(arguments.count)]
    record = measure(lambda: [Scaled.of(problem) for problem in problems])
    if arguments.json:
        print(json.dumps({"problem": arguments.problem, **record}))
        return
    for name, value in record.items():
        print(f"{name:44} {value:.4g}")
