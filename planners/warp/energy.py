"""The energy of a map (W6): ∫ρ over the band plus the match of its ground with the terrain.

With x̄ in metres E_map is in m³ and E_match in m⁴. In the paper's cell units, for cells of side a,
they are E_map/a and E_match/a² (φ stays in metres), so that its weight of 1 on E_match is 1/a here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..files.arrays import Array
from ..terrain.heightfield import HeightField
from .quadrature import QuadratureGrid

_NEWTON_STEPS = 4
"""Enough for 1e-6 where singular values differ by a factor of 4 or less; each more step squares the
error."""


def cofactor(jacobian: Array) -> Array:
    """cof J = det(J) J⁻ᵀ, shape (3, 3, N…)."""
    out = np.empty_like(jacobian)
    for i in range(3):
        a, b = jacobian[(i + 1) % 3], jacobian[(i + 2) % 3]
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            np.multiply(a[p], b[q], out=out[i, k])
            out[i, k] -= a[q] * b[p]
    return out


def determinant(jacobian: Array, cof: Array | None = None) -> Array:
    """det J, shape (N…)."""
    first = cofactor(jacobian) if cof is None else cof
    return np.asarray(
        jacobian[0, 0] * first[0, 0] + jacobian[0, 1] * first[0, 1] + jacobian[0, 2] * first[0, 2]
    )


def rotation(jacobian: Array, steps: int = _NEWTON_STEPS, cof: Array | None = None) -> Array:
    """The rotation nearest to J, shape (3, 3, N…): Newton's R ← ½(γR + R⁻ᵀ/γ) with γ = |det
    R|^(−1/3).

    Where det J ≤ 0 Newton would find a reflection: there by SVD, with the smallest singular value
    turned round.

    Arguments:
        cof: cof J, where it is known.
    """
    cof = cofactor(jacobian) if cof is None else cof
    det = determinant(jacobian, cof)
    bad = ~(det > 1e-12)
    any_bad = bool(bad.any())
    if any_bad:
        det = np.where(bad, 1.0, det)
    turned = jacobian
    for step in range(steps):
        if step:
            cof = cofactor(turned)
            det = determinant(turned, cof)
            if any_bad:
                det = np.where(bad, 1.0, det)
        size = np.cbrt(det)
        turned = turned * (0.5 / size) + cof * (0.5 * size / det)
    if any_bad:
        turned = np.array(turned)
        found = nearest_rotation(np.moveaxis(jacobian[:, :, bad], -1, 0))
        turned[:, :, bad] = np.moveaxis(found, 0, -1)
    return turned


def nearest_rotation(jacobian: Array) -> Array:
    """𝒫(J) = argmin over SO(3) of ‖R − J‖_F (W12), shape (…, 3, 3) → (…, 3, 3): U Vᵀ, where det J <
    0 with the smallest singular value turned round.
    """
    u, _, vt = np.linalg.svd(jacobian)
    u[..., 2] *= np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)[..., None]
    return np.asarray(u @ vt)


def singular_values(jacobian: Array) -> Array:
    """σ₁ ≥ σ₂ ≥ σ₃, shape (3, N…)."""
    flat = np.moveaxis(jacobian.reshape(3, 3, -1), -1, 0)
    return np.ascontiguousarray(np.linalg.svd(flat, compute_uv=False).T).reshape(
        3, *jacobian.shape[2:]
    )


def published_similarity(jacobian: Array) -> Array:
    """U Vᵀ |Σ|^(1/3), the target of Algorithm W1 as printed, by SVD (Pan et al., before W6), shape
    (3, 3, N…).
    """
    u, sigma, vt = np.linalg.svd(np.moveaxis(jacobian.reshape(3, 3, -1), -1, 0))
    target = (u @ vt) * np.cbrt(sigma.prod(axis=1))[:, None, None]
    return np.ascontiguousarray(np.moveaxis(target, 0, -1)).reshape(jacobian.shape)


_Scale = Literal["published", "nearest"]
"""published: |Σ|^(1/3), the size in the paper's ρ. nearest: tr(Σ)/3, that of the similarity nearest
to J."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """The energy at control points: its parts, E_map = conformal + barrier [m³], match (with its
    weight), and more.

    Arguments:
        gradient: shape (3, nx, ny, nz), or of size 0 where a barrier is infinite.
        least_det: min det J over the quadrature.
    """

    conformal: float
    barrier: float
    match: float
    least_det: float
    gradient: Array

    @property
    def total(self) -> float:
        """The energy E_map + weight·E_match; ``match`` already has its weight."""
        return self.conformal + self.barrier + self.match


@dataclass(frozen=True, kw_only=True, eq=False)
class MapEnergy:
    """E_map + weight·E_match over a grid (W6).

    Arguments:
        barrier: μ, 0 for none.
        scale: which similarity ρ measures against.
    """

    grid: QuadratureGrid
    field: HeightField
    match_weight: float
    barrier: float = 0.0
    scale: _Scale = "nearest"

    @classmethod
    def published(cls, grid: QuadratureGrid, field: HeightField, barrier: float = 0.0) -> MapEnergy:
        """W6 as printed, in metres."""
        side = float(np.cbrt(np.prod([axis.cell_m for axis in grid.axes])))
        return cls(
            grid=grid, field=field, match_weight=1.0 / side, barrier=barrier, scale="published"
        )

    def at(self, psi: Array) -> Evaluation:
        """Energy and its exact gradient, that of UVᵀ|Σ|^(1/3) and of h(φ_xy) included; ψ of shape
        (3, nx, ny, nz).
        """
        jacobian = self.grid.gradient(psi)
        cof = cofactor(jacobian)
        det = determinant(jacobian, cof)
        least = float(det.min())
        miss, slope = self.miss(psi)
        area = self.grid.floor_weight
        match = self.match_weight * float(np.sum(area * miss**2))
        if self.barrier > 0.0 and not least > 0.0:
            return Evaluation(
                conformal=np.inf,
                barrier=np.inf,
                match=match,
                least_det=least,
                gradient=np.zeros(0),
            )
        weight = self.grid.weight
        density, stress = (_nearest if self.scale == "nearest" else _published)(jacobian, cof, det)
        conformal = float(np.sum(weight * density))
        barrier = 0.0
        if self.barrier > 0.0:
            barrier = -self.barrier * float(np.sum(weight * np.log(det)))
            stress = stress - cof * (self.barrier / det)
        pull = 2.0 * self.match_weight * area * miss
        load = np.stack([-pull * slope[..., 0], -pull * slope[..., 1], pull])
        gradient = self.grid.gradient_adjoint(stress * weight) + self.grid.floor_adjoint(load)
        return Evaluation(
            conformal=conformal,
            barrier=barrier,
            match=match,
            least_det=least,
            gradient=gradient,
        )

    def miss(self, psi: Array) -> tuple[Array, Array]:
        """φ_z − h(φ_xy) at the ground's quadrature points, shape (X, Y) [m], and ∇h there, shape
        (X, Y, 2).
        """
        ground = self.grid.floor(psi)
        height, slope = self.field.height_and_gradient(np.moveaxis(ground[:2], 0, -1))
        return ground[2] - height, slope


def _nearest(jacobian: Array, cof: Array, det: Array) -> tuple[Array, Array]:
    """ρ = min ‖J − sR‖² over similarities sR, and ∂ρ/∂J."""
    turned = rotation(jacobian, cof=cof)
    size = np.einsum("ab...,ab...->...", turned, jacobian) / 3.0
    stress = 2.0 * (jacobian - turned * size)
    return np.einsum("ab...,ab...->...", jacobian, jacobian) - 3.0 * size**2, stress


def _published(jacobian: Array, cof: Array, det: Array) -> tuple[Array, Array]:
    """ρ = ‖J − UVᵀ|Σ|^(1/3)‖² as printed, the same for J and −J, and ∂ρ/∂J."""
    sign = np.where(det < 0.0, -1.0, 1.0)
    jacobian, det = jacobian * sign, np.maximum(np.abs(det), 1e-12)
    turned, size = rotation(jacobian, cof=cof), np.cbrt(det)
    trace = np.einsum("ab...,ab...->...", turned, jacobian)
    stress = 2.0 * (jacobian - turned * size) - cof * (
        2.0 * (trace - 3.0 * size) * size / (3.0 * det)
    )
    density = np.einsum("ab...,ab...->...", jacobian, jacobian) - 2.0 * size * trace + 3.0 * size**2
    return density, stress * sign


def shear(grid: QuadratureGrid, field: HeightField) -> Array:
    """Control points of (x̄, ȳ, z̄ + h) with h fitted in the grid's own splines, shape (3, nx, ny,
    nz): det J = 1.
    """
    x, y, _ = grid.axes
    height = field.height(np.stack(np.meshgrid(x.at, y.at, indexing="ij"), axis=-1))
    along_x = np.linalg.solve(x.mass, x.value.T @ (x.weight[:, None] * height))
    fitted = np.linalg.solve(y.mass, y.value.T @ (y.weight[:, None] * along_x.T)).T
    psi = np.array(grid.identity)
    psi[2] += fitted[:, :, None]
    return psi
