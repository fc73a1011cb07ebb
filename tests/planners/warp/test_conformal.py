"""The product's maps: injective and exact at the ground, measured by other means than their
report's.
"""

import json

import numpy as np
import pytest

from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import named_terrain, reference_terrain
from stancekit.planners.warp import conformal
from stancekit.planners.warp.conformal import fit_map, flatten
from stancekit.planners.warp.local_global import _factorised
from stancekit.planners.warp.quadrature import QuadratureGrid, SeparableSolver
from stancekit.planners.warp.report import conformal_error, least_determinant
from tests.refusals import assert_names, refuses


@pytest.mark.parametrize("name", ["ripple", "cone", "hill", "pit"])
def test_the_fast_map_is_injective_and_exact_at_the_ground(name):
    field = named_terrain(name)
    fit = fit_map(field)
    rng = np.random.default_rng(0)
    at = rng.uniform([-4.0, -4.0, 0.0], [4.0, 4.0, 2.3], (8_000, 3))
    at[:4_000, 2] = 0.0
    point, jacobian = fit.map.points_and_jacobians(at)
    least = np.linalg.det(jacobian).min()
    assert least > 0.05
    assert fit.report.least_det < least + 0.02
    assert np.abs(point[:4_000, 2] - field.height(point[:4_000, :2])).max() < 1e-3
    assert fit.report.match_m[0] < 1e-3
    assert fit.report.unsnapped_m[0] > 2.0 * fit.report.match_m[0]
    assert np.all(np.abs(point[:, :2]) <= 4.0 + 1e-9)
    fit.map.check_fits(field)


def test_flat_ground_stays_as_it_is():
    level = HeightField.from_function(lambda x, y: 0.0 * x + 0.4)
    warp = flatten(level, cells=(8, 8, 3))
    at = np.random.default_rng(0).uniform([-4, -4, 0], [4, 4, 2.3], (200, 3))
    at[:50, 2] = 0.0
    moved = warp.points(at) - at
    np.testing.assert_allclose(moved[:50, 2], 0.4, atol=1e-6)
    assert np.abs(moved[:, :2]).max() < 0.01
    assert conformal_error(warp).max() < 0.01


def test_the_conformal_error_of_a_shear_is_the_closed_form():
    """J = [[1, 0, 0], [0, 1, 0], [a, 0, 1]] has σ = √(1 + a²/4) ± a/2 and 1."""
    slope = 0.5
    ramp = HeightField.from_function(lambda x, y: slope * x)
    grid_map = flatten(ramp, cells=(6, 6, 3))
    control = np.stack(
        np.meshgrid(
            *(np.linspace(*ends) for ends in ((-4 - 4 / 3, 4 + 4 / 3, 9),) * 2),
            [0.0],
            indexing="ij",
        )
    )
    control = np.concatenate(
        [control + np.array([0, 0, z]).reshape(3, 1, 1, 1) for z in 2.3 / 3 * np.arange(-1, 5)],
        axis=3,
    )
    control[2] += slope * control[0]
    shear = type(grid_map)(domain_m=ramp.domain_m, height_m=2.3, control_m=control)
    root, half = np.sqrt(1.0 + slope**2 / 4.0), slope / 2.0
    np.testing.assert_allclose(
        conformal_error(shear), 1.0 - (root - half) / (root + half), atol=1e-9
    )
    assert least_determinant(shear)[0] == pytest.approx(1.0)
    assert conformal_error(grid_map).mean() < 0.8 * conformal_error(shear).mean()


def test_published_methods_are_reported_as_they_come_out_also_folded():
    hill = reference_terrain("hill")
    folded = fit_map(hill, cells=(12, 12, 4), method="local-global", iterations=15)
    assert folded.report.least_det < 0.0
    held = fit_map(hill, cells=(12, 12, 4), method="gauss-newton", iterations=10)
    assert held.report.least_det > 0.0
    assert held.map.snap is None
    assert held.report.match_m[0] > 0.005


def test_the_same_map_comes_out_twice():
    first, second = (flatten(reference_terrain("cone"), cells=(10, 10, 3)) for _ in range(2))
    np.testing.assert_array_equal(first.control_m, second.control_m)


def test_where_no_optimised_map_will_do_there_is_a_shear_and_a_report_that_says_so(monkeypatch):
    monkeypatch.setattr(conformal, "DET_FLOOR", 2.0)
    field = HeightField.from_function(
        lambda x, y: 0.1 * np.sin(3.0 * x) * np.cos(2.0 * y), 2.0, 0.1
    )
    fit = fit_map(field, cells=(8, 8, 3))
    assert_names(fit.report.message, "shear")
    assert fit.report.least_det == pytest.approx(1.0, abs=0.01)
    assert fit.report.match_m[0] < 1e-3


def test_reports_are_json_with_distributions():
    report = fit_map(reference_terrain("ripple"), cells=(12, 12, 3)).report
    record = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert record["iterations"] == len(report.energy) - 1
    assert (
        record["ground_error"]["median"]
        <= record["ground_error"]["p95"]
        <= record["ground_error"]["max"]
    )
    assert np.all(np.diff(report.energy[:, 0]) < 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"cells": (8, 8, 2), "method": "gauss-newton"},
            "cells",
        ),
        ({"cells": (1, 8, 3)}, "cells"),
        ({"cells": (150, 150, 50)}, "cells"),
        ({"height_m": 0.0}, "height_m"),
    ],
)
def test_bad_grids_are_refused(options, message):
    with refuses(message):
        fit_map(reference_terrain("ripple"), **options)


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
