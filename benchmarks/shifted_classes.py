"""What a surrogate says of problems that are not of its class: how often it notices, and how often
it is wrong where it does not.

    python benchmarks/shifted_classes.py surrogate-wall-3 --problems 1000

Per shift: the share of batches of 64, 200 and all problems that are asked as a whole; and of the
problems one by one, where nobody can tell: the share that lies beyond the calibration, and of the
truly feasible and infeasible ones, decided by the exact planner, how many are called the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, launch, upper_end

from stancekit.envs.distributions.postures import distribution
from stancekit.learners.surrogates.surrogate import surrogate_of
from stancekit.planners.answer.answer import Status
from stancekit.planners.problem import PostureBatch
from stancekit.planners.search.batch import decide_all
from stancekit.planners.search.exact import Exact

SIZES = (64, 200)
Shift = Callable[[PostureBatch], PostureBatch]


def moved(x: float, y: float, z: float) -> Shift:
    """All patches moved in the body's axes [m]."""
    return lambda batch: replace(
        batch, vertices_m=batch.vertices_m + np.array([x, y, z]), convex=True
    )


def sized(factor: float) -> Shift:
    """All patches larger or smaller about their middles."""

    def shift(batch: PostureBatch) -> PostureBatch:
        middle = batch.vertices_m.mean(axis=2, keepdims=True)
        vertices = middle + factor * (batch.vertices_m - middle)
        return replace(batch, vertices_m=vertices, convex=True)

    return shift


def gripped(change: Callable[[np.ndarray], np.ndarray]) -> Shift:
    """Another friction."""
    return lambda batch: replace(batch, friction=change(batch.friction), convex=True)


def turned(batch: PostureBatch) -> PostureBatch:
    """All patches turned about the vertical by 7.5°."""
    angle = math.radians(7.5)
    turn = np.array(
        [
            [math.cos(angle), -math.sin(angle), 0.0],
            [math.sin(angle), math.cos(angle), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    return replace(
        batch, vertices_m=batch.vertices_m @ turn.T, normals=batch.normals @ turn.T, convex=True
    )


def permuted(batch: PostureBatch) -> PostureBatch:
    """Each limb with the next limb's patch."""
    return replace(
        batch,
        vertices_m=np.roll(batch.vertices_m, 1, axis=1),
        normals=np.roll(batch.normals, 1, axis=1),
        friction=np.roll(batch.friction, 1, axis=1),
        convex=True,
    )


SHIFTS: dict[str, Shift] = {
    "none, another seed": lambda batch: batch,
    "friction × 0.9": gripped(lambda values: 0.9 * values),
    "friction at its least": gripped(lambda values: np.full_like(values, values.min())),
    "friction halfway to its mean": gripped(lambda values: 0.5 * (values + values.mean())),
    "patches 2 cm up": moved(0.0, 0.0, 0.02),
    "patches 5 cm up": moved(0.0, 0.0, 0.05),
    "patches half as large": sized(0.5),
    "turned by 7.5°": turned,
    "patches of other limbs": permuted,
}


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """A surrogate and problems.

    Arguments:
        surrogate: a file, or the name of one that ships.
        problems: how many a shift.
        error: the stated one.
    """

    surrogate: Annotated[str, tyro.conf.Positional]
    problems: int = 1000
    error: float = 0.005
    seed: int = 505


def main(options: Asked) -> None:
    """Print a row per shift."""
    surrogate = surrogate_of(options.surrogate)
    limits = surrogate.thresholds(options.error)
    source = distribution(surrogate.problem_class)
    batch = source.batch(np.random.default_rng(options.seed), options.problems)
    scores = surrogate.scores(batch)[0]
    near = np.argsort(np.abs(scores))[: options.problems // 4]
    shifted = {name: shift(batch) for name, shift in SHIFTS.items()}
    shifted["the quarter nearest to the border"] = batch.select(near)
    for name, problems in shifted.items():
        count = len(problems)
        noticed = {}
        for size in (*SIZES, count):
            parts = [np.arange(k, k + size) for k in range(0, count - size + 1, size)]
            asked = [
                bool(surrogate.screen(problems.select(p), options.error).shifted) for p in parts
            ]
            of_all = " all" if size == count else f" {size}"
            noticed[f"noticed of{of_all}"] = f"{sum(asked)} of {len(asked)}"
        answers = surrogate.answered(problems, limits, options.error).answers
        truth = decide_all(Exact(max_nodes=500, time_limit_s=math.inf), problems).outcomes
        line: dict[str, Any] = {
            "change": name,
            **noticed,
            "asked": f"{100 * (answers == 'ask').mean():.0f} %",
        }
        for status, other in ((Status.FEASIBLE, "infeasible"), (Status.INFEASIBLE, "feasible")):
            mine = np.array([each.status is status for each in truth])
            wrong, rows = int((answers[mine] == other).sum()), int(mine.sum())
            most = 100 * upper_end(wrong, rows)
            line[f"{status.value}, called {other}"] = (
                f"{wrong} of {rows}, up to {most:.2f} %" if rows else "none is"
            )
        options.say(line)


if __name__ == "__main__":
    launch(main, Asked, __doc__)
