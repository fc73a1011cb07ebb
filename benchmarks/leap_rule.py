"""The constants of the leaps' hand rule, chosen on training scenes: first tries solved by each of
some settings.

    python benchmarks/leap_rule.py --scenes 150 --seed 41
    python benchmarks/leap_rule.py --distribution leap-hard --scenes 900 --seed 49 --best 4

Prints every setting with its share, the best last; ``planners/leap/scp.py`` has the numbers. With
``--best`` the finder then searches with that many of them, and with the rule as it is, on the first
``--searched`` scenes: leaps found within 12 convex problems and within 25. The scenes are those
that ``stancekit label`` draws with the same seed.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
from _bench import Options, launch, share

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, LeapSearch
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import Rule, attempt, plan_of
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

SETTINGS = [
    Rule(grip=3.0, grip_cap=grip_cap, room=room, room_cap=room_cap)
    for grip_cap, room, room_cap in itertools.product(
        (0.0, 0.05, 0.1, 0.3, 1.0), (4.0, 8.0, 14.0, 30.0), (-0.09, -0.06, -0.03, 0.0, 0.03)
    )
]
BUDGETS = (12, 25)
"""Convex problems of the search."""


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Training scenes, and what of them is searched."""

    distribution: str = "leap-hard"
    scenes: int = 150
    seed: int = 41
    best: int = 0
    searched: int = 300


def main(options: Asked) -> None:
    """Try every setting once on every scene."""
    programs, begin = Programs(), time.process_time()
    solved = np.zeros(len(SETTINGS), dtype=int)
    for index in range(options.scenes):
        numbers = LeapNumbers.of(_scene(options, index))
        known: dict[tuple[int, ...], bool] = {}
        for k, rule in enumerate(SETTINGS):
            choice = rule.scores(numbers).argmax(axis=1)
            key = tuple(choice.tolist())
            if key not in known:
                found = attempt(programs, numbers, choice)
                known[key] = found.solved and check_leap(plan_of(numbers, found, "rule")).accepted
            solved[k] += known[key]
    order = np.argsort(solved, kind="stable")
    for k in order:
        options.say(
            {"first tries": share(int(solved[k]), options.scenes), "rule": str(SETTINGS[k])}
        )
    options.say(
        {
            "settings": len(SETTINGS),
            "scenes": options.scenes,
            "cpu_s": round(time.process_time() - begin),
        }
    )
    if not options.best:
        return
    begin = time.process_time()
    for rule in (Rule(), *(SETTINGS[k] for k in order[::-1][: options.best])):
        counts = [
            _solves(_scene(options, index), rule, programs) for index in range(options.searched)
        ]
        within = [sum(count <= budget for count in counts) for budget in BUDGETS]
        shown = {
            f"within {budget}": share(count, len(counts))
            for budget, count in zip(BUDGETS, within, strict=True)
        }
        cpu_s = round(time.process_time() - begin)
        options.say({**shown, "finder with": str(rule), "cpu_s so far": cpu_s})


def _scene(options: Asked, index: int) -> Leap:
    return leap_class(options.distribution).draw(np.random.default_rng([options.seed, index]))


def _solves(leap: Leap, rule: Rule, programs: Programs) -> float:
    """Convex problems until the finder has a leap that the verifier accepts; inf beyond the largest
    budget.
    """
    search = LeapSearch(leap, LeapFinder(rule=rule, solves=max(BUDGETS)), programs)
    for found in search.attempts():
        if found.solved and check_leap(plan_of(search.last.numbers, found, "rule")).accepted:
            return search.solves
    return np.inf


if __name__ == "__main__":
    launch(main, Asked, __doc__)
