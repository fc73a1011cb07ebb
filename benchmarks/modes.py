"""Whether z switches where the terrain does: mode switching over perturbed ground-to-wall courses (paper E §IV-B.3).

    python benchmarks/modes.py [--courses 20] [--seed 2] [--samples 500] [--share 0] [--json]

The modes are learned from solved postures of ground-3 and wall-3 (seed 0), never from courses. A course counts as right
where the plan is accepted and z of every frame is the mode of the terrain under it (``Course.modes``).
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from stancekit.envs.distributions.courses import perturbed
from stancekit.learners.selectors.modes import learn_modes
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.search.methods import make_course_planner


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--courses", type=int, default=20)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--share", type=float, default=0.0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    modes = learn_modes(rng=np.random.default_rng(0), count=arguments.samples, share=arguments.share)
    record = measure(modes, arguments.courses, np.random.default_rng(arguments.seed))
    if arguments.json:
        print(json.dumps(record))
        return
    for name, value in record.items():
        print(f"{name:44} {value:.4g}")


def measure(modes: Modes, courses: int, rng: np.random.Generator) -> dict[str, float]:
    """Answers over perturbed courses, and how many stances had no other mode to choose."""
    planner = make_course_planner("two-stage", envelopes=modes)
    right = wrong = undecided = forced = stances = 0
    times = []
    for _ in range(courses):
        course = perturbed("ground-to-wall", rng)
        outcome = planner.solve(course)
        times.append(outcome.seconds)
        stances += len(course.stances)
        forced += len(course.stances) - int(outcome.details["open_stances"])
        if outcome.plan is None or outcome.plan.modes is None:
            undecided += 1
        elif tuple(outcome.plan.modes.tolist()) == course.modes:
            right += 1
        else:
            wrong += 1
    return {
        "courses": float(courses),
        "z switches where the terrain does": float(right),
        "z switches elsewhere": float(wrong),
        "no plan": float(undecided),
        "stances that could use one mode only, share": forced / max(stances, 1),
        "seconds a course, median": float(np.median(times)),
    }


if __name__ == "__main__":
    main()
