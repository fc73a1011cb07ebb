"""Spline maps: derivatives, the straight continuation, the inverse, the snap, and the file."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.conformal import descend, gauss_newton, point_blocks, residual_slopes
from stancekit.planners.warp.energy import (
    MapEnergy,
    cofactor,
    determinant,
    nearest_rotation,
    published_similarity,
    rotation,
    shear,
    singular_values,
)
from stancekit.planners.warp.local_global import published
from stancekit.planners.warp.quadrature import QuadratureGrid
from stancekit.planners.warp.spline_map import SplineMap, fading, polar_function
from tests.refusals import at_once, refuses

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


def nearest_similarity(jacobian):
    """The s·R that is nearest to J: R its rotation, s = tr(RᵀJ)/3 = tr(Σ)/3, shape (3, 3, N…)."""
    turned = rotation(jacobian)
    size = np.einsum("ab...,ab...->...", turned, jacobian) / 3.0
    return np.asarray(turned * size)


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


DOMAIN = ((-2.0, 2.0), (-1.5, 1.5))
GRID = QuadratureGrid.of_band(DOMAIN, 1.2, (6, 5, 3), 2)


def bent(size=0.03, snap=True, seed=0):
    rng = np.random.default_rng(seed)
    field = HeightField.from_array(0.02 * rng.standard_normal((23, 19)), 0.2) if snap else None
    control = GRID.identity + size * rng.standard_normal(GRID.identity.shape)
    return SplineMap(
        domain_m=DOMAIN, height_m=1.2, control_m=control, snap=field, fade_m=0.7, name="bent"
    )


def around(count=400, beyond=0.6, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(
        [-2 - beyond, -1.5 - beyond, -beyond], [2 + beyond, 1.5 + beyond, 1.2 + beyond], (count, 3)
    )


def test_the_identity_is_the_identity_also_far_outside():
    same = SplineMap(domain_m=DOMAIN, height_m=1.2, control_m=GRID.identity)
    at = around(beyond=15.0)
    np.testing.assert_allclose(same.points(at), at, atol=1e-12)
    np.testing.assert_allclose(same.jacobians(at), np.tile(np.eye(3), (len(at), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("snap", [False, True])
def test_jacobians_are_finite_differences_inside_and_outside(snap):
    warp, at, step = bent(snap=snap), around(), 1e-5
    jacobian = warp.jacobians(at)
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = (warp.points(at + shift) - warp.points(at - shift)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., axis], slope, atol=1e-7)


def test_jacobians_do_not_jump_where_the_band_ends():
    warp, rng = bent(), np.random.default_rng(3)
    for axis, (low, high) in enumerate((*DOMAIN, (0.0, 1.2))):
        at = rng.uniform([-2, -1.5, 0], [2, 1.5, 1.2], (50, 3))
        for end in (low, high):
            at[:, axis] = end
            shift = 1e-9 * np.eye(3)[axis]
            np.testing.assert_allclose(
                warp.jacobians(at + shift), warp.jacobians(at - shift), atol=1e-6
            )


def test_a_regular_grid_gives_what_single_points_give():
    warp = bent()
    lines = [np.linspace(-2, 2, 7), np.linspace(-1.5, 1.5, 6), np.linspace(0, 1.2, 5)]
    at = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    point, jacobian = warp.on_grid(*lines)
    np.testing.assert_allclose(np.moveaxis(point, 0, -1), warp.points(at), atol=1e-12)
    np.testing.assert_allclose(
        np.moveaxis(jacobian, (0, 1), (-2, -1)), warp.jacobians(at), atol=1e-12
    )
    np.testing.assert_allclose(warp.ground_on_grid(*lines[:2]), point[..., 0], atol=1e-12)


def test_the_inverse_undoes_the_map_and_says_where_it_cannot():
    warp = bent()
    at = np.random.default_rng(4).uniform([-1.9, -1.4, 0.0], [1.9, 1.4, 1.2], (20, 10, 3))
    np.testing.assert_allclose(warp.inverse(warp.points(at)), at, atol=1e-8)
    flat = np.array(GRID.identity)
    flat[2] = 0.0
    folded = SplineMap(domain_m=DOMAIN, height_m=1.2, control_m=flat)
    with refuses("map", "500 mm", kind=PlanningFailed):
        folded.inverse(np.array([[0.0, 0.0, 0.5]]))


def test_a_steep_snap_alone_never_folds_a_map():
    """Det J changes only by b′ δ times the plan's area, whatever the slope of δ is."""
    cliff = HeightField.from_array(
        np.where(np.arange(41)[:, None] > 20, 0.1, -0.1) * np.ones((1, 41)), 0.05
    )
    assert np.abs(cliff.gradient(around()[:, :2])).max() > 3.0
    bare = bent(snap=False)
    warp = SplineMap(
        domain_m=DOMAIN, height_m=1.2, control_m=bare.control_m, snap=cliff, fade_m=0.6
    )
    at = around(4000)
    plain, snapped = bare.jacobians(at), np.linalg.det(warp.jacobians(at))
    _, faster = fading(at[:, 2], 0.6)
    plan = np.linalg.det(plain[:, :2, :2])
    expected = np.linalg.det(plain) + faster * cliff.height(bare.points(at)[:, :2]) * plan
    np.testing.assert_allclose(snapped, expected, atol=1e-9)


def test_the_fade_is_one_at_the_ground_nothing_from_its_height_on_and_its_slope_is_a_finite_difference():
    z = np.linspace(-0.5, 1.5, 401)
    fade, slope = fading(z, 0.9)
    assert np.all(fade[z <= 0.0] == 1.0)
    assert np.all(np.abs(fade[z >= 0.9]) < 1e-12)
    np.testing.assert_allclose(
        slope, (fading(z + 1e-6, 0.9)[0] - fading(z - 1e-6, 0.9)[0]) / 2e-6, atol=1e-8
    )


def test_a_map_comes_back_from_its_file_in_a_moment(tmp_path):
    for warp in (bent(), bent(snap=False)):
        warp.to_file(tmp_path / "map.npz")
        with at_once(10_000):
            again = SplineMap.from_file(tmp_path / "map.npz")
        np.testing.assert_array_equal(again.points(around()), warp.points(around()))
        assert (again.name, again.fade_m, again.snap is None) == (
            warp.name,
            warp.fade_m,
            warp.snap is None,
        )


def test_what_is_no_map_file_is_refused_by_one_line(tmp_path):
    path = tmp_path / "map.npz"
    with refuses(path):
        SplineMap.from_file(path)
    path.write_bytes(b"no zip")
    with refuses(path):
        SplineMap.from_file(path)
    arrays = bent().to_arrays()
    for changed, name in (
        ({"format": np.array("stancekit/warp/0")}, "expected format stancekit/warp/1"),
        ({"control_m": arrays["control_m"][:, :3]}, "control_m"),
        ({"control_m": np.nan * arrays["control_m"]}, "control_m"),
        ({"extra": np.zeros(1)}, "wrong"),
        ({"fade_m": np.array(-1.0)}, "fade_m"),
    ):
        np.savez(path, **(arrays | changed))
        with refuses("map.npz", name):
            SplineMap.from_file(path)


def test_a_map_fits_only_the_terrain_it_was_made_for():
    field = HeightField.from_array(np.zeros((9, 9)), name="level")
    with refuses("map bent", "level"):
        bent().check_fits(field)


HILL = reference_terrain("hill")
FINE = QuadratureGrid.of_band(HILL.domain_m, 2.3, (8, 8, 3), 2)


def energies():
    return {
        "ours": MapEnergy(grid=FINE, field=HILL, match_weight=3.0, barrier=0.01),
        "published": MapEnergy.published(FINE, HILL),
        "published, barrier": MapEnergy.published(FINE, HILL, barrier=0.01),
    }


@pytest.mark.parametrize("name", energies())
def test_the_gradient_is_the_finite_difference(name):
    energy = energies()[name]
    psi = shear(FINE, HILL) + 0.02 * RNG.standard_normal(FINE.identity.shape)
    at = energy.at(psi)
    assert at.least_det > 0.3
    for seed in range(3):
        way = np.random.default_rng(seed).standard_normal(psi.shape)
        slope = (energy.at(psi + 1e-6 * way).total - energy.at(psi - 1e-6 * way).total) / 2e-6
        assert np.sum(at.gradient * way) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_the_published_gradient_holds_where_the_map_is_folded_too():
    energy, psi = MapEnergy.published(FINE, HILL), np.array(FINE.identity)
    psi[2] *= -1.0
    psi = psi + 0.02 * RNG.standard_normal(psi.shape)
    at, way = energy.at(psi), RNG.standard_normal(psi.shape)
    assert at.least_det < -0.5
    slope = (energy.at(psi + 1e-6 * way).total - energy.at(psi - 1e-6 * way).total) / 2e-6
    assert np.sum(at.gradient * way) == pytest.approx(slope, rel=1e-6)


def test_densities_are_those_of_the_singular_values():
    jacobian = np.eye(3)[:, :, None] + 0.2 * RNG.standard_normal((3, 3, 40))
    sigma = singular_values(jacobian)
    mean, root = sigma.mean(axis=0), np.cbrt(sigma.prod(axis=0))
    for target, size in ((nearest_similarity, mean), (published_similarity, root)):
        away = np.sum((jacobian - target(jacobian)) ** 2, axis=(0, 1))
        np.testing.assert_allclose(away, np.sum((sigma - size) ** 2, axis=0), atol=1e-8)


def test_the_shear_has_determinant_one_and_follows_the_terrain():
    psi = shear(FINE, HILL)
    np.testing.assert_allclose(determinant(FINE.gradient(psi)), 1.0, atol=1e-9)
    fine = QuadratureGrid.of_band(HILL.domain_m, 2.3, (24, 24, 3), 2)
    miss, _ = MapEnergy.published(fine, HILL).miss(shear(fine, HILL))
    assert np.abs(miss).max() < 0.08


def test_a_map_to_one_point_of_the_terrain_has_no_energy_at_all():
    """W6 as printed is ill-posed: hence the pins of the walls."""
    psi = np.zeros_like(FINE.identity)
    psi[2] = float(HILL.height(np.zeros(2)))
    for energy in (
        MapEnergy.published(FINE, HILL),
        MapEnergy(grid=FINE, field=HILL, match_weight=1.0),
    ):
        assert energy.at(psi).total == pytest.approx(0.0, abs=1e-4)
        assert energy.at(shear(FINE, HILL)).total > 1.0


def test_gauss_newtons_residual_slopes_are_finite_differences():
    jacobian = np.eye(3)[:, :, None] + 0.25 * RNG.standard_normal((3, 3, 60))
    jacobian = jacobian[:, :, determinant(jacobian) > 0.1]

    def residual(j):
        return (j - rotation(j, 8) * np.cbrt(determinant(j))).reshape(9, -1)

    slopes = residual_slopes(jacobian, cofactor(jacobian), determinant(jacobian))
    for k in range(9):
        way = np.eye(9)[k].reshape(3, 3, 1)
        difference = (residual(jacobian + 1e-6 * way) - residual(jacobian - 1e-6 * way)) / 2e-6
        np.testing.assert_allclose(slopes[:, k], difference, atol=1e-7)
    assert np.linalg.eigvalsh(np.moveaxis(point_blocks(jacobian, 0.01), -1, 0)).min() > -1e-12


def test_every_method_keeps_the_walls_and_lowers_the_energy_from_where_it_starts():
    ours, printed = energies()["ours"], energies()["published"]
    found = {
        "descend": (ours, descend(ours, shear(FINE, HILL), 40)),
        "gauss-newton": (
            printed,
            gauss_newton(energies()["published, barrier"], shear(FINE, HILL), 15),
        ),
        "published": (printed, published(printed, FINE.identity, 40)),
    }
    for energy, descent in found.values():
        assert energy.at(descent.psi).total < 0.5 * energy.at(FINE.identity).total
        for axis in range(2):
            walls = np.moveaxis(descent.psi[axis], axis, -1) @ FINE.axes[axis].ends.T
            np.testing.assert_allclose(
                walls, np.broadcast_to(HILL.domain_m[axis], walls.shape), atol=1e-9
            )
        assert len(descent.seconds) == len(descent.history)


def test_with_a_barrier_the_energy_falls_every_iteration_and_no_determinant_turns():
    for descent in (
        descend(energies()["ours"], shear(FINE, HILL), 40),
        gauss_newton(energies()["published, barrier"], shear(FINE, HILL), 15),
    ):
        totals = [at.total for at in descent.history]
        assert all(after < before for before, after in pairwise(totals))
        assert min(at.least_det for at in descent.history) > 0.0


def test_at_the_end_of_our_descent_the_gradient_is_gone():
    energy = energies()["ours"]
    descent = descend(energy, shear(FINE, HILL), 200, tolerance=1e-10)
    first, last = (energy.at(psi).gradient for psi in (shear(FINE, HILL), descent.psi))
    pins = FINE.axes[0].pinned
    free = [np.einsum("ia,cijk->cajk", pins, gradient)[:1] for gradient in (first, last)]
    assert np.abs(free[1]).max() < 1e-3 * np.abs(free[0]).max()
