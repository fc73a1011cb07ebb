"""The finite elements: adjoints, exact integrals, and a separable solve that solves its least
squares.
"""

import numpy as np
import pytest

from stancekit.planners.warp.local_global import _factorised
from stancekit.planners.warp.quadrature import QuadratureGrid, SeparableSolver

GRID = QuadratureGrid.of_band(((-1.0, 2.0), (0.0, 2.0)), 1.5, (5, 4, 3), 3)
RNG = np.random.default_rng(0)


def test_weights_fill_the_band_and_the_identity_has_a_unit_jacobian():
    assert GRID.weight.sum() == pytest.approx(9.0)
    assert GRID.floor_weight.sum() == pytest.approx(6.0)
    jacobian = GRID.gradient(GRID.identity)
    np.testing.assert_allclose(
        jacobian, np.broadcast_to(np.eye(3)[:, :, None, None, None], jacobian.shape), atol=1e-12
    )
    np.testing.assert_allclose(GRID.floor(GRID.identity)[2], 0.0, atol=1e-12)


def test_adjoints_are_transposes():
    psi, stress = RNG.standard_normal(GRID.identity.shape), RNG.standard_normal((3, 3, 15, 12, 9))
    load = RNG.standard_normal((3, 15, 12))
    assert np.sum(GRID.gradient(psi) * stress) == pytest.approx(
        np.sum(psi * GRID.gradient_adjoint(stress))
    )
    assert np.sum(GRID.floor(psi) * load) == pytest.approx(np.sum(psi * GRID.floor_adjoint(load)))


def test_the_separable_solve_is_the_factorised_one_and_keeps_the_walls():
    right = GRID.gradient_adjoint(RNG.standard_normal((3, 3, 15, 12, 9)) * GRID.weight)
    found = SeparableSolver(GRID, 2.5).solve(right)
    np.testing.assert_allclose(
        found, _factorised(GRID, 2.5)(right), atol=1e-8 * np.abs(found).max()
    )
    for axis in range(2):
        walls = np.moveaxis(found[axis], axis, -1) @ GRID.axes[axis].ends.T
        np.testing.assert_allclose(walls, 0.0, atol=1e-10)


def test_the_separable_solve_minimises_its_least_squares():
    goal = RNG.standard_normal((3, 3, 15, 12, 9))
    u = SeparableSolver(GRID, 2.5).solve(GRID.gradient_adjoint(goal * GRID.weight))

    def squares(v):
        return np.sum(GRID.weight * (GRID.gradient(v) - goal) ** 2) + 2.5 * np.sum(
            GRID.floor_weight * GRID.floor(v)[2] ** 2
        )

    for seed in range(5):
        right = GRID.gradient_adjoint(
            np.random.default_rng(seed).standard_normal(goal.shape) * GRID.weight
        )
        way = SeparableSolver(GRID, 2.5).solve(right)
        slope = (squares(u + 1e-4 * way) - squares(u - 1e-4 * way)) / 2e-4
        assert abs(slope) < 1e-6 * squares(way)
