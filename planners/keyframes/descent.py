"""Better plans from a plan: steps along the linearised surface, each of which ends with the toes held.

With the toes held the rest is convex and solved to its optimum; so every accepted step is a plan, and a better one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene.course import Weights
from .clock import Clock
from .layout import Layout
from .project import Linearised, PlanPoint, PlanProjector
from .scaled import ScaledCourse

SHARES = (1.0, 0.3, 0.1)
"""Of a linearised step, tried in this order until one is better."""


class Descent:
    """Descends on plans of one layout of one region; compiles when first used."""

    def __init__(self, layout: Layout, weights: Weights, typical: ScaledCourse, projector: PlanProjector) -> None:
        self._args = (layout, weights, typical)
        self._projector = projector
        self._linearised: Linearised | None = None

    def improve(
        self, scaled: ScaledCourse, point: PlanPoint, clock: Clock, *, steps: int = 8, least: float = 1e-9
    ) -> PlanPoint:
        """A plan at least as good. point: on the surface; least: an improvement that is worth another step."""
        if self._linearised is None:
            with clock.compiling():
                self._linearised = Linearised(*self._args)
        best, value = point, cost(scaled, point)
        for _ in range(steps):
            stepped = self._linearised.solve(scaled, best)
            clock.count(1, stepped.solver_seconds)
            if not np.isfinite(stepped.residual):
                return best
            before = value
            for share in SHARES:
                toes = best.toes + share * (stepped.toes - best.toes)
                found = self._projector.fix_toes(scaled, replace(best, toes=toes), clock)
                if found.found and cost(scaled, found) < value:
                    best, value = found, cost(scaled, found)
                    break
            if before - value < least:
                return best
        return best


def cost(scaled: ScaledCourse, point: PlanPoint) -> float:
    """The objective of ``terms.objective`` at a point, in units of the length scale squared."""
    course, moves = scaled.course, scaled.layout.moves
    weights, length = course.weights, course.length_scale_m
    value = weights.goal * float(np.sum((point.com[-1] - course.goal_m / length) ** 2))
    value += weights.tilt / length**2 * float(np.sum(point.rotation**2))
    value += weights.com_step * float(np.sum(np.diff(point.com, axis=0) ** 2))
    return value + weights.toe_step * float(np.sum((point.toes[moves[:, 1]] - point.toes[moves[:, 0]]) ** 2))
