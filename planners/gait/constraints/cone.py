"""The friction cone of standing feet (W5 and W9): ν f_n ≥ ‖f_t‖, in units of m·g.

It is asked of the coefficients of each stance's spline. The cone is convex and the spline's values are means of its
coefficients, so the force is in the cone at all times, not at the nodes only. The tip is rounded off so that the
derivatives exist there, on the inside: √(‖f_t‖² + ε²) ≤ ν f_n. The solve's tolerance is held back, so that a point
that counts as feasible is within the true cone, wherever the chart's cone is the true one.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..charts.chart import Chart
from ..transcription.blocks import Block, Constraint, Kernel
from ..transcription.taylor import ExpansionPoint
from ..variables.layout import NOTHING
from ..variables.structure import Structure

TIP = 1e-3
"""ε, in units of m·g: a standing foot presses with ε/ν at least, but for the ends of its stance."""


def cone(structure: Structure) -> Constraint | None:
    """ν f_n − ‖f_t‖ ≥ 0 [m·g], a row for each free coefficient of a force of a foot without suction (W5, W9)."""
    feet = [foot for number, foot in enumerate(structure.layout.feet) if not structure.task.adhesive[number]]
    entries = [
        np.concatenate([np.broadcast_to(foot.stances[index], forces.shape), forces], axis=1)
        for foot in feet
        for index, forces in enumerate(foot.forces)
    ]
    if not entries:
        return None
    every = np.concatenate(entries)
    every = every[every[:, 3] != NOTHING]
    variables = structure.entries("force coefficients", every, True)
    rows = np.arange(variables.count)
    block = Block(pressing(structure.chart, structure.task.friction), ((variables, rows),), rows[:, None])
    inside = np.full(variables.count, structure.settings.tolerance)
    return Constraint("cone", inside, np.full(variables.count, np.inf), (block,))


def pressing(chart: Chart, friction: float) -> Kernel:
    """ν f_n − √(‖f_t‖² + ε²)."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot,), (expansion,) = features, expansions
        normal, tangential = chart.cone(foot[3:], foot[:3], expansion)
        return friction * normal - cs.sqrt(cs.sumsqr(tangential) + TIP**2)

    return kernel
