"""The second method of Pan et al. §IV-B: Gauss-Newton on W6 with barrier, and a line search that
keeps det J > 0.

The residuals are J − UVᵀ|Σ|^(1/3), with the derivatives of U, V and Σ, and φ_z − h(φ_xy) with that
of h; the barrier −μ Σ log Σ_i = −μ log det J counts with the square of its slope, which is
positive. The paper factorises the normal matrix in each iteration; here conjugate gradients solve
it, preconditioned by the global step of Algorithm W1.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np

from ..files.arrays import Array
from .energy import MapEnergy
from .local_global import Descent
from .quadrature import SeparableSolver
from .similarity import cofactor, determinant, rotation

SHORTEST = 1e-6
MOST_PRODUCTS = 80
"""Products with the normal matrix in one Gauss-Newton step."""


def gauss_newton(
    energy: MapEnergy, psi: Array, iterations: int, tolerance: float = 1e-4
) -> Descent:
    """Gauss-Newton from ψ, shape (3, nx, ny, nz), until a step changes the energy by less than
    ``tolerance`` of it.

    Expects an energy of scale "published", and det J > 0 at ψ where it has a barrier.
    """
    began = process_time()
    precondition = SeparableSolver(energy.grid, energy.match_weight).solve
    now = energy.at(psi)
    history, seconds, evaluations, products, message = (
        [now],
        [process_time() - began],
        1,
        0,
        "iteration limit",
    )
    for _ in range(iterations):
        step, count = _conjugate_gradients(_normal_matrix(energy, psi), -now.gradient, precondition)
        products += count
        slope = float(np.sum(step * now.gradient))
        share = 1.0
        state = energy.at(psi + step)
        evaluations += 1
        while not state.total <= now.total + 1e-4 * share * slope and share > SHORTEST:
            share *= 0.5
            state = energy.at(psi + share * step)
            evaluations += 1
        if not state.total <= now.total:
            message = "no lower point along the search direction"
            break
        gained = now.total - state.total
        psi, now = psi + share * step, state
        history.append(now)
        seconds.append(process_time() - began)
        if gained < tolerance * (now.conformal + now.match):
            message = "converged"
            break
    return Descent(
        psi=psi,
        history=history,
        seconds=seconds,
        evaluations=evaluations,
        message=message,
        settings={"matrix_products": float(products)},
    )


def _normal_matrix(energy: MapEnergy, psi: Array) -> Callable[[Array], Array]:
    """v ↦ (2 DᵀD + barrier) v of the residuals' derivatives D at ψ."""
    grid = energy.grid
    jacobian = grid.gradient(psi)
    blocks = grid.weight.ravel() * point_blocks(jacobian.reshape(3, 3, -1), energy.barrier)
    _, slope = energy.miss(psi)
    row = np.stack([-slope[..., 0], -slope[..., 1], np.ones(slope.shape[:-1])])
    area = 2.0 * energy.match_weight * grid.floor_weight

    def product(vector: Array) -> Array:
        bent = np.einsum("abn,bn->an", blocks, grid.gradient(vector).reshape(9, -1)).reshape(
            jacobian.shape
        )
        lifted = row * (area * np.sum(row * grid.floor(vector), axis=0))
        return grid.gradient_adjoint(bent) + grid.floor_adjoint(lifted)

    return product


def point_blocks(jacobian: Array, barrier: float) -> Array:
    """Gauss-Newton matrices of ρ at Jacobians, shape (3, 3, N) → (9, 9, N), rows by component and
    derivative.
    """
    cof = cofactor(jacobian)
    det = determinant(jacobian, cof)
    sign = np.where(det < 0.0, -1.0, 1.0)
    jacobian, det = jacobian * sign, np.maximum(np.abs(det), 1e-12)
    slopes = residual_slopes(jacobian, cof, det)
    blocks = 2.0 * np.einsum("ran,rbn->abn", slopes, slopes)
    if barrier > 0.0:
        first = (cof / det).reshape(9, -1)
        blocks += barrier * first[:, None] * first[None, :]
    return np.asarray(blocks)


def residual_slopes(jacobian: Array, cof: Array, det: Array) -> Array:
    """∂(J − R g)/∂J with R = UVᵀ and g = |Σ|^(1/3), shape (3, 3, N) → (9, 9, N), for det J > 0.

    ∂R = R [w]× with w = (tr(S)I − S)⁻¹ axial(Rᵀ∂J − ∂JᵀR) and S = RᵀJ (Corollary IV.1), ∂g = g/(3
    det) cof J : ∂J.
    """
    turned, size = rotation(jacobian), np.cbrt(det)
    stretch = np.einsum("can,cbn->abn", turned, jacobian)
    trace = stretch[0, 0] + stretch[1, 1] + stretch[2, 2]
    inner = np.moveaxis(trace * np.eye(3)[:, :, None] - stretch, -1, 0)
    inverse = np.moveaxis(np.linalg.inv(inner), 0, -1)
    out = np.zeros((9, 9, jacobian.shape[-1]))
    for c in range(3):
        for d in range(3):
            unit = np.zeros((3, 1))
            unit[d] = 1.0
            w = np.einsum("abn,bn->an", inverse, np.cross(unit, turned[c], axis=0))
            spun = np.cross(turned, w[None], axis=1)  # R[w]×, row by row
            column = -turned * (size / (3.0 * det) * cof[c, d]) - size * spun
            out[:, 3 * c + d] = column.reshape(9, -1)
            out[3 * c + d, 3 * c + d] += 1.0
    return out


def _conjugate_gradients(
    product: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    tolerance: float = 0.03,
) -> tuple[Array, int]:
    """A step that solves the normal equations to ``tolerance`` by the preconditioner's norm, and
    how many products.
    """
    solution, left = np.zeros_like(right), right
    near = precondition(left)
    way, size = near, float(np.sum(left * near))
    first, count = size, 0
    while count < MOST_PRODUCTS and size > tolerance**2 * first:
        count += 1
        bent = product(way)
        share = size / float(np.sum(way * bent))
        solution, left = solution + share * way, left - share * bent
        near = precondition(left)
        before, size = size, float(np.sum(left * near))
        way = near + (size / before) * way
    return solution, count
