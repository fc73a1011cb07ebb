"""Our descent: L-BFGS on the exact gradient, preconditioned by the global step of Algorithm W1,
inside the barrier.

The Hessian of ∫‖J − J*‖² + E_match with the targets held is constant and separable; its inverse is
the first guess of L-BFGS, which learns the rest. One iteration costs one local and one global step,
the energy falls monotonically, and a line search keeps det J > 0 at every quadrature point.
"""

from __future__ import annotations

from time import process_time

import numpy as np

from ..files.arrays import Array
from .energy import Evaluation, MapEnergy
from .local_global import Descent
from .quadrature import SeparableSolver

MEMORY = 8
SHORTEST = 1e-5
RIDGE = 0.003
"""Larger ones tame the control points beyond the corners more, and cost iterations."""


def descend(
    energy: MapEnergy, psi: Array, iterations: int = 60, tolerance: float = 1e-4
) -> Descent:
    """Lower the energy from ψ, shape (3, nx, ny, nz), until an iteration gains less than
    ``tolerance`` of it.

    With a barrier det J > 0 at ψ is expected; the line search keeps it.
    """
    began = process_time()
    solver = SeparableSolver(energy.grid, energy.match_weight, RIDGE)
    pairs: list[tuple[Array, Array]] = []
    now = energy.at(psi)
    history, seconds, evaluations, message = [now], [process_time() - began], 1, "iteration limit"
    for _ in range(iterations):
        way = -_preconditioned(now.gradient, pairs, solver)
        slope = float(np.sum(way * now.gradient))
        share = 1.0
        state = energy.at(psi + way)
        evaluations += 1
        while not state.total <= now.total + 1e-4 * share * slope and share > SHORTEST:
            share *= _shrink(now, state, share * slope)
            state = energy.at(psi + share * way)
            evaluations += 1
        if not state.total <= now.total:
            message = "no lower point along the search direction"
            break
        step, turn = share * way, state.gradient - now.gradient
        if float(np.sum(step * turn)) > 1e-12:
            pairs = [*pairs, (step, turn)][-MEMORY:]
        gained = now.total - state.total
        psi, now = psi + step, state
        history.append(now)
        seconds.append(process_time() - began)
        if gained < tolerance * (now.conformal + now.match):
            message = "converged"
            break
    return Descent(
        psi=psi, history=history, seconds=seconds, evaluations=evaluations, message=message
    )


def _shrink(now: Evaluation, found: Evaluation, slope: float) -> float:
    """Factor by which to shorten a step: to the parabola's minimum where there is one, within [.1,
    .5].
    """
    if not np.isfinite(found.total):
        return 0.5
    return float(np.clip(-0.5 * slope / (found.total - now.total - slope), 0.1, 0.5))


def _preconditioned(
    gradient: Array, pairs: list[tuple[Array, Array]], solver: SeparableSolver
) -> Array:
    """The two-loop recursion of L-BFGS over ½·K⁻¹."""
    way, shares = gradient, []
    for step, turn in reversed(pairs):
        shares.append(float(np.sum(step * way)) / float(np.sum(step * turn)))
        way = way - shares[-1] * turn
    way = 0.5 * solver.solve(way)
    for (step, turn), share in zip(pairs, reversed(shares), strict=True):
        way = way + (share - float(np.sum(turn * way)) / float(np.sum(step * turn))) * step
    return way
