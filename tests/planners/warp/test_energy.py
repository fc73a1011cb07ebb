"""Energies and methods: gradients by finite differences, what each method promises, and what the
paper leaves out.
"""

from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.conformal import descend, gauss_newton, point_blocks, residual_slopes
from stancekit.planners.warp.energy import (
    MapEnergy,
    cofactor,
    determinant,
    nearest_similarity,
    published_similarity,
    rotation,
    shear,
    singular_values,
)
from stancekit.planners.warp.local_global import accelerated, published
from stancekit.planners.warp.quadrature import QuadratureGrid

HILL = reference_terrain("hill")
GRID = QuadratureGrid.of_band(HILL.domain_m, 2.3, (8, 8, 3), 2)
RNG = np.random.default_rng(0)


def energies():
    return {
        "ours": MapEnergy(grid=GRID, field=HILL, match_weight=3.0, barrier=0.01),
        "published": MapEnergy.published(GRID, HILL),
        "published, barrier": MapEnergy.published(GRID, HILL, barrier=0.01),
    }


@pytest.mark.parametrize("name", energies())
def test_the_gradient_is_the_finite_difference(name):
    energy = energies()[name]
    psi = shear(GRID, HILL) + 0.02 * RNG.standard_normal(GRID.identity.shape)
    at = energy.at(psi)
    assert at.least_det > 0.3
    for seed in range(3):
        way = np.random.default_rng(seed).standard_normal(psi.shape)
        slope = (energy.at(psi + 1e-6 * way).total - energy.at(psi - 1e-6 * way).total) / 2e-6
        assert np.sum(at.gradient * way) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_the_published_gradient_holds_where_the_map_is_folded_too():
    energy, psi = MapEnergy.published(GRID, HILL), np.array(GRID.identity)
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
    psi = shear(GRID, HILL)
    np.testing.assert_allclose(determinant(GRID.gradient(psi)), 1.0, atol=1e-9)
    fine = QuadratureGrid.of_band(HILL.domain_m, 2.3, (24, 24, 3), 2)
    miss, _ = MapEnergy.published(fine, HILL).miss(shear(fine, HILL))
    assert np.abs(miss).max() < 0.08


def test_a_map_to_one_point_of_the_terrain_has_no_energy_at_all():
    """W6 as printed is ill-posed: hence the pins of the walls."""
    psi = np.zeros_like(GRID.identity)
    psi[2] = float(HILL.height(np.zeros(2)))
    for energy in (
        MapEnergy.published(GRID, HILL),
        MapEnergy(grid=GRID, field=HILL, match_weight=1.0),
    ):
        assert energy.at(psi).total == pytest.approx(0.0, abs=1e-4)
        assert energy.at(shear(GRID, HILL)).total > 1.0


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
    blocks = np.moveaxis(point_blocks(jacobian, 0.01), -1, 0)
    assert np.linalg.eigvalsh(blocks).min() > -1e-12


def test_every_method_keeps_the_walls_and_lowers_the_energy_from_where_it_starts():
    ours, printed = energies()["ours"], energies()["published"]
    found = {
        "descend": (ours, descend(ours, shear(GRID, HILL), 40)),
        "gauss-newton": (
            printed,
            gauss_newton(energies()["published, barrier"], shear(GRID, HILL), 15),
        ),
        "accelerated": (ours, accelerated(ours, GRID.identity, 40)),
        "published": (printed, published(printed, GRID.identity, 40)),
    }
    for energy, descent in found.values():
        assert energy.at(descent.psi).total < 0.5 * energy.at(GRID.identity).total
        for axis in range(2):
            walls = np.moveaxis(descent.psi[axis], axis, -1) @ GRID.axes[axis].ends.T
            np.testing.assert_allclose(
                walls, np.broadcast_to(HILL.domain_m[axis], walls.shape), atol=1e-9
            )
        assert len(descent.seconds) == len(descent.history)


def test_with_a_barrier_the_energy_falls_every_iteration_and_no_determinant_turns():
    for descent in (
        descend(energies()["ours"], shear(GRID, HILL), 40),
        gauss_newton(energies()["published, barrier"], shear(GRID, HILL), 15),
    ):
        totals = [at.total for at in descent.history]
        assert all(after < before for before, after in pairwise(totals))
        assert min(at.least_det for at in descent.history) > 0.0


def test_at_the_end_of_our_descent_the_gradient_is_gone():
    energy = energies()["ours"]
    descent = descend(energy, shear(GRID, HILL), 200, tolerance=1e-10)
    first, last = (energy.at(psi).gradient for psi in (shear(GRID, HILL), descent.psi))
    pins = GRID.axes[0].pinned
    free = [np.einsum("ia,cijk->cajk", pins, gradient)[:1] for gradient in (first, last)]
    assert np.abs(free[1]).max() < 1e-3 * np.abs(free[0]).max()


def test_anderson_saves_iterations_and_reaches_the_same_energy():
    ripple = reference_terrain("ripple")
    grid = QuadratureGrid.of_band(ripple.domain_m, 2.3, (24, 24, 6), 2)
    energy = MapEnergy(grid=grid, field=ripple, match_weight=3.0)
    plain, mixed = (accelerated(energy, grid.identity, 100, memory=memory) for memory in (0, 6))
    assert len(mixed.history) < 0.6 * len(plain.history)
    assert mixed.history[-1].total == pytest.approx(plain.history[-1].total, rel=1e-3)
