"""Finding the point that a map sends somewhere: Newton's method from the nearest of known
images.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import PlanningFailed
from ..files.arrays import Array
from ..terrain.bspline import CubicBasis

NEWTON_STEPS = 30


def surface(bases: Sequence[CubicBasis], control: Array, at: Array) -> tuple[Array, Array, Array]:
    """A bicubic surface with control points (k, n, m) at points (N, 2): value and both derivatives,
    (N, k) each.
    """
    (i, (x, dx)), (j, (y, dy)) = (
        basis.weights(np.ascontiguousarray(at[:, a]), 1) for a, basis in enumerate(bases)
    )
    width = control.shape[2]
    steps = (width * np.arange(4)[:, None] + np.arange(4)).ravel()
    near = control.reshape(len(control), -1)[:, (i * width + j)[:, None] + steps].reshape(
        len(control), -1, 4, 4
    )
    level, across = (np.matmul(near, row[:, :, None])[..., 0] for row in (y, dy))
    value, along_x, along_y = (
        np.einsum("kni,ni->nk", rows, weights)
        for rows, weights in ((level, x), (level, dx), (across, x))
    )
    return value, along_x, along_y


def inverted(
    function: Callable[[Array], tuple[Array, Array]], goal: Array, starts: Array, images: Array
) -> Array:
    """Newton's method for function(x) = goal, (N, k), from the start, (M, k), whose image is the
    nearest.

    Arguments:
        function: values and Jacobians at points, (N, k) → (N, k), (N, k, k). A step that does not
            help is halved.

    Raises:
        PlanningFailed: for a goal that it does not reach.
    """
    from scipy.spatial import cKDTree

    points = starts[cKDTree(images).query(goal)[1]]
    at, jacobian = function(points)
    miss, share, left = np.linalg.norm(at - goal, axis=1), np.ones(len(goal)), np.arange(len(goal))
    for _ in range(NEWTON_STEPS):
        left = left[miss[left] > 1e-11]
        if not left.size:
            break
        try:
            step = np.linalg.solve(jacobian[left], (goal[left] - at[left])[..., None])[..., 0]
        except np.linalg.LinAlgError:
            break
        tried = points[left] + share[left, None] * step
        tried_at, tried_jacobian = function(tried)
        tried_miss = np.linalg.norm(tried_at - goal[left], axis=1)
        better = tried_miss < miss[left]
        share[left] = np.where(better, np.minimum(1.0, 2.0 * share[left]), 0.5 * share[left])
        left_better = left[better]
        points[left_better], at[left_better], jacobian[left_better] = (
            tried[better],
            tried_at[better],
            tried_jacobian[better],
        )
        miss[left_better] = tried_miss[better]
    if miss.size and not miss.max() < 1e-8:
        worst = int(miss.argmax())
        place = ", ".join(f"{value:.3f}" for value in goal[worst])
        raise PlanningFailed(f"map: reaches ({place}) m only to {1e3 * miss[worst]:.3g} mm")
    return points
