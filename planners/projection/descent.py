"""Better plans from a plan: steps along the linearised surface, each of which ends with the toes
held.

With the toes held the rest is convex and solved to its optimum; so every accepted step is a plan,
and a better one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from .held import FixToes, Linearised
from .project import SURFACE

SHARES = (1.0, 0.3, 0.1)
"""Shares of a linearised step, tried in this order until one is better."""


def improved(
    programs: Programs,
    scaled: Scaled,
    point: Point,
    count: Callable[[int, float], object],
    *,
    steps: int = 8,
    least: float = 1e-9,
) -> Point:
    """A plan at least as good, by linearised steps on the bilinear surface, each with the toes held
    afterwards.

    Arguments:
        point: on the surface, one candidate a foothold.
        count: called with solves and their seconds.
        steps: the most.
        least: an improvement of the objective, in units of the length scale squared, worth another
            step.
    """
    step, held = (
        programs.get(Linearised, scaled.layout, False),
        programs.get(FixToes, scaled.layout, False, False),
    )
    best, value = point, cost(scaled, point)
    for _ in range(steps):
        stepped = step.solve(scaled, best)
        count(1, stepped.seconds)
        if not np.isfinite(stepped.residual):
            return best
        before = value
        for share in SHARES:
            result = held.solve(
                scaled, replace(best, toes=best.toes + share * (stepped.toes - best.toes))
            )
            count(1, result.seconds)
            if result.residual <= SURFACE and cost(scaled, result) < value:
                best, value = result, cost(scaled, result)
                break
        if before - value < least:
            return best
    return best


def cost(scaled: Scaled, point: Point) -> float:
    """The objective of Lin et al. §IV-B at a point, in units of the length scale squared.

    Goal, nominal path, tilt, steps of the COM and of the toes, with the weights of the course
    (``Weights``); of one candidate a foothold.
    """
    weights, moves = scaled.aim, scaled.layout.moves
    value = weights.goal * float(np.sum((point.com[-1] - scaled.goal) ** 2))
    value += weights.com_path * float(np.sum((point.com - scaled.com) ** 2))
    value += weights.tilt / scaled.length_m**2 * float(np.sum(point.rotation**2))
    value += weights.com_step * float(np.sum(np.diff(point.com, axis=0) ** 2))
    if scaled.layout.stands:
        frame, _, foothold = scaled.layout.standing
        value += weights.stance * float(
            np.sum((point.toes[foothold] - point.com[frame] - scaled.standing) ** 2)
        )
    return value + weights.toe_step * float(
        np.sum((point.toes[moves[:, 1]] - point.toes[moves[:, 0]]) ** 2)
    )
