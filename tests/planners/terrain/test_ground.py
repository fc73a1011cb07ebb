"""Ground that is given by heights: what is in it, and how deep."""

import numpy as np
import pytest

from stancekit.planners.terrain.obstacles import Ground
from stancekit.planners.terrain.reference import reference_terrain


@pytest.mark.parametrize("name", ["ripple", "hill", "pit"])
def test_the_depth_of_points_that_are_inside_is_their_depth(name):
    ground = Ground(heights=reference_terrain(name))
    (x0, x1), (y0, y1) = ground.heights.domain_m
    rng = np.random.default_rng(3)
    xy = rng.uniform([x0, y0], [x1, y1], (4000, 2))
    points = np.column_stack([xy, ground.heights.height(xy) + rng.normal(0.0, 0.1, 4000)]).reshape(
        50, 80, 3
    )
    depth, inside = ground.depth(points), ground.depth_inside(points)
    assert 1000 < np.count_nonzero(depth > 0.0) < 3000
    assert np.array_equal(inside, np.where(depth > 0.0, depth, -np.inf))


def test_no_point_of_the_ground_is_above_the_control_points_about_it():
    ground = Ground(heights=reference_terrain("pit"))
    line = np.linspace(-3.0, 3.0, 301)
    xy = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    just_below = np.concatenate([xy, ground.heights.height(xy)[..., None] - 1e-9], axis=-1)
    assert np.isfinite(ground.depth_inside(just_below)).all()
