"""Homotopy in the terrain: solve on a lower terrain first, and let it grow from one solution to the next.

Charts that know the terrain by its heights have a factor on them as a parameter of their program. A map belongs to its
terrain, so the warped charts get a map and a program for each stage; a stage's solution is the next one's guess in the
chart's own coordinates, in which the ground stays flat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..scene.heightfield import HeightField
from .attempt import SCALED, Workbench
from .formulation import GaitProgram
from .smooth import Solve
from .solution import GaitSolution
from .task import ChartName

GENTLE = 1.0
"""Gradient that needs no homotopy: 45°."""
GROWTH = 1.7
"""By how much the steepest gradient grows from one stage to the next; 3 → 6 → 10 → 14 → 20 on the pit of 87°."""
LEAST = 0.04
"""Steps in the factor below this are not tried: what separates the stages is then no longer the terrain."""


def steepest(terrain: HeightField, spacing_m: float = 0.05) -> float:
    """The largest gradient over a grid on the terrain's domain, non-dimensional."""
    axes = [np.arange(low, high + 0.5 * spacing_m, spacing_m) for low, high in terrain.domain_m]
    slopes = terrain.gradient(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    return float(np.linalg.norm(slopes, axis=-1).max())


def heights_for(terrain: HeightField, gentle: float = GENTLE, growth: float = GROWTH) -> tuple[float, ...]:
    """Factors on the heights, the last 1: the first makes the terrain gentle, each next one steeper by ``growth``."""
    slope = steepest(terrain)
    if slope <= gentle:
        return (1.0,)
    stages = int(np.ceil(np.log(slope / gentle) / np.log(growth)))
    return tuple(float(factor) for factor in (gentle / slope) ** (1.0 - np.arange(stages + 1) / stages))


@dataclass(frozen=True, kw_only=True, eq=False)
class Climb:
    """What a homotopy came to. solutions: of all stages in their order, also of those that failed; reached: the
    factor of the last stage that was solved, 0 for none."""

    solutions: tuple[GaitSolution, ...]
    factors: tuple[float, ...]

    @property
    def reached(self) -> float:
        """The largest factor that was solved."""
        solved = [factor for factor, one in zip(self.factors, self.solutions, strict=True) if one.success]
        return max(solved, default=0.0)


def climb(
    bench: Workbench,
    chart: ChartName,
    heights: tuple[float, ...],
    guess: Array | None = None,
    *,
    solve: Solve = GaitProgram.solve,
    max_iterations: int | None = None,
    most_stages: int = 12,
    stop: Callable[[], bool] = lambda: False,
) -> Climb:
    """Solve at one factor after another, each from the last solution; half-way first where a stage fails.

    heights: increasing factors, the last 1. guess: of the first stage, None for its program's own. solve: in place of
    the programs' own; max_iterations: of one stage. stop: asked before every stage but the first.
    Ends at the last factor, after most_stages, or where a step is too small to halve.
    """
    ahead, solutions, factors = list(heights), list[GaitSolution](), list[float]()
    x, reached = guess, 0.0
    while ahead and len(solutions) < most_stages and not (solutions and stop()):
        factor = ahead[0]
        program, own = stage_program(bench, chart, factor)
        solution = solve(program, program.guess if x is None else x, height_factor=own, max_iterations=max_iterations)
        solutions, factors = [*solutions, solution], [*factors, factor]
        if solution.success:
            x, reached = solution.x, ahead.pop(0)
        elif len(heights) == 1 or factor - reached < LEAST:
            break
        else:
            ahead.insert(0, 0.5 * (reached + factor))
    return Climb(solutions=tuple(solutions), factors=tuple(factors))


def stage_program(bench: Workbench, chart: ChartName, factor: float) -> tuple[GaitProgram, float]:
    """The program of a stage and the factor to solve it at: 1 where the stage has a terrain and a map of its own."""
    if factor == 1.0 or chart in SCALED:
        return bench.program(chart), factor
    lower = replace(bench.task, terrain=bench.task.terrain.scaled(factor))
    return Workbench(lower, bench.settings).program(chart), 1.0
