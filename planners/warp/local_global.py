"""Algorithm W1: local-global optimisation of ψ, as published, and the same with a faster global
step.

Local: at each quadrature point the target J* and at each ground point h*; global: least squares
with both held. Its left side never changes: it is factorised once (published), or never
(``SeparableSolver``). As printed, W6 is ill-posed, for a map to one point of the terrain has no
energy at all; both forms pin the wall-normal component of the side walls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..files.arrays import Array
from .energy import Evaluation, MapEnergy, nearest_similarity, published_similarity
from .quadrature import QuadratureGrid, SeparableSolver

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


def published(energy: MapEnergy, psi: Array, iterations: int, tolerance: float = 1e-4) -> Descent:
    """Algorithm W1 as printed: SVD, |Σ|^(1/3), a sparse factorisation made once, h* lagged by a
    step.

    Stops after a change of ψ below ``tolerance`` of a cell. The energy need not fall: h* is one
    step late.
    """
    began = process_time()
    solve = _factorised(energy.grid, energy.match_weight)
    return _iterate(energy, psi, iterations, tolerance, solve, published_similarity, 0, began)


def accelerated(
    energy: MapEnergy, psi: Array, iterations: int, tolerance: float = 1e-4, memory: int = 6
) -> Descent:
    """Algorithm W1 with tr(Σ)/3, polar factors by Newton, fast diagonalisation, and Anderson
    acceleration.

    Arguments:
        memory: steps that the acceleration mixes, 0 for none. A mixed step that does not lower the
            energy is dropped.
    """
    began = process_time()
    solve = SeparableSolver(energy.grid, energy.match_weight).solve
    return _iterate(energy, psi, iterations, tolerance, solve, nearest_similarity, memory, began)


def _iterate(
    energy: MapEnergy,
    psi: Array,
    iterations: int,
    tolerance: float,
    solve: _Solve,
    target: Callable[[Array], Array],
    memory: int,
    began: float,
) -> Descent:
    grid = energy.grid
    cell = min(axis.cell_m for axis in grid.axes)
    history, seconds = [energy.at(psi)], [process_time() - began]
    mixer = _Anderson(memory)
    evaluations = 1
    for _ in range(iterations):
        jacobian = grid.gradient(psi)
        miss, _ = energy.miss(psi)
        stress = (target(jacobian) - jacobian) * grid.weight
        load = np.zeros((3, *miss.shape))
        load[2] = -energy.match_weight * grid.floor_weight * miss
        step = solve(grid.gradient_adjoint(stress) + grid.floor_adjoint(load))
        plain, mixed = psi + step, mixer.mix(psi, step)
        state = energy.at(mixed)
        evaluations += 1
        if memory and not state.total <= history[-1].total:
            mixer, mixed = _Anderson(memory), plain
            state = energy.at(plain)
            evaluations += 1
        psi = mixed
        history.append(state)
        seconds.append(process_time() - began)
        if float(np.abs(step).max()) < tolerance * cell:
            break
    return Descent(psi=psi, history=history, seconds=seconds, evaluations=evaluations)


class _Anderson:
    """Anderson acceleration: the affine mix of the last points whose steps nearly cancel."""

    def __init__(self, memory: int) -> None:
        self._memory = memory
        self._points: list[Array] = []
        self._steps: list[Array] = []

    def mix(self, point: Array, step: Array) -> Array:
        """The next point, from the current one and its plain step."""
        self._points = [*self._points, point.ravel()][-self._memory - 1 :]
        self._steps = [*self._steps, step.ravel()][-self._memory - 1 :]
        if self._memory == 0 or len(self._points) < 2:
            return point + step
        moves = np.stack([a - self._steps[-1] for a in self._steps[:-1]], axis=1)
        shifts = np.stack([a - self._points[-1] for a in self._points[:-1]], axis=1)
        shares = np.linalg.lstsq(moves, -self._steps[-1], rcond=1e-8)[0]
        return np.asarray(
            (point.ravel() + step.ravel() + (moves + shifts) @ shares).reshape(point.shape)
        )


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
