"""The least work of a force in a box and a friction cone: where every bound on a leaf of a certificate comes from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

SLACK = 1e-6
"""A certificate must also refute postures that break constraints by this much: ``check_posture`` accepts those."""


def least_work(a: Array, lower: Array, upper: Array, friction: Array, *, slack: float = 0.0) -> Array:
    """Proved lower bound on min {a·f : lower ≤ f ≤ upper, ‖(f_y, f_z)‖ ≤ μ f_n} for each of V rows, shape (V,).

    a, lower, upper: shape (V, 3), in the contact frame; friction: shape (V,); slack: widens every inequality.
    By duality every κ in the plane gives the bound min {(a_n − μ‖κ‖) f_n + (a_t − κ)·f_t : f in the box}, a concave
    function of κ. Its maximum lies at 0, on a line κ_y = a_y or κ_z = a_z, or on the circle μ‖κ‖ = a_n: where two of
    these meet or where it is stationary on one. All such points are tried and none is trusted: rounding and degenerate
    boxes can only lower the result.
    """
    tight, widened = least_works(a, lower, upper, friction, slack)
    return widened if slack else tight


def least_works(a: Array, lower: Array, upper: Array, friction: Array, slack: float = SLACK) -> tuple[Array, Array]:
    """``least_work`` without a slack and with one, from the same points; shapes (V,) and (V,)."""
    mu, (an, ay, az) = friction[:, None], (a[:, k : k + 1] for k in range(3))
    low = np.where(mu > 0.0, np.maximum(lower[:, :1], 0.0), lower[:, :1])  # the cone has f_n ≥ 0
    high = np.maximum(upper[:, :1], 0.0)
    y, z = np.stack([lower[:, 1:], upper[:, 1:]], axis=2).swapaxes(0, 1)  # the two bounds of each shear, (V, 2) each
    cone = mu * np.concatenate([low, high], axis=1)  # largest shear at either end of f_n
    circle = np.maximum(an, 0.0) / np.maximum(mu, 1e-12)

    def along(fixed: Array, bounds: Array) -> Array:
        """The other coordinate of κ on the line where one is ``fixed``: four stationary points, two on the circle."""
        steep = cone[:, :, None] ** 2 - bounds[:, None, :] ** 2
        stationary = -np.abs(fixed)[..., None] * bounds[:, None, :] / np.sqrt(np.maximum(steep, 1e-14))
        meet = np.sqrt(np.maximum(circle**2 - fixed**2, 0.0))
        return np.concatenate([stationary.reshape(-1, 4), meet, -meet], axis=1)

    corner_y, corner_z = y[:, [0, 0, 1, 1]], z[:, [0, 1, 0, 1]]
    outward = -circle / np.maximum(np.hypot(corner_y, corner_z), 1e-12)
    k = np.zeros((2, len(a), 18))  # κ_y and κ_z of all points that are tried; the first is 0
    k[0, :, 1:8], k[0, :, 8:14], k[0, :, 14:] = ay, along(az, y), outward * corner_y
    k[1, :, 1:2], k[1, :, 2:8], k[1, :, 8:14], k[1, :, 14:] = az, along(ay, z), az, outward * corner_z
    ky, kz = k
    size = np.sqrt(ky * ky + kz * kz)
    dn, dy, dz = an - mu * size, ay - ky, az - kz
    value = (
        np.minimum(dn * low, dn * high)
        + np.minimum(dy * y[:, :1], dy * y[:, 1:])
        + np.minimum(dz * z[:, :1], dz * z[:, 1:])
    )
    most = cone[:, 1:] + np.abs(y).max(axis=1, keepdims=True) + np.abs(z).max(axis=1, keepdims=True)
    value -= 1e-14 * size * most  # far more than is lost by rounding where κ is large
    dn = np.abs(dn)
    pulling = np.minimum(slack / np.maximum(mu, 1e-300), low - lower[:, :1])  # f_n ≥ −slack / μ
    widened = value - (slack * (size + np.abs(dy) + np.abs(dz)) + (slack + pulling) * dn)
    return np.asarray(value.max(axis=1)), np.asarray(widened.max(axis=1))


def misses_cone(lower: Array, upper: Array, friction: Array) -> NDArray[np.bool_]:
    """Where no force is within ``SLACK`` of both force box, shape (V, 3) each, and friction cone; shape (V,)."""
    shear = np.maximum(np.maximum(lower[:, 1:], -upper[:, 1:]), 0.0)
    nearest = np.sqrt((shear * shear).sum(axis=1))
    most = friction * (upper[:, 0] + SLACK) + SLACK  # largest shear
    return np.asarray((most < 0.0) | (nearest > most + 1.5 * SLACK))
