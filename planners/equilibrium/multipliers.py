"""The multipliers of a solve as a certificate has them: any program of the terms proves by the same Lagrangian."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .layout import Layout
from .rows import ConicSolution, ConicStatus


def multipliers(layout: Layout, solution: ConicSolution) -> Array:
    """A leaf's row of a ``Certificate``, in single precision, its largest entry ±1.

    ν_F, ν_M of the balances (zero where the program has none), then r of the reach, a, t and g of the steps of c and Θ
    and the progress, b of the toes' steps (``verify.certificate``).
    """
    nothing = np.zeros((len(layout.stances), 3))
    groups = solution.groups

    def cone(name: str) -> Array:
        return -solution.dual(name)[:, 1:] if name in groups else np.zeros(0)

    moment = nothing
    if "moment" in groups:
        moment = solution.dual("moment")
    elif "above" in groups:
        moment = solution.dual("above") - solution.dual("below")
        if solution.status is ConicStatus.INFEASIBLE:
            moment = nothing  # refuted whatever the moments: what is there is rounding
    force = solution.dual("balance") if "balance" in groups else nothing
    progress = solution.dual("progress") if "progress" in groups else np.zeros(0)
    parts = (force, moment, cone("reach"), cone("com_step"), cone("rotation_step"), progress, cone("toe_step"))
    flat = np.concatenate([np.ravel(part) for part in parts])
    return np.asarray((flat / max(float(np.abs(flat).max()), 1e-300)).astype(np.float32).astype(np.float64))
