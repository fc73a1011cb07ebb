"""𝒫(J) and Corollary IV.1, against finite differences, brute force and each other."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.warp.energy import (
    nearest_similarity,
    published_similarity,
    rotation,
    singular_values,
)
from stancekit.planners.warp.spline_map import nearest_rotation, polar_function

RNG = np.random.default_rng(0)
JACOBIANS = RNG.standard_normal((600, 3, 3))
RATES = RNG.standard_normal((600, 3, 3))
DET = np.linalg.det(JACOBIANS)
SIGMA = np.linalg.svd(JACOBIANS, compute_uv=False)
SMOOTH = SIGMA[:, 1] + np.sign(DET) * SIGMA[:, 2] > 0.1
"""Where the nearest rotation is unique by a margin."""


def signed_svd(jacobian):
    """U, Σ and Vᵀ with U Vᵀ in SO(3)."""
    u, sigma, vt = np.linalg.svd(jacobian)
    sign = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)
    u[..., :, 2] *= sign[..., None]
    sigma[..., 2] *= sign
    return u, sigma, vt


def corollary(u, sigma, vt, turned, rate):
    """∂𝒫 = [ω]× 𝒫 with ω = U (tr(Σ)I − Σ)⁻¹ Vᵀ [𝒫ᵀ∂J − ∂Jᵀ𝒫]×⁻¹ (Corollary IV.1)."""
    skewed = np.swapaxes(turned, -1, -2) @ rate
    skewed = skewed - np.swapaxes(skewed, -1, -2)
    axial = np.stack([skewed[..., 2, 1], skewed[..., 0, 2], skewed[..., 1, 0]], axis=-1)
    inner = (vt @ axial[..., None])[..., 0]
    omega = (u @ (inner / (sigma.sum(axis=-1, keepdims=True) - sigma))[..., None])[..., 0]
    return np.cross(omega[..., None, :], np.swapaxes(turned, -1, -2)).swapaxes(-1, -2)


def printed_rotation(jacobian):
    """UVᵀ|UVᵀ|, the corollary as printed."""
    u, _, vt = np.linalg.svd(jacobian)
    return u @ vt * np.linalg.det(u @ vt)[..., None, None]


def rotation_rate(jacobian, rate):
    u, sigma, vt = signed_svd(jacobian)
    return corollary(u, sigma, vt, u @ vt, rate)


def printed_rate(jacobian, rate):
    return corollary(*np.linalg.svd(jacobian), printed_rotation(jacobian), rate)


def differences(function, step=1e-6):
    return (function(JACOBIANS + step * RATES) - function(JACOBIANS - step * RATES)) / (2 * step)


def test_no_rotation_is_nearer_than_the_nearest():
    others = Rotation.random(20_000, random_state=1).as_matrix()
    for jacobian in JACOBIANS[:40]:
        found = nearest_rotation(jacobian)
        np.testing.assert_allclose(found.T @ found, np.eye(3), atol=1e-12)
        assert np.linalg.det(found) == pytest.approx(1.0)
        assert (
            np.linalg.norm(found - jacobian)
            <= np.min(np.linalg.norm(others - jacobian, axis=(1, 2))) + 1e-12
        )


def test_turning_the_argument_turns_the_result():
    turns = Rotation.random(600, random_state=2).as_matrix()
    np.testing.assert_allclose(
        nearest_rotation(JACOBIANS @ turns), nearest_rotation(JACOBIANS) @ turns, atol=1e-9
    )


def test_the_rate_is_the_finite_difference_on_both_sides_of_zero_determinant():
    assert np.sum(SMOOTH & (DET > 0)) > 100
    assert np.sum(SMOOTH & (DET < 0)) > 100
    difference = differences(nearest_rotation)
    np.testing.assert_allclose(
        rotation_rate(JACOBIANS, RATES)[SMOOTH], difference[SMOOTH], atol=1e-6
    )


def test_the_printed_corollary_is_consistent_but_not_the_nearest_rotation_where_the_determinant_is_negative():
    np.testing.assert_allclose(
        printed_rate(JACOBIANS, RATES), differences(printed_rotation), atol=1e-3
    )
    np.testing.assert_allclose(
        printed_rotation(JACOBIANS)[DET > 0], nearest_rotation(JACOBIANS)[DET > 0], atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(printed_rotation(JACOBIANS)), 1.0, atol=1e-12)
    printed, nearest = (
        np.linalg.norm(function(JACOBIANS) - JACOBIANS, axis=(1, 2))
        for function in (printed_rotation, nearest_rotation)
    )
    assert np.all(printed[DET < 0] > nearest[DET < 0])


def test_the_symbolic_polar_factor_and_its_derivatives_are_the_numeric_ones():
    polar = polar_function()
    jacobian = ca.SX.sym("J", 3, 3)
    slope = ca.Function(
        "slope", [jacobian], [ca.jacobian(ca.vec(polar(jacobian)), ca.vec(jacobian))]
    )
    chosen = np.flatnonzero((DET > 0) & (SIGMA[:, 0] < 30 * SIGMA[:, 2]))[:60]
    assert len(chosen) == 60
    for index in chosen:
        np.testing.assert_allclose(
            np.array(polar(JACOBIANS[index])), nearest_rotation(JACOBIANS[index]), atol=1e-11
        )
        rate = np.array(slope(JACOBIANS[index])) @ RATES[index].ravel(order="F")
        expected = rotation_rate(JACOBIANS[index], RATES[index]).ravel(order="F")
        np.testing.assert_allclose(rate, expected, atol=1e-7 * max(1.0, np.abs(expected).max()))


def test_newtons_polar_factor_is_that_of_the_svd_and_turns_reflections_round():
    columns = np.ascontiguousarray(np.moveaxis(JACOBIANS, 0, -1))
    tame = (DET < 0) | (SIGMA[:, 0] < 8 * SIGMA[:, 2])
    found = np.moveaxis(rotation(columns, 6), -1, 0)
    np.testing.assert_allclose(found[tame], nearest_rotation(JACOBIANS)[tame], atol=1e-7)


def test_the_trace_gives_the_nearest_similarity_and_the_cube_root_does_not():
    columns = np.ascontiguousarray(np.moveaxis(JACOBIANS[DET > 0.3][:50], 0, -1))
    away = [
        np.sum((columns - target(columns)) ** 2, axis=(0, 1))
        for target in (nearest_similarity, published_similarity)
    ]
    assert np.all(away[0] < away[1])
    for scale in (0.99, 1.01):
        assert np.all(
            np.sum((columns - scale * nearest_similarity(columns)) ** 2, axis=(0, 1)) > away[0]
        )
    sigma = singular_values(columns)
    np.testing.assert_allclose(
        away[1], np.sum((sigma - np.cbrt(sigma.prod(axis=0))) ** 2, axis=0), atol=1e-10
    )
