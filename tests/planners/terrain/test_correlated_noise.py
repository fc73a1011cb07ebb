"""Noise that is correlated over a few centimetres is told from white noise, and footholds on it say
how sure they are.
"""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from stancekit.planners.terrain.correlation import GroundCells, correlated_noise
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of

LENGTH_M = 0.05


def treads(x_m):
    """Heights of treads of 30 cm, 8 cm high each."""
    return 0.08 * np.floor(x_m / 0.3)


def stairs(noise_m, spacing_m=0.02, length_m=LENGTH_M, seed=3):
    rng = np.random.default_rng(seed)
    x_m, y_m = np.arange(-1.0, 1.4, spacing_m), np.arange(-0.8, 0.8, spacing_m)
    noise = rng.standard_normal((len(x_m), len(y_m)))
    if length_m:
        noise = gaussian_filter(noise, 0.5 * length_m / spacing_m)
    heights = treads(x_m)[:, None] + noise_m * noise / noise.std()
    return ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="stairs")


def cloud(noise_m, count=30_000):
    rng = np.random.default_rng(3)
    field = gaussian_filter(rng.standard_normal((2400, 1600)), 0.5 * LENGTH_M / 0.001)
    points = np.column_stack([rng.uniform([-1.0, -0.8], [1.4, 0.8], (count, 2)), np.zeros(count)])
    i, j = ((points[:, :2] + [1.0, 0.8]) / 0.001).astype(int).T
    points[:, 2] = treads(points[:, 0]) + noise_m * field[i, j] / field.std()
    return ElevationMap.of_points(points, 0.02, "cloud")


def errors_in_deviations(found):
    """Distances of corners off the true tread, in deviations."""
    each = []
    for piece in found.pieces:
        corners = piece.patch.vertices_m
        off = corners[:, 2] - treads(piece.patch.centre_m[0])
        each.append(off / piece.patch.certainty.height_sd_m(corners[:, :2]))
    return np.abs(np.concatenate(each))


@pytest.mark.parametrize(
    ("made", "numbers"),
    [(stairs, (0.01,)), (stairs, (0.02,)), (stairs, (0.02, 0.01)), (cloud, (0.02,))],
)
def test_footholds_on_correlated_noise_are_found_and_less_than_three_deviations_off(made, numbers):
    found = footholds_of(made(*numbers))
    true_m = 0.01 if found.noise_m < 0.015 else 0.02
    assert found.noise_m == pytest.approx(true_m, rel=0.5)
    assert found.noise_length_m == pytest.approx(LENGTH_M, rel=0.4)
    assert found.area_m2 > 2.0
    assert np.mean(errors_in_deviations(found) > 3.0) < 0.01
    assert "correlated over" in found.noise_source
    assert "bumps" in found.noise_source


def test_noise_that_is_told_is_no_bumps_and_its_planes_are_off_by_what_they_say():
    told, untold = (
        footholds_of(stairs(0.01), FootholdLimits(noise_m=0.01)),
        footholds_of(stairs(0.01)),
    )
    assert told.noise_length_m == pytest.approx(LENGTH_M, rel=0.4)
    assert "bumps" not in told.noise_source
    assert 0.3 < np.sqrt(np.mean(errors_in_deviations(told) ** 2)) < 1.6
    assert max(p.patch.certainty.rough_m for p in told.pieces) < 0.004
    assert min(p.patch.certainty.rough_m for p in untold.pieces) > 0.006


@pytest.mark.parametrize("step_m", [0.018, 0.03])
def test_a_step_lower_than_the_noise_is_under_no_foothold(step_m):
    x_m, y_m = np.arange(-0.8, 0.8, 0.02), np.arange(-0.6, 0.6, 0.02)
    noise = gaussian_filter(np.random.default_rng(5).standard_normal((80, 60)), 1.25)
    heights = step_m * (x_m > 0.0)[:, None] + 0.02 * noise / noise.std()
    terrain = ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="step")
    found = footholds_of(terrain, FootholdLimits(noise_m=0.02))
    ends = np.array(
        [(p.patch.vertices_m[:, 0].min(), p.patch.vertices_m[:, 0].max()) for p in found.pieces]
    )
    assert not np.any((ends[:, 0] < -0.01) & (ends[:, 1] > 0.01))
    assert found.area_m2 > 1.0
    for piece in found.pieces:
        corners = piece.patch.vertices_m
        off = np.abs(corners[:, 2] - step_m * (corners[:, 0] > 0.0))
        assert np.all(off < 3.0 * piece.patch.certainty.height_sd_m(corners[:, :2]))


def test_neighbours_say_how_alike_noise_is_that_is_told():
    beams = np.where(np.mod(np.arange(54), 13) < 5, 0.0, -0.25)
    noise = gaussian_filter(
        np.random.default_rng(4).standard_normal((80, 54)), 0.5 * LENGTH_M / 0.03
    )
    noise *= 0.03 / noise.std()
    lines = np.arange(80) * 0.03, np.arange(54) * 0.03
    terrain = ElevationMap(x_m=lines[0], y_m=lines[1], heights_m=beams + noise, name="beams")
    assert footholds_of(terrain, FootholdLimits(noise_m=0.03)).noise_length_m == pytest.approx(
        LENGTH_M, rel=0.3
    )
    white = np.random.default_rng(4).standard_normal((80, 54))
    terrain = ElevationMap(x_m=lines[0], y_m=lines[1], heights_m=beams + 0.03 * white, name="beams")
    assert footholds_of(terrain, FootholdLimits(noise_m=0.03)).noise_length_m == 0.0


def test_what_samples_do_not_show_their_residuals_do():
    told = footholds_of(stairs(0.02, 0.05), FootholdLimits(noise_m=0.02))
    white = footholds_of(stairs(0.02, 0.05, length_m=0.0), FootholdLimits(noise_m=0.02))
    assert told.noise_length_m == pytest.approx(LENGTH_M, rel=0.4)
    assert white.noise_length_m == 0.0
    surest = [min(p.height_sd_m for p in found.pieces) for found in (told, white)]
    assert surest[0] > 1.3 * surest[1]


def test_noise_over_ten_centimetres_may_be_told_as_well():
    found = footholds_of(stairs(0.02, length_m=0.1), FootholdLimits(noise_m=0.02))
    assert found.noise_length_m > 0.06
    assert found.area_m2 > 1.0


def test_ground_that_is_told_to_be_exact_is_taken_as_it_is():
    found = footholds_of(stairs(0.01), FootholdLimits(noise_m=0.0))
    assert found.noise_length_m == 0.0
    assert found.noise_m == 0.0
    assert not any(piece.patch.certainty.covariance.any() for piece in found.pieces)


@pytest.mark.parametrize("spacing_m", [0.01, 0.02, 0.03, 0.05])
@pytest.mark.parametrize("noise_m", [0.0, 0.004, 0.01, 0.03])
def test_white_noise_is_not_taken_for_correlated(noise_m, spacing_m):
    assert correlated_noise(GroundCells.of_map(stairs(noise_m, spacing_m, length_m=0.0))) is None


def test_hills_are_no_noise():
    x_m = np.arange(0.0, 1.6, 0.02)
    hills = 0.05 * np.sin(2.0 * np.pi * x_m / 0.6)[:, None] * np.cos(2.0 * np.pi * x_m / 0.5)
    found = footholds_of(ElevationMap(x_m=x_m, y_m=x_m, heights_m=hills, name="hills"))
    assert found.noise_length_m == 0.0
    assert found.noise_m < 1e-3
    assert not any(piece.patch.certainty.covariance.any() for piece in found.pieces)
