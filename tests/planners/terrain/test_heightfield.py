"""Height fields: exact derivatives, one surface for numpy and CasADi, and what a grid must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import BSpline, RectBivariateSpline

from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.variables import clamped_knots
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.families import SMOOTH
from stancekit.planners.terrain.heightfield import HeightField, cubics, rows_of
from stancekit.planners.terrain.reference import (
    TERRAINS,
    named_terrain,
    reference_tasks,
    reference_terrain,
)
from tests.refusals import refuses


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("clamped", [False, True])
def test_cubic_splines_and_their_derivatives_are_scipys_to_the_last_bit(order, clamped):
    rng = np.random.default_rng(order)
    for count in (1, 2, 30):
        knots = clamped_knots(count) if clamped else np.sort(rng.normal(size=count + 7))
        x = np.concatenate([rng.uniform(knots[3], knots[-4], 50), knots[3:-3]])
        found = rows_of(*cubics(x, knots, order), len(knots) - 4).toarray()
        wanted = BSpline(knots, np.eye(len(knots) - 4), 3)(x, nu=order)
        np.testing.assert_array_equal(found, wanted)
        assert np.any(wanted != 0.0)


@pytest.fixture(scope="module")
def rough() -> HeightField:
    return named_terrain("rough:0.7:3")


def around(field, count=300, beyond=1.5, seed=0):
    (x0, x1), (y0, y1) = field.domain_m
    rng = np.random.default_rng(seed)
    return rng.uniform([x0 - beyond, y0 - beyond], [x1 + beyond, y1 + beyond], (count, 2))


def test_the_surface_goes_through_every_node(rough):
    grid = np.stack(np.meshgrid(rough.x_m, rough.y_m, indexing="ij"), axis=-1)
    np.testing.assert_allclose(rough.height(grid), rough.heights_m, atol=1e-12)


def test_the_surface_agrees_with_scipys_spline_away_from_the_ends(rough):
    other = RectBivariateSpline(rough.x_m, rough.y_m, rough.heights_m, kx=3, ky=3, s=0)
    at = np.random.default_rng(1).uniform(-3.0, 3.0, (500, 2))
    np.testing.assert_allclose(rough.height(at), other.ev(at[:, 0], at[:, 1]), atol=1e-8)
    np.testing.assert_allclose(
        rough.gradient(at)[:, 0], other.ev(at[:, 0], at[:, 1], dx=1), atol=1e-6
    )


def test_the_gradient_is_the_finite_difference_inside_and_outside(rough):
    at, step = around(rough), 1e-5
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        slope = (rough.height(at + shift) - rough.height(at - shift)) / (2 * step)
        np.testing.assert_allclose(rough.gradient(at)[:, axis], slope, atol=1e-7)


@settings(max_examples=25, deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3), st.floats(0.05, 0.8))
def test_a_plane_stays_that_plane_everywhere_smoothed_or_not(a, b, c, sigma):
    plane = HeightField.from_function(lambda x, y: a * x + b * y + c, 2.0, 0.1)
    at = around(plane, 30, 20.0)
    for field in (plane, plane.smoothed(sigma)):
        np.testing.assert_allclose(field.height(at), at @ [a, b] + c, atol=1e-9)
        np.testing.assert_allclose(field.gradient(at), np.tile([a, b], (30, 1)), atol=1e-9)


def test_normals_are_upward_units_across_the_tangents_and_frames_are_rotations(rough):
    at = around(rough)
    normal, slope, frame = rough.normal(at), rough.gradient(at), rough.frame(at)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-12)
    assert np.all(normal[:, 2] > 0.0)
    for axis in range(2):
        tangent = np.concatenate([np.tile(np.eye(2)[axis], (len(at), 1)), slope[:, [axis]]], axis=1)
        assert np.max(np.abs(np.sum(tangent * normal, axis=1))) < 1e-12
    np.testing.assert_allclose(
        np.swapaxes(frame, 1, 2) @ frame, np.tile(np.eye(3), (len(at), 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-12)
    np.testing.assert_allclose(frame[:, :, 2], normal, atol=1e-12)


def test_smoothing_a_wave_lowers_it_by_the_gaussians_factor():
    k, sigma = 2.0 * np.pi / 1.6, 0.3
    wave = HeightField.from_function(lambda x, y: 0.1 * np.sin(k * x))
    low = wave.smoothed(sigma)
    at = np.stack([np.linspace(-1.0, 1.0, 50), np.zeros(50)], axis=1)
    np.testing.assert_allclose(
        low.height(at), np.exp(-0.5 * (k * sigma) ** 2) * wave.height(at), atol=1e-4
    )


def test_scaled_heights_and_arrays_go_round(rough):
    np.testing.assert_array_equal(rough.scaled(0.25).heights_m, 0.25 * rough.heights_m)
    again = HeightField.from_arrays(rough.to_arrays(), rough.name)
    np.testing.assert_array_equal(again.heights_m, rough.heights_m)
    assert again.domain_m == rough.domain_m == ((-4.0, 4.0), (-4.0, 4.0))


def test_an_uneven_grid_is_interpolated_but_not_smoothed():
    x = np.array([0.0, 0.1, 0.3, 0.7, 1.5, 3.0])
    field = HeightField(x, x, np.add.outer(x, 2.0 * x), "uneven")
    np.testing.assert_allclose(
        field.height(np.array([[1.1, 0.2], [-1.0, 5.0]])), [1.5, 9.0], atol=1e-9
    )
    with refuses("uneven"):
        field.smoothed(0.1)


@pytest.mark.parametrize("name", TERRAINS.names())
def test_reference_splines_hold_their_formulas(name):
    field, formula = reference_terrain(name), TERRAINS.get(name)
    at = np.random.default_rng(2).uniform(-4.0, 4.0, (20_000, 2))
    miss = np.max(np.abs(field.height(at) - formula(at[:, 0], at[:, 1])))
    assert miss < (0.016 if name == "pit-87" else 0.001)
    assert np.allclose(
        np.diff(field.x_m), 0.05 if name in ("ripple", "cone", "hill", "pit") else 0.025
    )


@pytest.mark.parametrize(
    ("name", "degrees"), [("hill", 60), ("pit", 79), ("pit-84", 84), ("pit-87", 87)]
)
def test_walls_are_as_steep_as_they_are_named(name, degrees):
    radii = np.linspace(1.0, 1.6, 4001)
    slope = np.linalg.norm(
        reference_terrain(name).gradient(np.stack([radii, 0.0 * radii], axis=1)), axis=1
    )
    assert np.rad2deg(np.arctan(slope.max())) == pytest.approx(degrees, abs=1.0)


def test_tasks_are_those_of_the_paper():
    assert [len(reference_tasks(name)) for name in ("ripple", "cone", "hill", "pit")] == [
        24,
        24,
        15,
        15,
    ]
    ripple, cone = reference_tasks("ripple"), reference_tasks("cone")
    assert all(
        np.linalg.norm(task.goal) == pytest.approx(2.0) and not any(task.adhesive)
        for task in ripple
    )
    np.testing.assert_allclose(ripple[6].goal, [2.0, 0.0], atol=1e-12)
    assert all(np.allclose(task.start, -task.goal) for task in cone)
    for name in ("hill", "pit"):
        field, tasks = reference_terrain(name), reference_tasks(name)
        assert all(task.adhesive == (True, True, False, False) for task in tasks)
        climbs = [float(field.height(task.goal) - field.height(task.start)) for task in tasks]
        assert min(climbs) > 0.95
        assert len({tuple(task.goal) for task in tasks}) == 15


@pytest.mark.filterwarnings("ignore:.* is what walks had")
@pytest.mark.parametrize("family", SMOOTH)
def test_random_terrains_repeat_by_seed_rise_with_difficulty_and_are_level_at_the_origin(family):
    names = [f"{family}:{difficulty}:5" for difficulty in (0.0, 0.5, 1.0)]
    level, easy, hard = (named_terrain(name) for name in names)
    assert np.ptp(level.heights_m) == 0.0
    assert 0.0 < np.ptp(easy.heights_m) < np.ptp(hard.heights_m)
    np.testing.assert_array_equal(named_terrain(names[2]).heights_m, hard.heights_m)
    assert np.any(named_terrain(f"{family}:1.0:6").heights_m != hard.heights_m)
    assert np.max(np.abs(hard.height(around(hard, 200, -3.6)))) < 1e-3


FOUR, LEVEL = np.arange(4.0), np.zeros((4, 4))
HOLED = np.where(np.eye(5) > 0, np.nan, 0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: HeightField(FOUR[:1], FOUR, LEVEL[:1]),
            "x_m",
        ),
        (
            lambda: HeightField(FOUR, FOUR, LEVEL[:, :3], "t"),
            "heights_m",
        ),
        (
            lambda: HeightField(FOUR[[0, 2, 1, 3]], FOUR, LEVEL),
            "x_m",
        ),
        (
            lambda: HeightField(1e3 * FOUR, FOUR, LEVEL),
            "x_m",
        ),
        (
            lambda: HeightField.from_array(HOLED, name="holed"),
            "heights_m",
        ),
        (lambda: HeightField(FOUR, FOUR, LEVEL, doubts="unsure"), "doubts"),
        (
            lambda: reference_terrain("moon"),
            "terrain",
        ),
        (
            lambda: named_terrain("rough:0.5:x"),
            "terrain",
        ),
        (lambda: named_terrain("rough:2:1"), "level"),
        (
            lambda: named_terrain("walls:0.5:7"),
            "terrain",
        ),
    ],
)
def test_what_is_no_terrain_is_refused_by_one_line(make, message):
    with refuses(message):
        make()


def test_a_function_finer_than_its_spline_says_by_how_many_millimetres():
    with pytest.raises(InvalidInput) as caught:
        HeightField.from_function(lambda x, y: 0.02 * np.sin(2.0 * np.pi * x / 0.12), name="comb")
    words = str(caught.value)
    assert words.startswith("comb: finer than a spline of 50 mm spacing can hold: it misses by ")
    assert 5.0 < float(words.split("misses by ")[1].split(" mm")[0]) < 40.0
    HeightField.from_function(
        lambda x, y: 0.02 * np.sin(2.0 * np.pi * x / 0.12), spacing_m=0.01, name="comb"
    )


def test_rows_of_several_lengths_are_no_heights() -> None:
    with refuses("terrain"):
        HeightField.from_array([[1.0], [2.0, 3.0]])  # type: ignore[arg-type]


def test_heights_so_far_up_that_a_plan_on_them_has_no_numbers_are_refused() -> None:
    for height_m in (1e6, -1e6, 1e300):
        with refuses("far"):
            ElevationMap.of_heights(np.full((9, 9), height_m), 0.05, "far")
