"""Nearest rotations and similarities to a Jacobian: rotations by det-normalised Newton or SVD,
similarities, and conformal energy.

Jacobians go in as (3, 3, N…) arrays, so that each entry is one long row.
"""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array

NEWTON_STEPS = 4
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


def rotation(jacobian: Array, steps: int = NEWTON_STEPS) -> Array:
    """The rotation nearest to J, shape (3, 3, N…): Newton's R ← ½(γR + R⁻ᵀ/γ) with γ = |det
    R|^(−1/3).

    Where det J ≤ 0 Newton would find a reflection: there by SVD, with the smallest singular value
    turned round.
    """
    cof = cofactor(jacobian)
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
        u, _, vt = np.linalg.svd(np.moveaxis(jacobian[:, :, bad], -1, 0))
        u[:, :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
        turned = np.array(turned)
        turned[:, :, bad] = np.moveaxis(u @ vt, 0, -1)
    return turned


def singular_values(jacobian: Array) -> Array:
    """σ₁ ≥ σ₂ ≥ σ₃, shape (3, N…)."""
    flat = np.moveaxis(jacobian.reshape(3, 3, -1), -1, 0)
    return np.ascontiguousarray(np.linalg.svd(flat, compute_uv=False).T).reshape(
        3, *jacobian.shape[2:]
    )


def nearest_similarity(jacobian: Array) -> Array:
    """The s·R that is nearest to J: R its rotation, s = tr(RᵀJ)/3 = tr(Σ)/3, shape (3, 3, N…)."""
    turned = rotation(jacobian)
    size = np.einsum("ab...,ab...->...", turned, jacobian) / 3.0
    return np.asarray(turned * size)


def published_similarity(jacobian: Array) -> Array:
    """U Vᵀ |Σ|^(1/3), the target of Algorithm W1 as printed, by SVD (Pan et al., before W6), shape
    (3, 3, N…).
    """
    u, sigma, vt = np.linalg.svd(np.moveaxis(jacobian.reshape(3, 3, -1), -1, 0))
    target = (u @ vt) * np.cbrt(sigma.prod(axis=1))[:, None, None]
    return np.ascontiguousarray(np.moveaxis(target, 0, -1)).reshape(jacobian.shape)
