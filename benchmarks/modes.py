"""Whether z switches where the terrain does: mode switching over perturbed ground-to-wall courses
(Lin et al. §IV-B.3).

    python benchmarks/modes.py [--courses 20] [--seed 2] [--samples 500] [--share 0] [--json]

The modes are learned from labelled postures of ground-3 and wall-3 (seed 0), never from courses. A
course counts as right where the plan is accepted and z of every frame is the mode of the terrain
under it (``Problem.modes``).
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import Options, launch

import stancekit
from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.search.methods import make_planner


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, and what modes are learned from."""

    courses: int = 20
    seed: int = 2
    samples: int = 500
    share: float = 0.0


def main(arguments: Arguments) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            stancekit.label(name, Path(folder) / name, rows=(arguments.samples, 0))
            for name in ("ground-3", "wall-3")
        ]
        modes = stancekit.fit(rows, "modes", share=arguments.share)
    arguments.list(measure(modes, arguments.courses, np.random.default_rng(arguments.seed)))


def measure(modes: Modes, courses: int, rng: np.random.Generator) -> dict[str, float]:
    """Answers over perturbed courses, and how many stances had no other mode to choose."""
    planner = make_planner("two-stage", envelopes=modes, of="courses")
    right = wrong = undecided = forced = stances = 0
    times = []
    for _ in range(courses):
        course = perturbed("ground-to-wall", rng)
        outcome = planner.solve(course)
        times.append(outcome.effort.seconds)
        stances += len(course.stances)
        forced += len(course.stances) - int(outcome.details["open_stances"])
        if outcome.solution is None or outcome.solution.modes is None:
            undecided += 1
        elif tuple(outcome.solution.modes.tolist()) == course.modes:
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
    launch(main, Arguments, __doc__)
