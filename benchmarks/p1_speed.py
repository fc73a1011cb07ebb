"""How much the house adds to the solver: P1 through ``McCormick.solve`` against bare Clarabel on
the same data.

    python benchmarks/p1_speed.py [--problem wall-3] [--count 400] [--seed 0] [--json]

Both are timed in turn, problem by problem, in one process on one thread. "bare" hands finished
numbers to a solver of the same settings: `update + solve` to one that was set up before, `set up +
solve` what a program without data updates pays. Our total is everything from the scaled problem to
the margin, gap and point.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import clarabel
import numpy as np
from _bench import Options, launch

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.equilibrium.clarabel_settings import solver_settings
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import Boxed, McCormick
from stancekit.planners.relaxation.relaxed import RelaxationAnswer

ROUNDS = 6
"""Every problem is timed so often, and its fastest counts: other work on the machine comes in
bursts."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which problems, and how many."""

    problem: str = "wall-3"
    count: int = 400


def main(arguments: Arguments) -> None:
    """Measure and print."""
    rng = np.random.default_rng(arguments.seed)
    problems = [distribution(arguments.problem).sample(rng) for _ in range(arguments.count)]
    arguments.list(
        measure(lambda: [Scaled.of(problem) for problem in problems]), problem=arguments.problem
    )


def measure(scenes: Callable[[], list[Scaled]]) -> dict[str, float]:
    """Times of every scene, three ways in turn; medians and ratios of sums. scenes: made anew,
    nothing kept.
    """
    problems = scenes()
    model, box = McCormick(problems[0].layout), middle_box(problems)
    for problem in problems[:20]:
        model.solve(problem, box)
    hessian, _, _, _ = first = model.rows.load(Boxed(problems[0], boxes=(box,)))
    settings = solver_settings(equilibrate=False)
    cones = model.rows.cone_list
    kept = clarabel.DefaultSolver(*first, cones, settings)
    times = np.full((3, ROUNDS, len(problems)), np.inf)
    for row in range(ROUNDS):
        for column, problem in enumerate(scenes()):
            _, q, matrix, b = model.rows.load(Boxed(replace(problem), boxes=(box,)))
            data = matrix.data.copy()
            ways = (
                lambda p=problem: read(model.solve(p, box)),
                lambda q=q, a=data, b=b: updated(kept, q, a, b),
                lambda q=q, a=matrix, b=b: (
                    clarabel.DefaultSolver(hessian, q, a, b, cones, settings).solve().obj_val
                ),
            )
            found = np.zeros(3)
            for way in np.roll(
                np.arange(3), row + column
            ):  # what runs first after other work is slower
                begin = time.perf_counter()
                found[way] = ways[way]()
                times[way, row, column] = time.perf_counter() - begin
            if np.isfinite(found[0]) and np.ptp(found) > 1e-6:
                raise SystemExit(f"bare and ours disagree: {found}")
    ours, again, whole = times.min(axis=1)
    return {
        "scenes": float(len(problems)),
        "ours: ms a solve, median": 1e3 * float(np.median(ours)),
        "ours: solves a second": len(ours) / float(ours.sum()),
        "bare update + solve: ms, median": 1e3 * float(np.median(again)),
        "bare set up + solve: ms, median": 1e3 * float(np.median(whole)),
        "ours / bare update + solve (sums)": float(ours.sum() / again.sum()),
        "ours / bare set up + solve (sums)": float(ours.sum() / whole.sum()),
    }


def read(answer: RelaxationAnswer) -> float:
    """Margin, gap and point."""
    _ = answer.gap, answer.point
    return answer.margin


def updated(solver: clarabel.DefaultSolver, q: Array, values: Array, b: Array) -> float:
    """Bare Clarabel on finished numbers; it reads lists faster than arrays."""
    solver.update(q=q.tolist(), A=values.tolist(), b=b.tolist())
    return float(solver.solve().obj_val)


def middle_box(scenes: list[Scaled]) -> Envelope:
    """A box of the width that learned envelopes have, about the patches."""
    position = np.stack([scene.patches.mean(axis=1) for scene in scenes])
    force = np.tile([0.5, 0.0, 0.2], (len(scenes), position.shape[1], 1))
    points: Array = np.concatenate([position, force], axis=2)
    return Envelope(low=points.mean(axis=0) - 0.25, high=points.mean(axis=0) + 0.25)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
