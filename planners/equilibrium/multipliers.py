"""The multipliers of a solve as a certificate has them: any program of the terms proves by the same
Lagrangian.
"""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from .conic_solution import ConicSolution, ConicStatus
from .layout import Layout


def multiplier_shapes(layout: Layout) -> dict[str, tuple[int, ...]]:
    """The groups of a leaf's row, in its order."""
    stances, steps = (len(layout.stances), 3), layout.frames - 1
    return {
        "nu_F": stances,
        "nu_M": stances,
        "reach": (layout.frames, layout.limbs, 3),
        "com_step": (steps, 3),
        "rotation_step": (steps, 3),
        "progress": (steps,),
        "toe_step": (len(layout.moves), 3),
        "reach_rows": (layout.frames, len(layout.row_limbs)),
        "relative_reach": (len(layout.relative_rows[0]),),
        "linear_step": (steps, layout.linear),
    }


def multipliers(layout: Layout, solution: ConicSolution) -> Array:
    """A leaf's row of a ``Certificate``, in single precision, its largest entry ±1.

    ν_F, ν_M of the balances (zero where the program has none), then r of the reach, a, t and g of
    the steps of c and Θ and the progress, b of the toes' steps, σ of half-spaces of reach and of
    feet (``verify.certificate``), and those of further rows of the body's steps.
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
    rows = np.zeros(0)
    if "reach_rows" in groups:  # of their inner sets, which are cones, the first of each
        rows = np.maximum(
            solution.dual("reach_rows").reshape(layout.frames * len(layout.row_limbs), -1)[:, 0],
            0.0,
        )
    apart = (
        np.maximum(solution.dual("relative_reach"), 0.0)
        if "relative_reach" in groups
        else np.zeros(0)
    )
    if not len(apart):  # toes that are held
        apart = np.zeros(len(layout.relative_rows[0]))
    steps = (cone("com_step"), cone("rotation_step"), progress, cone("toe_step"))
    linear = np.zeros((layout.frames - 1) * layout.linear)
    if "linear_step" in groups:
        linear = np.maximum(solution.dual("linear_step"), 0.0)
    parts = (force, moment, cone("reach"), *steps, rows, apart, linear)
    flat = np.concatenate([np.ravel(part) for part in parts])
    return np.asarray(
        (flat / max(float(np.abs(flat).max()), 1e-300)).astype(np.float32).astype(np.float64)
    )
