"""Standing feet on the terrain (paper W eqs. 3 and 8): z = h(x, y), in metres.

Where the chart flattens the terrain this is z̄ = 0, which the decision vector has built in.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..transcription.blocks import Block, Constraint
from ..transcription.taylor import Site
from ..variables.structure import Structure


def contact(structure: Structure) -> Constraint | None:
    """One row for each place where a foot stands; none in a flat chart."""
    if structure.chart.flat:
        return None
    family = structure.entries("footholds", np.concatenate([foot.stances for foot in structure.layout.feet]), True)
    rows = np.arange(family.count)
    zeros = np.zeros(family.count)
    return Constraint("contact", zeros, zeros, (Block(above, ((family, rows),), rows[:, None]),))


def above(signals: list[cs.SX], sites: list[Site | None]) -> cs.SX:
    """z − h(x, y)."""
    (foot,), (site,) = signals, sites
    assert site is not None
    return foot[2] - site.here[0]
