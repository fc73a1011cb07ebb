"""Pushing frames forward: 𝒫(J), the rotation nearest to J, and its derivative (W12, Corollary
IV.1).

The corollary as printed, 𝒫 = UVᵀ|UVᵀ| with ω = U(tr(Σ)I − Σ)⁻¹Vᵀ[𝒫ᵀ∂J − ∂Jᵀ𝒫]×⁻¹, solves W12 where
det J > 0. Where det J < 0 its 𝒫 = −UVᵀ is a rotation, and ω is its derivative, but the nearest
rotation is U diag(1, 1, −1) Vᵀ, the smallest singular value being negative there:
``nearest_rotation`` solves W12 on both sides. Derivatives are CasADi's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.arrays import Array

if TYPE_CHECKING:
    import casadi as ca

NEWTON_STEPS = 8
"""Exact to rounding for Jacobians whose singular values differ by a factor of up to 100."""


def nearest_rotation(jacobian: Array) -> Array:
    """𝒫(J) = argmin over SO(3) of ‖R − J‖_F (W12), shape (…, 3, 3) → (…, 3, 3)."""
    u, _, vt = _signed_svd(np.asarray(jacobian, dtype=np.float64))
    return np.asarray(u @ vt)


def polar_function(steps: int = NEWTON_STEPS) -> ca.Function:
    """CasADi function (J: 3 × 3) → (R: 3 × 3): 𝒫(J) (W12) for det J > 0 by Newton's R ← ½(γR +
    R⁻ᵀ/γ), γ = det(R)^(−⅓).

    Smooth wherever det J > 0, so that solvers take exact first and second derivatives of it.
    """
    import casadi as ca

    jacobian = ca.SX.sym("J", 3, 3)
    turned = jacobian
    for _ in range(steps):
        rows = [turned[k, :] for k in range(3)]
        cofactor = ca.vertcat(
            ca.cross(rows[1], rows[2]), ca.cross(rows[2], rows[0]), ca.cross(rows[0], rows[1])
        )
        determinant = ca.dot(rows[0], cofactor[0, :])
        size = ca.exp(ca.log(determinant) / 3.0)
        turned = 0.5 * (turned / size + cofactor * (size / determinant))
    return ca.Function("polar", [jacobian], [turned], ["J"], ["R"])


def _signed_svd(jacobian: Array) -> tuple[Array, Array, Array]:
    """U, Σ and Vᵀ with U Vᵀ in SO(3): where det J < 0 the smallest singular value is negative."""
    u, sigma, vt = np.linalg.svd(jacobian)
    sign = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)
    u[..., :, 2] *= sign[..., None]
    sigma[..., 2] *= sign
    return u, sigma, vt
