"""The least work of a force in a box and a friction cone: where every bound on a leaf of a
certificate comes from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array

SLACK = 1e-6
"""A certificate must also refute postures that break constraints by this much: ``check_plan``
accepts those."""


def least_works(
    a: Array, lower: Array, upper: Array, friction: Array, slack: float = SLACK
) -> tuple[Array, Array]:
    """Proved lower bounds on min {a·f : lower ≤ f ≤ upper, ‖(f_y, f_z)‖ ≤ μ f_n} for each of V
    rows, shape (V,), and the same with every inequality widened by ``slack``.

    Arguments:
        a, lower, upper: shape (V, 3), in the contact frame.
        friction: shape (V,). By duality every κ in the plane gives the bound min {(a_n − μ‖κ‖) f_n
            + (a_t − κ)·f_t : f in the box}, a concave function of κ. Its maximum lies at 0, on a
            line κ_y = a_y or κ_z = a_z, or on the circle μ‖κ‖ = a_n: where two of these meet or
            where it is stationary on one. All such points are tried and none is trusted: rounding
            and degenerate boxes can only lower the result.
    """
    an, ay, az = np.ascontiguousarray(
        a.T
    )  # a row a candidate, a column a force: the long axis last
    (low, *least), (high, *most) = np.ascontiguousarray(lower.T), np.ascontiguousarray(upper.T)
    mu = friction
    below = np.where(mu > 0.0, np.maximum(low, 0.0), low)  # the cone has f_n ≥ 0
    high = np.maximum(high, 0.0)
    y, z = np.array(
        [[least[0], most[0]], [least[1], most[1]]]
    )  # the two bounds of each shear, (2, V) each
    cone = mu * np.array([below, high])  # largest shear at either end of f_n
    circle = np.maximum(an, 0.0) / np.maximum(mu, 1e-12)

    k = np.zeros((2, 18, len(a)))  # κ_y and κ_z of all points that are tried; the first is 0
    k[0, 1:8], k[1, 1], k[1, 8:14] = ay, az, az
    for other, fixed, bounds in (
        (k[0, 8:14], az, y),
        (k[1, 2:8], ay, z),
    ):  # on a line, where one of κ is fixed
        steep = (cone * cone)[:, None] - bounds * bounds
        stationary = -np.abs(fixed) * bounds / np.sqrt(np.maximum(steep, 1e-14))
        other[:4] = stationary.reshape(4, -1)
        other[4] = np.sqrt(np.maximum(circle * circle - fixed * fixed, 0.0))  # and on the circle
        other[5] = -other[4]
    corners = np.array([y[[0, 0, 1, 1]], z[[0, 1, 0, 1]]])
    k[:, 14:] = corners * (-circle / np.maximum(np.sqrt(corners[0] ** 2 + corners[1] ** 2), 1e-12))
    ky, kz = k
    size = np.sqrt(ky * ky + kz * kz)
    dn, dy, dz = an - mu * size, ay - ky, az - kz
    value = np.minimum(dn * below, dn * high)
    value += np.minimum(dy * y[0], dy * y[1])
    value += np.minimum(dz * z[0], dz * z[1])
    value -= size * (
        1e-14 * (cone[1] + np.abs(y).max(axis=0) + np.abs(z).max(axis=0))
    )  # far more than rounding loses
    pulling = np.minimum(slack / np.maximum(mu, 1e-300), below - low)  # f_n ≥ −slack / μ
    widened = slack * (size + np.abs(dy) + np.abs(dz)) + (slack + pulling) * np.abs(dn)
    return np.asarray(value.max(axis=0)), np.asarray((value - widened).max(axis=0))


def misses_cone(lower: Array, upper: Array, friction: Array) -> NDArray[np.bool_]:
    """Tell where no force is within ``SLACK`` of both force box, shape (V, 3) each, and friction
    cone; shape (V,).
    """
    shear = np.maximum(np.maximum(lower[:, 1:], -upper[:, 1:]), 0.0)
    nearest = np.sqrt((shear * shear).sum(axis=1))
    most = friction * (upper[:, 0] + SLACK) + SLACK  # largest shear
    return np.asarray((most < 0.0) | (nearest > most + 1.5 * SLACK))
