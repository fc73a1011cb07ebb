"""Solids of maps and clouds: what was drawn is found, ground is none, and what hangs over it may be
walked below.
"""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of
from stancekit.planners.terrain.map_solids import Overhead, box_patches, covered, standing_boxes
from stancekit.planners.terrain.obstacles import Obstacles

SPACING_M = 0.05


def faces(x0, x1, y0, y1, z0, z1, rng, dense=1500.0):
    """Points of the surface of a box, so many per square metre, shape (K, 3)."""
    low, high, found = np.array([x0, y0, z0]), np.array([x1, y1, z1]), []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for end in (low, high):
            points = rng.uniform(low, high, (max(8, int(dense * np.prod((high - low)[others]))), 3))
            points[:, axis] = end[axis]
            found.append(points)
    return np.concatenate(found)


def cloud(*boxes, noise_m=0.0):
    """A floor of 4 × 3 m, and boxes."""
    rng = np.random.default_rng(7)
    floor = np.column_stack([rng.uniform([0, 0], [4, 3], (18_000, 2)), np.zeros(18_000)])
    points = np.concatenate([floor, *(faces(*box, rng) for box in boxes)])
    return points + noise_m * rng.standard_normal(points.shape)


def heights(*boxes):
    """The same as a map."""
    x, y = SPACING_M * np.arange(81), SPACING_M * np.arange(61)
    z = np.zeros((81, 61))
    for x0, x1, y0, y1, _, z1 in boxes:
        z[np.ix_((x >= x0) & (x <= x1), (y >= y0) & (y <= y1))] = z1
    return ElevationMap(x_m=x, y_m=y, heights_m=z, name="drawn")


def inside(boxes, points):
    """Which points are in a box."""
    low, high = boxes[:, None, ::2], boxes[:, None, 1::2]
    return np.any(np.all((points > low) & (points < high), axis=2), axis=0)


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_level_ground_steps_and_ramps_have_no_solids(noise_m):
    rng = np.random.default_rng(3)
    steps = 0.17 * np.floor(np.arange(81) / 6)[:, None] + np.zeros(61)
    ramp = 0.6 * SPACING_M * np.arange(81)[:, None] + np.zeros(61)
    for ground in (np.zeros((81, 61)), steps, ramp):
        measured = heights().heights_m + ground + noise_m * rng.standard_normal(ground.shape)
        found = standing_boxes(
            ElevationMap(x_m=heights().x_m, y_m=heights().y_m, heights_m=measured, name="ground"),
            noise_m,
        )
        assert len(found) == 0


@pytest.mark.parametrize("box", [(1.0, 1.06, 1.0, 1.06, 0.0, 1.2), (1.0, 1.04, 0.5, 2.5, 0.0, 0.5)])
def test_poles_and_thin_walls_are_solid_to_the_ground(box):
    found = standing_boxes(heights(box), 0.0)
    middle = np.array([0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])])
    line = np.column_stack([np.tile(middle, (20, 1)), np.linspace(0.02, box[5] - 0.03, 20)])
    assert inside(found, line).all()
    assert not inside(found, line + np.array([0.12, 0.0, 0.0])).any()


def test_a_wide_block_has_sides_and_its_top_stays_free_for_feet():
    box = (1.0, 2.0, 1.0, 2.0, 0.0, 0.8)
    found = standing_boxes(heights(box), 0.0)
    around = [(x, y) for x in (1.0, 2.0) for y in np.linspace(1.0, 2.0, 15)]
    around += [(y, x) for x, y in around]
    assert inside(found, np.array([(x, y, z) for x, y in around for z in (0.05, 0.4, 0.75)])).all()
    assert found[:, 5].max() <= 0.8 - 0.009


def test_what_hangs_over_a_cloud_is_found_with_its_ground_below():
    bar = (1.5, 1.6, 0.0, 3.0, 0.7, 0.8)
    over = Overhead.of(cloud(bar), SPACING_M)
    assert over is not None
    line = np.column_stack([np.full(40, 1.55), np.linspace(0.1, 2.9, 40), np.full(40, 0.75)])
    assert inside(over.boxes_m, line).all()
    assert not inside(over.boxes_m, line - np.array([0.0, 0.0, 0.1])).any()
    assert over.ground_m[:, 2].max() == 0.0
    found = footholds_of(ElevationMap.of_points(cloud(bar), SPACING_M, "cloud"))
    below = [
        p
        for p in found.pieces
        if abs(p.patch.centre_m[2]) < 0.01
        and p.patch.vertices_m[:, 0].min() < 1.4
        and p.patch.vertices_m[:, 0].max() > 1.7
    ]
    assert below, "footholds go through below the bar"


def test_walls_of_a_cloud_hang_over_nothing_and_single_points_are_noise():
    wall = (1.5, 1.7, 0.0, 3.0, 0.0, 1.0)
    over = Overhead.of(cloud(wall), SPACING_M)
    hung = np.zeros((0, 6)) if over is None else over.boxes_m
    assert not inside(hung, np.array([[1.52, 1.5, 0.5], [1.68, 1.5, 0.5]])).any()
    stray = np.array([[0.5, 0.5, 1.0], [2.0, 2.0, -0.8], [3.0, 1.0, 0.6]])
    assert Overhead.of(np.concatenate([cloud(), stray]), SPACING_M) is None


def test_a_room_is_walked_on_its_floor():
    roof = (0.0, 4.0, 0.0, 3.0, 2.0, 2.1)
    found = footholds_of(ElevationMap.of_points(cloud(roof), SPACING_M, "room"))
    assert found.pieces
    assert all(piece.patch.centre_m[2] < 0.05 for piece in found.pieces)


def test_boxes_cover_their_cells_and_nothing_far_off_and_are_bodies():
    rng = np.random.default_rng(11)
    top = np.where(rng.random((30, 30)) < 0.3, rng.choice([0.5, 0.6, 1.0], (30, 30)), -np.inf)
    bottom = np.where(np.isfinite(top), 0.0, np.inf)
    boxes = covered(bottom, top, np.zeros(2), SPACING_M)
    i, j = np.nonzero(np.isfinite(top))
    middles = np.column_stack([SPACING_M * (i + 0.5), SPACING_M * (j + 0.5), top[i, j] - 0.01])
    assert inside(boxes, middles).all()
    bodies = Obstacles.of(box_patches(boxes, 0.7))
    assert len(bodies.convex) == len(boxes)
    assert not bodies.closed


@pytest.mark.parametrize("noise_m", [0.01, 0.02, 0.03])
def test_beams_on_a_noisy_map_are_solid_and_no_box_is_above_their_tops(noise_m):
    x, y = np.arange(-1.0, 1.0, 0.02), np.arange(-0.8, 0.8, 0.02)
    beam = np.mod(y + 2.0, 0.4) < 0.15
    drawn = np.where(beam, 0.0, -0.25) + np.zeros((len(x), 1))
    noisy = drawn + np.random.default_rng(7001).normal(0.0, noise_m, drawn.shape)
    found = footholds_of(ElevationMap(x_m=x, y_m=y, heights_m=noisy, name="beams"))
    corners = np.concatenate([patch.vertices_m for patch in found.surfaces])
    tops = corners[np.abs(corners[:, 2]) < 0.1, 2]
    solid = [patch for patch in found.surfaces if abs(patch.normal[2]) < 0.1]
    assert solid
    assert max(patch.vertices_m[:, 2].max() for patch in solid) < tops.max()
    assert np.ptp(tops) < 0.02


@pytest.mark.parametrize("spacing_m", [0.02, 0.05])
def test_bodies_keep_out_of_all_that_a_surface_between_samples_may_be(spacing_m):
    x, y = np.arange(-1.0, 1.0, spacing_m), np.arange(-0.8, 0.8, spacing_m)
    for edge in np.linspace(0.0, spacing_m, 5)[1:-1]:
        drawn = np.where(x > edge, 0.06, 0.0)[:, None] + np.zeros(len(y))
        found = footholds_of(ElevationMap(x_m=x, y_m=y, heights_m=drawn, name="step"))
        upper = [p.vertices_m for p in found.surfaces if p.vertices_m[:, 2].min() > 0.03]
        border = min(corners[:, 0].min() for corners in upper)
        assert x[x <= edge].max() - 1e-9 <= border <= edge
        on = [p.patch.vertices_m[:, 0].min() for p in found.pieces if p.patch.centre_m[2] > 0.03]
        assert min(on) >= edge + FootholdLimits().inset_m - 1e-9
