"""The finite elements of Pan et al. §IV-A: a tri-cubic B-spline space, its Gauss quadrature and its
separable solves.

Arrays go component first: control points ψ have shape (3, nx, ny, nz) with n = cells + 3, Jacobians
(3, 3, X, Y, Z) with the component in front of the derivative, over the X × Y × Z quadrature points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array
from ..terrain.heightfield import CubicBasis


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """One axis of the grid: uniform cells from ``low`` to ``high`` [m], ``points`` Gauss points in
    each.
    """

    low: float
    high: float
    cells: int
    points: int

    @property
    def cell_m(self) -> float:
        """Width of a cell [m]."""
        return (self.high - self.low) / self.cells

    @cached_property
    def basis(self) -> CubicBasis:
        """Basis of its cells + 3 cubic B-splines."""
        return CubicBasis(self.low + self.cell_m * np.arange(-3.0, self.cells + 4.0))

    @cached_property
    def identity(self) -> Array:
        """Control points of x ↦ x, shape (n,) [m]."""
        return np.asarray(self.low + self.cell_m * np.arange(-1, self.cells + 2))

    @cached_property
    def _gauss(self) -> tuple[Array, Array]:
        at, weight = np.polynomial.legendre.leggauss(self.points)
        starts = self.low + self.cell_m * np.arange(self.cells)
        return (
            (starts[:, None] + 0.5 * self.cell_m * (at + 1.0)).ravel(),
            np.tile(0.5 * self.cell_m * weight, self.cells),
        )

    @property
    def at(self) -> Array:
        """Quadrature points [m]."""
        return self._gauss[0]

    @property
    def weight(self) -> Array:
        """Quadrature weights [m]."""
        return self._gauss[1]

    @cached_property
    def value(self) -> Array:
        """Every function at every quadrature point, shape (points, n)."""
        return np.ascontiguousarray(self.basis.matrix(self.at).toarray())

    @cached_property
    def slope(self) -> Array:
        """Every function's derivative there, shape (points, n) [1/m]."""
        return np.ascontiguousarray(self.basis.matrix(self.at, 1).toarray())

    @cached_property
    def mass(self) -> Array:
        """M, ∫ of the products of functions, shape (n, n)."""
        return np.asarray(self.value.T @ (self.weight[:, None] * self.value))

    @cached_property
    def stiffness(self) -> Array:
        """K, ∫ of the products of their derivatives, shape (n, n)."""
        return np.asarray(self.slope.T @ (self.weight[:, None] * self.slope))

    @cached_property
    def ends(self) -> Array:
        """Every function at both ends, shape (2, n)."""
        return self.basis.matrix(np.array([self.low, self.high])).toarray()

    @cached_property
    def pinned(self) -> Array:
        """The functions that are 0 at both ends, as columns over all functions, shape (n, n −
        2).
        """
        inner = np.eye(len(self.identity))[:, 1:-1]
        low, high = self.ends
        inner[0] = -low[1:-1] / low[0]
        inner[-1] = -high[1:-1] / high[-1]
        return inner

    def modes(
        self, *, pinned: bool = False, grip: float = 0.0, ridge: float = 0.0
    ) -> tuple[Array, Array]:
        """λ, shape (k,), and E, shape (n, k), with Eᵀ M E = I and Eᵀ (K + grip·b bᵀ) E = diag λ.

        M and K are the axis's mass and stiffness, b the functions at its low end.

        Arguments:
            pinned: all modes are 0 at both ends.
            ridge: added to M's diagonal, in cells.
        """
        mass = self.mass + ridge * self.cell_m * np.eye(len(self.identity))
        stiffness = self.stiffness + grip * np.outer(self.ends[0], self.ends[0])
        selection = self.pinned if pinned else np.eye(len(self.identity))
        from scipy.linalg import eigh  # slow to import

        values, vectors = eigh(selection.T @ stiffness @ selection, selection.T @ mass @ selection)
        return values, selection @ vectors


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadratureGrid:
    """The cells of a band above the flat ground z̄ = 0, x̄ first; each axis with its quadrature."""

    axes: tuple[Axis, Axis, Axis]

    @classmethod
    def of_band(
        cls,
        domain_m: tuple[tuple[float, float], tuple[float, float]],
        height_m: float,
        cells: tuple[int, int, int],
        points: int,
    ) -> QuadratureGrid:
        """The grid over a terrain's domain and up to ``height_m``."""
        spans = (*domain_m, (0.0, height_m))
        x, y, z = (
            Axis(low=low, high=high, cells=n, points=points)
            for (low, high), n in zip(spans, cells, strict=True)
        )
        return cls(axes=(x, y, z))

    @cached_property
    def identity(self) -> Array:
        """Control points of the map that changes nothing, shape (3, nx, ny, nz) [m]."""
        return np.stack(np.meshgrid(*(axis.identity for axis in self.axes), indexing="ij"))

    @cached_property
    def weight(self) -> Array:
        """Volume of each quadrature point, shape (X, Y, Z) [m³]."""
        x, y, z = (axis.weight for axis in self.axes)
        return np.asarray(x[:, None, None] * y[:, None] * z)

    @cached_property
    def floor_weight(self) -> Array:
        """Area of each quadrature point of the ground, shape (X, Y) [m²]."""
        return np.outer(self.axes[0].weight, self.axes[1].weight)

    def gradient(self, psi: Array) -> Array:
        """J of the map at every quadrature point, shape (3, 3, X, Y, Z)."""
        x, y, z = self.axes
        along, across = psi @ z.value.T, psi @ z.slope.T
        level = y.value @ along
        parts = (x.slope, level), (x.value, y.slope @ along), (x.value, y.value @ across)
        return np.stack([_along_x(matrix, part) for matrix, part in parts], axis=1)

    def gradient_adjoint(self, stress: Array) -> Array:
        """Transpose of ``gradient``: from (3, 3, X, Y, Z) to (3, nx, ny, nz)."""
        x, y, z = self.axes
        first, second, third = (
            _along_x(np.ascontiguousarray(matrix.T), stress[:, d])
            for d, matrix in enumerate((x.slope, x.value, x.value))
        )
        level = (y.value.T @ first + y.slope.T @ second) @ z.value
        return np.asarray(level + (y.value.T @ third) @ z.slope)

    def floor(self, psi: Array) -> Array:
        """The map at the ground's quadrature points, shape (3, X, Y) [m]."""
        x, y, z = self.axes
        return np.asarray(x.value @ (psi @ z.ends[0]) @ y.value.T)

    def floor_adjoint(self, load: Array) -> Array:
        """Transpose of ``floor``: from (3, X, Y) to (3, nx, ny, nz)."""
        x, y, z = self.axes
        return np.asarray((x.value.T @ load @ y.value)[..., None] * z.ends[0])


class SeparableSolver:
    """Least squares of gradients, argmin ∫‖∇u − S‖² + grip ∫_ground u_z², by fast diagonalisation.

    The component of u that is normal to a side wall stays 0 on it; the rest is free. No
    factorisation: a solve is a product with the modes of each axis there and back.

    Arguments:
        ridge: what holds back the functions at the corners, which hardly reach into the band: next
            to nothing decides on them, and the map would go on wildly beyond its corners. It
            changes the way to where a gradient is zero, not the place.
    """

    def __init__(self, grid: QuadratureGrid, grip: float, ridge: float = 0.0) -> None:
        x, y, z = grid.axes
        held_x, held_y = (axis.modes(pinned=True, ridge=ridge) for axis in (x, y))
        free_x, free_y, free_z = (axis.modes(ridge=ridge) for axis in grid.axes)
        self._modes = [
            (held_x, free_y, free_z),
            (free_x, held_y, free_z),
            (free_x, free_y, z.modes(grip=grip, ridge=ridge)),
        ]
        self._inverse = [
            1.0 / (a[0][:, None, None] + b[0][:, None] + c[0]) for a, b, c in self._modes
        ]

    def solve(self, right: Array) -> Array:
        """K⁻¹ right, shape (3, nx, ny, nz), in the space of what the pins leave free."""
        solution = np.empty_like(right)
        for k, ((_, ex), (_, ey), (_, ez)) in enumerate(self._modes):
            inner = _along_x(np.ascontiguousarray(ex.T), ey.T @ (right[k] @ ez))
            solution[k] = _along_x(ex, ey @ ((inner * self._inverse[k]) @ ez.T))
        return solution


def _along_x(matrix: Array, values: Array) -> Array:
    """The matrix over the third axis from the end, shape (…, m, Y, Z)."""
    *front, _, y, z = values.shape
    flat = np.ascontiguousarray(values).reshape(*front, values.shape[-3], y * z)
    return np.asarray((matrix @ flat).reshape(*front, matrix.shape[0], y, z))
