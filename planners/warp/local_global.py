"""Algorithm W1: local-global optimisation of ψ, as published.

Local: at each quadrature point the target J* and at each ground point h*; global: least squares
with both held. Its left side never changes: it is factorised once. As printed, W6 is ill-posed, for
a map to one point of the terrain has no energy at all; here the wall-normal component of the side
walls is pinned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..files.arrays import Array
from .energy import Evaluation, MapEnergy, published_similarity
from .quadrature import QuadratureGrid

_Solve = Callable[[Array], Array]
"""From the right side of the global step, shape (3, nx, ny, nz), to its displacement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Descent:
    """Result of a method: control points, the energy's parts by iteration, CPU seconds by
    iteration, and a word.
    """

    psi: Array
    history: list[Evaluation]
    seconds: list[float]
    evaluations: int
    message: str = ""
    settings: dict[str, float] = field(default_factory=dict)


def published(energy: MapEnergy, psi: Array, iterations: int) -> Descent:
    """Algorithm W1 as printed: SVD, |Σ|^(1/3), a sparse factorisation made once, h* lagged by a
    step.

    Stops after a change of ψ below 1e-4 of a cell. The energy need not fall: h* is one
    step late.
    """
    began, grid = process_time(), energy.grid
    solve = _factorised(grid, energy.match_weight)
    cell = min(axis.cell_m for axis in grid.axes)
    history, seconds = [energy.at(psi)], [process_time() - began]
    for _ in range(iterations):
        jacobian = grid.gradient(psi)
        miss, _ = energy.miss(psi)
        stress = (published_similarity(jacobian) - jacobian) * grid.weight
        load = np.zeros((3, *miss.shape))
        load[2] = -energy.match_weight * grid.floor_weight * miss
        step = solve(grid.gradient_adjoint(stress) + grid.floor_adjoint(load))
        psi = psi + step
        history.append(energy.at(psi))
        seconds.append(process_time() - began)
        if float(np.abs(step).max()) < 1e-4 * cell:
            break
    return Descent(psi=psi, history=history, seconds=seconds, evaluations=len(history))


def _factorised(grid: QuadratureGrid, grip: float) -> _Solve:
    """The global step's normal matrix of each component, factorised once."""
    x, y, z = grid.axes
    hold = np.outer(z.ends[0], z.ends[0])
    factors = []
    for component in range(3):
        keep = [
            axis.pinned if k == component and k < 2 else np.eye(len(axis.identity))
            for k, axis in enumerate(grid.axes)
        ]
        free = sparse.csr_array(sparse.kron(sparse.kron(keep[0], keep[1]), keep[2]))
        low = z.stiffness + (grip * hold if component == 2 else 0.0)
        whole = (
            sparse.kron(sparse.kron(x.stiffness, y.mass), z.mass)
            + sparse.kron(sparse.kron(x.mass, y.stiffness), z.mass)
            + sparse.kron(sparse.kron(x.mass, y.mass), low)
        )
        factors.append((free, splu(sparse.csc_matrix(free.T @ whole @ free))))

    def solve(right: Array) -> Array:
        return np.stack(
            [
                (part @ factor.solve(part.T @ row.ravel())).reshape(row.shape)
                for (part, factor), row in zip(factors, right, strict=True)
            ]
        )

    return solve
