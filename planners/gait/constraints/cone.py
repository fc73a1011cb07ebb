"""The friction cone of standing feet (W5 and W9): ν (f_n + s) ≥ ‖f_t‖ in units of m·g, s the
suction of adhesive feet.

It is asked of the coefficients of each stance's spline. The cone is convex and the spline's values
are means of its coefficients, so the force is in the cone at all times, not at the nodes only. The
tip is rounded off so that the derivatives exist there, on the inside: √(‖f_t‖² + ε²) ≤ ν f_n. The
solve's tolerance is held back, so that a point that counts as feasible is within the true cone,
wherever the chart's cone is the true one.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np

from ...files.arrays import Array
from ..charts.warped import Chart
from ..transcription.blocks import Block, Constraint, Kernel
from ..transcription.taylor import ExpansionPoint
from ..variables import NOTHING, Structure

TIP = 1e-3
"""ε, in units of m·g: a standing foot presses with ε/ν at least, but for the ends of its stance."""


def cone(structure: Structure) -> Constraint:
    """ν (f_n + s) − ‖f_t‖ ≥ 0 [m·g], a row for each free coefficient of a force (W5, W9)."""
    task = structure.task
    assert task.suction_n is not None
    entries, suctions = [], list[Array]()
    for number, foot in enumerate(structure.layout.feet):
        for index, forces in enumerate(foot.forces):
            free = forces[forces[:, 0] != NOTHING]
            entries.append(
                np.concatenate([np.broadcast_to(foot.stances[index], free.shape), free], axis=1)
            )
            suctions.append(
                np.full(
                    len(free),
                    task.suction_n / task.robot.weight_n if task.adhesive[number] else 0.0,
                )
            )
    plain = structure.entries("force coefficients", np.concatenate(entries), True)

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        return cs.vertcat(plain.features(v, constants), constants)

    variables = replace(plain, features=features, constants=np.concatenate(suctions)[:, None])
    rows = np.arange(variables.count)
    block = Block(pressing(structure.chart, task.friction), ((variables, rows),), rows[:, None])
    inside = np.full(variables.count, structure.settings.tolerance)
    return Constraint("cone", inside, np.full(variables.count, np.inf), (block,))


def pressing(chart: Chart, friction: float) -> Kernel:
    """ν (f_n + s) − √(‖f_t‖² + ε²) of (p̄_i, f̄_i, s)."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot,), (expansion,) = features, expansions
        normal, tangential = chart.cone(foot[3:6], foot[:3], expansion)
        return friction * (normal + foot[6]) - cs.sqrt(cs.sumsqr(tangential) + TIP**2)

    return kernel
