"""Standing feet on the terrain (W3 and W8): z = h(x, y), in metres.

Where the chart flattens the terrain this is z̄ = 0, which the decision vector has built in.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..transcription.blocks import Block, Constraint
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure


def contact(structure: Structure) -> Constraint | None:
    """z_i − h(x_i, y_i) = 0 [m], one row for each place where a foot stands (W3); none in a flat
    chart (W8).
    """
    if structure.chart.flat:
        return None
    variables = structure.entries(
        "footholds", np.concatenate([foot.stances for foot in structure.layout.feet]), True
    )
    rows = np.arange(variables.count)
    zeros = np.zeros(variables.count)
    return Constraint("contact", zeros, zeros, (Block(above, ((variables, rows),), rows[:, None]),))


def above(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
    """z − h(x, y)."""
    (foot,), (expansion,) = features, expansions
    assert expansion is not None
    return foot[2] - expansion.here[0]
