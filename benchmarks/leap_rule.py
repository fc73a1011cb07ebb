"""The constants of the leaps' hand rule, chosen on training scenes: first tries solved by each of some settings.

    python benchmarks/leap_rule.py --scenes 150 --seed 41

Prints every setting with its share, the best last; ``planners/leap/rule.py`` has the numbers.
"""

from __future__ import annotations

import argparse
import itertools
import time

import numpy as np

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.rule import Rule
from stancekit.planners.leap.scp import attempt, plan_of
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

SETTINGS = [
    Rule(grip=3.0, grip_cap=grip_cap, room=room, room_cap=room_cap)
    for grip_cap, room, room_cap in itertools.product(
        (0.0, 0.05, 0.1, 0.3, 1.0), (8.0, 14.0, 30.0), (-0.06, -0.03, 0.0, 0.03)
    )
]


def main() -> None:
    """Try every setting once on every scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--distribution", default="leap")
    parser.add_argument("--scenes", type=int, default=150)
    parser.add_argument("--seed", type=int, default=41)
    options = parser.parse_args()
    programs, begin = Programs(), time.process_time()
    solved = np.zeros(len(SETTINGS), dtype=int)
    for index in range(options.scenes):
        rng = np.random.default_rng([options.seed, index])
        numbers = LeapNumbers.of(leap_class(options.distribution).draw(rng))
        known: dict[tuple[int, ...], bool] = {}
        for k, rule in enumerate(SETTINGS):
            choice = rule.scores(numbers).argmax(axis=1)
            key = tuple(choice.tolist())
            if key not in known:
                found = attempt(programs, numbers, choice)
                known[key] = found.solved and check_leap(plan_of(numbers, found, "rule")).accepted
            solved[k] += known[key]
    for k in np.argsort(solved, kind="stable"):
        print(f"{solved[k]:4} of {options.scenes}  {SETTINGS[k]}")
    print(f"{len(SETTINGS)} settings, {time.process_time() - begin:.0f} CPU-s")


if __name__ == "__main__":
    main()
