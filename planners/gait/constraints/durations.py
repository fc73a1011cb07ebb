"""Optimised phase durations (Pan et al. §III-A): every phase lasts, and no switching time leaves
its slack; in seconds.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, vstack

from ..transcription.blocks import Constraint
from ..variables import Structure

SHORTEST_S = 0.1
"""No phase gets shorter than this [s]."""


def durations(structure: Structure) -> Constraint | None:
    """Every phase lasts, and no switching time leaves its slack; in seconds.

    None where timings are fixed.
    """
    rows, lower, upper = [], [], []
    slack, layout = structure.settings.switch_slack_s, structure.layout
    for foot in layout.feet:
        if not len(foot.switches):
            return None
        entry_rows = layout.entry_rows(foot.switches)
        rows += [entry_rows, csr_array(entry_rows[1:] - entry_rows[:-1])]
        lasting = np.diff(foot.phases.switches_s)
        lower += [foot.phases.switches_s - slack, np.minimum(SHORTEST_S, lasting)]
        upper += [foot.phases.switches_s + slack, np.full(len(lasting), np.inf)]
    return Constraint(
        "durations", np.concatenate(lower), np.concatenate(upper), (), csr_array(vstack(rows))
    )
