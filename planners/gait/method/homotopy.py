"""Homotopy in the terrain: solve on a gentler terrain first, and let it steepen from one solution
to the next.

A terrain is made gentler by scaling its heights, or by a Gaussian: a wall that is widened keeps its
height, so that what has to be climbed is there from the first stage on, and the walk hardly changes
while the wall gets steep.

Charts that know the terrain by its heights have a factor on them as a parameter of their program. A
terrain under a Gaussian has a program of its own, and so have the stages of warped charts, whose
map belongs to its terrain; a stage's solution is the next one's guess in the chart's own
coordinates, in which the ground stays flat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...errors import InvalidInput
from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ..charts import CHARTS
from ..gait_program import GaitProgram, GaitSolution
from .attempt import Attempt, Homotopy, Workbench
from .smoothing import Solver

GENTLE = 1.0
"""Gradient that needs no homotopy: 45°."""
GROWTH = 1.7
"""By how much the steepest gradient grows from one stage to the next; 3 → 6 → 10 → 14 → 20 on the
pit of 87°."""
WIDEST_M = 1.6
"""No Gaussian is wider [m]."""
LEAST = 0.04
"""Steps in the factor below this are not tried: what separates the stages is then no longer the
terrain."""


def heights_for(
    terrain: HeightField, gentle: float = GENTLE, growth: float = GROWTH
) -> tuple[float, ...]:
    """Factors on the gradients, the last 1: the first makes the terrain gentle, each next one
    steeper by ``growth``.
    """
    slope = terrain.steepest
    if slope <= gentle:
        return (1.0,)
    stages = int(np.ceil(np.log(slope / gentle) / np.log(growth)))
    return tuple(
        float(factor) for factor in (gentle / slope) ** (1.0 - np.arange(stages + 1) / stages)
    )


def softened(terrain: HeightField, factor: float) -> HeightField:
    """The terrain under the Gaussian that leaves this share, within (0, 1], of its steepest
    gradient.

    Raises InvalidInput for an uneven grid.
    """
    goal = factor * terrain.steepest
    if factor == 1.0 or goal == 0.0:
        return terrain

    from scipy.optimize import brentq  # slow to import

    def above(sigma_m: float) -> float:
        return terrain.smoothed(sigma_m).steepest - goal

    widest_m = 0.05
    while above(widest_m) > 0.0 and widest_m < WIDEST_M:
        widest_m *= 2.0
    if above(widest_m) > 0.0:  # a plane, or nearly: no Gaussian makes it gentler
        return terrain.smoothed(widest_m)
    return terrain.smoothed(float(brentq(above, 0.0, widest_m, xtol=1e-3)))


@dataclass(frozen=True, kw_only=True, eq=False)
class HomotopyPath:
    """Result of a homotopy.

    Arguments:
        solutions: of all stages in their order, also of those that failed.
        factors: theirs on the terrain's gradients.
    """

    solutions: tuple[GaitSolution, ...]
    factors: tuple[float, ...]

    @property
    def reached(self) -> float:
        """The largest factor that was solved, 0 for none."""
        solved = [
            factor for factor, one in zip(self.factors, self.solutions, strict=True) if one.success
        ]
        return max(solved, default=0.0)


def follow_homotopy(
    bench: Workbench,
    attempt: Attempt,
    guess: Array | None = None,
    *,
    stage: int = 0,
    solve: Solver = GaitProgram.solve,
    max_iterations: int | None = None,
    most_stages: int = 12,
    stop: Callable[[], bool] = lambda: False,
) -> HomotopyPath:
    """Solve at one of an attempt's heights after another, each from the last solution; half-way
    where one fails.

    A gentler terrain on which the task is none is left out.

    Ends at the last factor, after most_stages, or where a step is too small to halve.

    Arguments:
        guess: of the first stage in its program, shape (size,), the attempt's own if missing.
        stage: the index of the height to begin with, where a run goes on.
        solve: in place of the programs' own.
        max_iterations: of one stage.
        stop: asked before every stage but the first.
    """
    ahead, solutions, factors = list(attempt.heights[stage:]), list[GaitSolution](), list[float]()
    begun = attempt.heights[stage - 1] if stage else 0.0
    alone, x, reached = len(ahead) == 1 and not stage, guess, begun
    while ahead and len(solutions) < most_stages and not (solutions and stop()):
        factor = ahead[0]
        try:
            program, by_stage = stage_program(bench, attempt.chart, factor, attempt.by)
        except InvalidInput:
            if len(ahead) == 1:
                raise
            ahead.pop(0)
            continue
        begin = attempt.guess(program) if x is None else x
        solution = solve(program, begin, height_factor=by_stage, max_iterations=max_iterations)
        solutions, factors = [*solutions, solution], [*factors, factor]
        if solution.success:
            x, reached = solution.x, ahead.pop(0)
        elif alone or factor - reached < LEAST:
            break
        else:
            ahead.insert(0, 0.5 * (reached + factor))
    return HomotopyPath(solutions=tuple(solutions), factors=tuple(factors))


def stage_program(
    bench: Workbench, chart: str, factor: float, by: Homotopy = "height"
) -> tuple[GaitProgram, float]:
    """The program of a stage and the factor to solve it at: 1 where the stage has a terrain and a
    map of its own.
    """
    if factor == 1.0 or (CHARTS.get(chart).scales and by == "height"):
        return bench.program(chart), factor
    terrain = bench.task.terrain
    lower = replace(
        bench.task, terrain=terrain.scaled(factor) if by == "height" else softened(terrain, factor)
    )
    return Workbench(lower, bench.settings).program(chart), 1.0
