"""Boundary_fit (Lin et al. §III-1): a box around a cluster's centre that leaves out the points of
infeasible problems.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint, milp

from stancekit.planners.files.arrays import Array

CLEARANCE = 1e-4
"""Distance outside the box that an excluded point must have (non-dimensional)."""


def largest_box(
    centre: Array, excluded: Array, low: Array, high: Array, *, time_limit_s: float = 12.0
) -> tuple[Array, Array, float]:
    """Boundary_fit as printed: the widest box (summed) in [low, high] around ``centre`` without any
    excluded point.

    A mixed-integer program on HiGHS: a binary z_jd says that point j lies outside side d, on the
    side of the centre on which it lies at all, and every point has one.

    Arguments:
        centre, low, high: shape (D,).
        excluded: shape (J, D).

    Returns:
        (low, high, gap): the best box found and the relative gap that was left at the time limit;
        with nothing found, the box shrunk onto the centre.
    """
    count, size = excluded.shape
    below = excluded < centre  # such a point can only be cut off by the lower bound
    distance = np.abs(excluded - centre)
    span = np.where(below, centre - low, high - centre)
    # Widths: w_d^- = centre − low_d and w_d^+ = high_d − centre; z_jd = 1 ⇒ w_d^± ≤ distance_jd −
    # clearance.
    side = np.where(below, 0, size) + np.arange(size)
    z = 2 * size + np.arange(count * size).reshape(count, size)
    rows = np.arange(count * size)
    cut = np.maximum(span - np.maximum(distance - CLEARANCE, 0.0), 0.0)
    matrix = sp.csr_matrix(
        (
            np.concatenate([np.ones(count * size), cut.ravel()]),
            (np.concatenate([rows, rows]), np.concatenate([side.ravel(), z.ravel()])),
        ),
        shape=(count * size, 2 * size + count * size),
    )
    one = sp.csr_matrix(
        (np.ones(count * size), (np.repeat(np.arange(count), size), z.ravel())),
        shape=(count, matrix.shape[1]),
    )
    possible = ((distance > CLEARANCE) & (span > 0.0)).ravel()
    answer = milp(
        c=np.concatenate([-np.ones(2 * size), np.zeros(count * size)]),
        constraints=[
            LinearConstraint(matrix, -np.inf, span.ravel()),
            LinearConstraint(one, 1.0, np.inf),
        ],
        integrality=np.concatenate([np.zeros(2 * size), np.ones(count * size)]),
        bounds=Bounds(
            np.zeros(matrix.shape[1]),
            np.concatenate([centre - low, high - centre, possible.astype(float)]),
        ),
        options={"time_limit": time_limit_s},
    )
    if answer.x is None:
        return centre.copy(), centre.copy(), float("inf")
    widths = answer.x[: 2 * size]
    return centre - widths[:size], centre + widths[size:], float(answer.mip_gap)
