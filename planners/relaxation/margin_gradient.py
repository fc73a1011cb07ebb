"""Gradient of P1's signed margin in the box: the envelope theorem on the rows of McCormick's
envelope.
"""

from __future__ import annotations

import numpy as np

from ..equilibrium.programs import ConicSolution
from ..files.arrays import Array
from .envelope import HIGH_HIGH, HIGH_LOW, LOW_HIGH, LOW_LOW, SIGNS, Envelope


def margin_gradient(solution: ConicSolution, at: Array, box: Envelope) -> tuple[Array, Array]:
    """∂t/∂low and ∂t/∂high of P1's signed margin, shape (B, 6) each: the envelope theorem, row by
    row of the envelope.

    Arguments:
        solution: of the program with a margin.
        at: its [p, f], shape (B, 6).
        box: that it was solved over.
    """
    signed = solution.dual("envelope") * SIGNS
    p_ends, f_ends = box.corners.p, box.corners.f
    by_p = (signed * (at[:, None, 3:] - SIGNS * f_ends)).sum(
        axis=3
    )  # of p_end: Σ_k u_jk (f_k − f_end)
    by_f = (signed * (at[:, :3, None] - SIGNS * p_ends)).sum(axis=2)
    below, above = solution.dual("sides")
    low = (
        np.concatenate([by_p[LOW_LOW] + by_p[LOW_HIGH], by_f[LOW_LOW] + by_f[HIGH_LOW]], axis=1)
        + below
    )
    high = (
        np.concatenate([by_p[HIGH_HIGH] + by_p[HIGH_LOW], by_f[HIGH_HIGH] + by_f[LOW_HIGH]], axis=1)
        - above
    )
    return low, high
