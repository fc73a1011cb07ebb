"""Spline maps: derivatives, the straight continuation, the inverse, the snap, and the file."""

import time

import numpy as np
import pytest

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.warp.quadrature import QuadratureGrid
from stancekit.planners.warp.spline_map import SplineMap, fading
from tests.refusals import refuses

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
        began = time.process_time()
        again = SplineMap.from_file(tmp_path / "map.npz")
        assert time.process_time() - began < 0.5
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
