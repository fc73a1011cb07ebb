"""Footholds of noisy heights end at steps, strips are found, and each says how sure it is."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
import shapely

from stancekit.planners.terrain.correlation import GroundCells
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, TerrainPatch, footholds_of
from stancekit.planners.terrain.map_footholds import _inner
from stancekit.planners.terrain.patch import FOUND_SD_M, Certainty
from stancekit.planners.terrain.polygon import surface_patch
from tests.refusals import refuses

EDGES = (0.35, 0.65)


def steps(x):
    """Heights of two steps of 6 cm."""
    return 0.06 * (x > EDGES[0]) + 0.06 * (x > EDGES[1])


def noisy_steps(noise_m, seed=5):
    rng = np.random.default_rng(seed)
    x_m, y_m = np.arange(-1.0, 2.0, 0.02), np.arange(-0.9, 0.9, 0.02)
    heights = steps(x_m)[:, None] + rng.normal(0.0, noise_m, (len(x_m), len(y_m)))
    return ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="steps")


def cloud_of_steps(noise_m, count=60_000):
    rng = np.random.default_rng(5)
    points = np.column_stack(
        [rng.uniform(-1.0, 2.0, count), rng.uniform(-0.9, 0.9, count), np.zeros(count)]
    )
    points[:, 2] = steps(points[:, 0]) + rng.normal(0.0, noise_m, count)
    return ElevationMap.of_points(points, 0.02, "cloud")


@pytest.mark.parametrize("ground", [noisy_steps(0.02), noisy_steps(0.03), cloud_of_steps(0.02)])
def test_no_foothold_lies_over_a_step_of_twice_the_noise(ground):
    found = footholds_of(ground, FootholdLimits())
    assert found.noise_m == pytest.approx(0.03 if found.noise_m > 0.025 else 0.02, rel=0.05)
    assert found.area_m2 > 3.0
    for piece in found.pieces:
        corners = piece.patch.vertices_m
        assert len(np.unique(np.searchsorted(EDGES, corners[:, 0]))) == 1
        assert np.abs(corners[:, 2] - steps(corners[:, 0])).max() < 0.02
        assert piece.slope_rad < 0.09


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_a_beam_of_three_samples_is_found_beside_a_drop(noise_m):
    x_m, y_m = np.arange(-1.0, 1.001, 0.05), np.arange(-0.6, 0.601, 0.05)
    heights = np.where(np.abs(y_m) < 0.075, 0.0, -0.3) * np.ones((len(x_m), 1))
    heights = heights + np.random.default_rng(1).normal(0.0, noise_m, heights.shape)
    found = footholds_of(ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="beam"))
    on_beam = [piece for piece in found.pieces if piece.patch.centre_m[2] > -0.1]
    assert sum(piece.area_m2 for piece in on_beam) > 0.05
    assert all(np.abs(piece.patch.vertices_m[:, 1]).max() < 0.055 for piece in on_beam)
    assert found.refused_m2["rough"] < 0.02


def test_strips_too_narrow_for_samples_are_not_called_rough():
    x_m, y_m = np.arange(-1.0, 1.001, 0.05), np.arange(-0.6, 0.601, 0.05)
    heights = np.where((np.abs(y_m) < 0.01) | (y_m > 0.2), 0.0, -0.3) * np.ones((len(x_m), 1))
    found = footholds_of(ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="bar"))
    assert found.refused_m2["small"] == pytest.approx(0.05 * 2.05, rel=0.1)
    assert found.refused_m2["rough"] < 0.01


def test_planes_of_wide_surfaces_are_off_by_what_they_say_and_noise_parts_none():
    standard = list[float]()
    for noise_m, seed in product((0.01, 0.02, 0.03), range(40, 44)):
        found = footholds_of(noisy_steps(noise_m, seed))
        assert len({piece.surface for piece in found.pieces}) <= 4
        for place in np.array([[-0.3, 0.2], [0.5, 0.0], [1.3, 0.2]]):
            level = np.searchsorted(EDGES, place[0])
            its = [
                piece
                for piece in found.pieces
                if np.searchsorted(EDGES, piece.patch.centre_m[0]) == level
            ]
            patch = max(its, key=lambda piece: piece.area_m2).patch
            off = patch.vertices_m[0] - [*place, steps(place[0])]
            standard.append(
                off @ patch.normal / patch.normal[2] / patch.certainty.height_sd_m(place)
            )
    assert 0.5 < np.sqrt(np.mean(np.square(standard))) < 1.3  # a piece counts what it may hide, too
    assert np.abs(standard).max() < 3.5


def test_noise_is_estimated_and_what_is_exact_has_none():
    assert GroundCells.of_map(noisy_steps(0.0)).noise_m() < 1e-9
    for noise_m in (0.005, 0.02):
        assert GroundCells.of_map(noisy_steps(noise_m)).noise_m() == pytest.approx(
            noise_m, rel=0.05
        )
    told = footholds_of(noisy_steps(0.02), FootholdLimits(noise_m=0.025))
    assert (told.noise_m, told.noise_source) == (0.025, "as given")
    assert all(
        piece.height_sd_m is None
        for exact in (noisy_steps(0.0), cloud_of_steps(0.0))
        for piece in footholds_of(exact).pieces
    )


def test_noise_with_which_nothing_is_known_a_map_of_one_row_and_a_cloud_of_one_point_are_refused_in_a_line():
    with refuses("steps", "noise_m"):
        footholds_of(noisy_steps(0.02), FootholdLimits(noise_m=5.0))
    assert footholds_of(noisy_steps(0.02), FootholdLimits(noise_m=0.03)).pieces
    with refuses("row", "x_m"):
        ElevationMap.of_heights(np.zeros((1, 60)), 0.02, "row")
    with refuses("one", "spacing_m"):
        ElevationMap.of_points(np.zeros((1, 3)), 0.02, "one")


@pytest.mark.parametrize("entry", [(0, 0, -1e-4), (1, 1, -1e-4), (0, 1, 1e-4)])
def test_a_covariance_that_is_none_is_refused(entry):
    i, j, value = entry
    covariance = np.diag([1e-6, 1e-6, 1e-6])
    assert Certainty(about_m=[0.0, 0.0], covariance=covariance).tilt_sd_rad == pytest.approx(1e-3)
    covariance[i, j] = value
    with refuses("covariance"):
        Certainty(about_m=[0.0, 0.0], covariance=covariance)


def test_a_low_slab_on_a_coarse_grid_is_no_part_of_the_floor_around_it():
    x, y = np.arange(-1.0, 1.4, 0.05), np.arange(-0.8, 0.8, 0.05)
    slab = (np.abs(x) < 0.26)[:, None] & (np.abs(y) < 0.21)
    for seed in range(8):
        noise = 0.02 * np.random.default_rng(seed).standard_normal(slab.shape)
        drawn = ElevationMap(x_m=x, y_m=y, heights_m=np.where(slab, 0.03, 0.0) + noise, name="slab")
        for piece in footholds_of(drawn).pieces:
            if np.all(np.abs(piece.patch.centre_m[:2]) < [0.2, 0.15]):
                off = abs(piece.patch.centre_m[2] - 0.03)
                assert off < min(3.9 * piece.height_sd_m, 0.02)


def test_points_of_the_next_step_in_the_outermost_cells_of_a_dense_cloud_refuse_no_step():
    rng = np.random.default_rng(3)
    places = rng.uniform([-0.4, -0.3], [0.5, 0.3], (140_000, 2))
    step = np.floor(places[:, 0] / 0.3)
    points = np.column_stack([places, 0.08 * step + 0.02 * rng.standard_normal(len(places))])
    found = footholds_of(ElevationMap.of_points(points, 0.01, "stairs"))
    levels = {round(float(piece.patch.centre_m[2]) / 0.08) for piece in found.pieces}
    assert levels >= {-1, 0}


def test_the_part_of_a_piece_whose_ground_feet_find_is_known_well_enough_and_whole_where_it_is():
    square = [[-0.4, -0.4, 0.08], [0.4, -0.4, -0.08], [0.4, 0.4, -0.08], [-0.4, 0.4, 0.08]]
    patch = surface_patch(np.array(square), 0.8)
    for slope_sd, share in ((0.0, 1.0), (0.02, 0.331), (0.2, 0.00331)):
        covariance = np.array([[1e-5, 0.0, 0.0], [0.0, slope_sd**2, 0.0], [0.0, 0.0, slope_sd**2]])
        sure = Certainty(about_m=np.array([0.1, 0.0]), covariance=covariance, rough_m=0.002)
        whole = TerrainPatch(patch=patch.with_certainty(sure), rms_m=0.01, samples=9, surface=0)
        part = whole.found
        corners = part.patch.vertices_m
        assert np.all(sure.height_sd_m(corners[:, :2]) <= FOUND_SD_M + 1e-9)
        np.testing.assert_allclose(corners[:, 2], -0.2 * corners[:, 0], atol=1e-12)
        assert part.area_m2 == pytest.approx(share * whole.area_m2, rel=0.04)
        assert (part.area_m2 == pytest.approx(whole.area_m2)) == (slope_sd == 0.0)
    assert replace(whole, patch=patch.with_certainty(replace(sure, rough_m=0.007))).found is None
    assert replace(whole, patch=patch).found.patch is patch


@pytest.mark.parametrize("inset", [0.5, 1.0])
def test_an_outline_round_a_hole_is_made_simpler_so_far_inside_of_itself(inset):
    ring = shapely.Point(0.0, 0.0).buffer(85.0).difference(shapely.Point(0.0, 0.0).buffer(40.0))
    assert shapely.distance(ring.boundary, _inner(ring, inset)) >= inset - 1e-9


def cloud_of(surfaces, spacing_m, regular, rng):
    """Points on surfaces (polygon, slope along x and y, height) within ±0.8 m by ±0.5 m."""
    places = rng.uniform([-0.8, -0.5], [0.8, 0.5], (round(1.6 / spacing_m**2), 2))
    if regular:
        lines = (np.arange(-half + 0.003, half, spacing_m) for half in (0.8, 0.5))
        places = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    points = [
        np.column_stack([on, on @ plane[:2] + plane[2]])
        for polygon, plane in surfaces
        for on in [places[shapely.contains_xy(polygon, places)]]
    ]
    return ElevationMap.of_points(np.concatenate(points), 0.05, "cloud")


def strips(edges, planes, angle):
    box = shapely.box(-0.8, -0.5, 0.8, 0.5)
    turned = (
        shapely.affinity.rotate(shapely.box(a, -2.0, b, 2.0), angle, origin=(0.0, 0.0))
        for a, b in pairwise(edges)
    )
    return [(box & strip, plane) for strip, plane in zip(turned, planes, strict=True)]


def without(circles, radius_m, angle):
    """A rectangle without circles of this radius, turned."""
    rest = shapely.box(-0.45, -0.3, 0.45, 0.3).difference(
        shapely.MultiPoint(circles).buffer(radius_m)
    )
    return shapely.affinity.rotate(rest, angle, origin=(0.0, 0.0))


@pytest.mark.parametrize("angle", [0, 30, 90])
@pytest.mark.parametrize("regular", [False, True])
@pytest.mark.parametrize("ground", ["stairs", "slope", "ridge", "slot", "pit", "bays", "holes"])
def test_exact_clouds_give_the_ground_between_their_points_and_no_other(ground, regular, angle):
    level, gap = [0.0, 0.0, 0.0], [-2.0, -0.025, 0.025, 2.0]
    rise = 0.2 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), -0.04])
    surfaces = {
        "stairs": strips(
            0.3 * np.arange(-5, 6) + 0.04, [[0, 0, 0.1 * k] for k in range(10)], angle
        ),
        "slope": strips([-2.0, 2.0], [[0.2, 0.1, 0.0]], angle),
        "ridge": strips([-2.0, 0.04, 2.0], [rise, -rise], angle),
        "slot": strips(gap, [level] * 3, angle),
        "pit": strips(gap, [level, [0.0, 0.0, -0.15], level], angle),
        "bays": [
            (
                without([(-0.2, 0.3), (0.2, 0.3), (0.45, 0.0)], 0.035 if regular else 0.05, angle),
                level,
            )
        ],
        "holes": [(without([(-0.2, 0.0), (0.1, 0.1), (0.3, -0.1)], 0.035, angle), level)],
    }[ground]
    if ground == "slot":
        del surfaces[1]
    found = footholds_of(
        cloud_of(surfaces, 0.013, regular, np.random.default_rng(7)), FootholdLimits(margin_m=0.02)
    )
    kept = 0.0
    for polygon, (a, b, c) in surfaces:
        its = [
            shapely.Polygon(corners[:, :2])
            for piece in found.pieces
            for corners in [piece.patch.vertices_m]
            if polygon.contains(shapely.Point(piece.patch.centre_m[:2]))
            and np.abs(corners[:, :2] @ [a, b] + c - corners[:, 2]).max() < 1e-4
        ]
        assert shapely.union_all(its).difference(polygon.buffer(-0.018)).area < 1e-5
        kept += shapely.union_all(its).area
    inset = sum(polygon.buffer(-0.02, join_style="mitre").area for polygon, _ in surfaces)
    least = 0.9 if regular or ground in ("slot", "pit") else 0.95
    assert kept > (0.7 if ground in ("bays", "holes") else least) * inset
    assert len(found.pieces) >= sum(polygon.area > 0.1 for polygon, _ in surfaces)
