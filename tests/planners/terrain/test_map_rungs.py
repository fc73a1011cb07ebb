"""Round bars of maps are lines to stand on, where their samples lie on a cylinder."""

import numpy as np
import pytest

from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of

LIMITS = FootholdLimits(margin_m=0.012, width_m=0.012)
APART_M, RADIUS_M, DROP_M = 0.12, 0.015, 0.25


def bars(askew_rad=0.0, spacing_m=0.01, noise_m=0.0, seed=0, *, round_bars=True):
    """A map of bars that are 3 cm thick, their tops at z = 0."""
    x, y = np.arange(-0.3, 0.3, spacing_m), np.arange(-0.25, 0.25, spacing_m)
    u = np.add.outer(np.cos(askew_rad) * x, np.sin(askew_rad) * y)
    v = np.mod(u + 0.5 * APART_M, APART_M) - 0.5 * APART_M
    top = np.sqrt(np.maximum(RADIUS_M**2 - v**2, 0.0)) - RADIUS_M if round_bars else 0.0 * v
    heights = np.where(np.abs(v) < RADIUS_M, top, -DROP_M)
    heights += noise_m * np.random.default_rng(seed).standard_normal(heights.shape)
    return ElevationMap(x_m=x, y_m=y, heights_m=heights, name="bars")


def rungs_of(found):
    return [piece for piece in found.pieces if piece.turn_rad > 0.0]


@pytest.mark.parametrize("askew_rad", [0.0, 0.3])
@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_round_bars_of_a_map_are_lines_within_a_millimetre(askew_rad, noise_m):
    found = footholds_of(bars(askew_rad, 0.005, noise_m), LIMITS)
    rungs = rungs_of(found)
    assert len(rungs) >= 4
    for piece in rungs:
        x, y, z = piece.patch.centre_m
        across = np.mod(np.cos(askew_rad) * x + np.sin(askew_rad) * y + 0.06, APART_M) - 0.06
        assert abs(across) < (1e-6 if noise_m == 0.0 else 1e-3)
        assert abs(z) < (1e-6 if noise_m == 0.0 else 2e-3)
        assert piece.turn_rad >= np.arcsin(0.05) - 1e-9
        assert piece.patch.friction < 1.0
        assert (piece.patch.certainty is None) is (noise_m == 0.0)
    assert found.refused_m2["round"] > 0.0
    assert not any(np.ptp(patch.vertices_m[:, 2]) > 0.1 for patch in found.surfaces)  # no walls


def test_flat_bars_and_bars_of_two_samples_are_no_rungs():
    assert not rungs_of(footholds_of(bars(spacing_m=0.005, round_bars=False), LIMITS))
    assert not rungs_of(footholds_of(bars(spacing_m=0.015), LIMITS))


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_flat_strips_make_no_rungs(seed):
    assert not rungs_of(footholds_of(bars(0.2, 0.005, 0.004, seed, round_bars=False), LIMITS))
    x = np.arange(-0.4, 0.4, 0.02)
    noise = 0.01 * np.random.default_rng(seed).standard_normal((len(x), len(x)))
    assert not rungs_of(footholds_of(ElevationMap(x_m=x, y_m=x, heights_m=noise, name="noise")))


@pytest.mark.parametrize("noise_m", [0.0, 0.002])
@pytest.mark.parametrize("known", [True, False])
def test_a_line_ends_where_a_bar_has_a_bite(noise_m, known):
    terrain = bars(0.0, 0.005, noise_m)
    x, y = np.meshgrid(terrain.x_m, terrain.y_m, indexing="ij")
    v = np.mod(x + 0.5 * APART_M, APART_M) - 0.5 * APART_M
    bite = (np.abs(y) < 0.015) & (v > -0.2 * RADIUS_M)  # the rest of the bar goes on beside it
    heights = np.where(bite, -DROP_M if known else np.nan, terrain.heights_m)
    found = footholds_of(
        ElevationMap(x_m=terrain.x_m, y_m=terrain.y_m, heights_m=heights, name="bitten"), LIMITS
    )
    rungs = rungs_of(found)
    assert len(rungs) >= 4
    for piece in rungs:
        low, high = piece.patch.vertices_m[:, 1].min(), piece.patch.vertices_m[:, 1].max()
        assert low > 0.015 or high < -0.015


@pytest.mark.parametrize("noise_m", [0.0, 0.005])
def test_rungs_of_a_dense_cloud_are_lines_as_long_as_they_are(noise_m):
    """Three rungs of 4 cm, 80 cm long, over a floor whose heights are off their plane by rounding alone, or by noise."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform([-0.4, -0.4], [0.4, 0.4], (50_000, 2)).T
    across = np.mod(x + 0.3, 0.2) - 0.1
    top = np.sqrt(np.maximum(0.02**2 - across**2, 0.0)) - 0.02
    z = np.where(np.abs(across) < 0.02, top, -0.3) + noise_m * rng.standard_normal(len(x))
    ground = ElevationMap.of_points(np.column_stack([x, y, z]), 0.01, "cloud")
    rungs = rungs_of(footholds_of(ground, LIMITS))
    assert sorted(round(10.0 * float(rung.patch.centre_m[0])) for rung in rungs) == [-2, 0, 2]
    for rung in rungs:
        assert 0.75 < np.ptp(rung.patch.vertices_m[:, 1]) < 0.8
        assert abs(rung.patch.centre_m[2]) < 1e-3
