"""What patches are as bodies: a block that is not convex has an inside, by its winding number."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Ground, Obstacles
from stancekit.planners.terrain.patch import THICKNESS_M
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


SQUARES = ((0, 0), (1, 0), (0, 1))
"""Of an L, by their lower corners."""


def ell() -> list[Patch]:
    """The 14 faces of an L of three cubes of 1 m."""
    found = []
    for x, y in SQUARES:
        middle = np.array([x + 0.5, y + 0.5, 0.5])
        for axis in range(3):
            for sign in (-1.0, 1.0):
                normal = sign * np.eye(3)[axis]
                beside = tuple((np.array([x, y]) + normal[:2]).astype(int).tolist())
                if axis < 2 and beside in SQUARES:
                    continue  # two cubes meet
                a, b = (0.5 * np.eye(3)[k] for k in range(3) if k != axis)
                corners = middle + 0.5 * normal + np.array([-a - b, a - b, a + b, b - a])
                shear = np.eye(3)[(axis + 1) % 3]
                found.append(
                    Patch(vertices_m=corners, normal=normal, shear_reference=shear, friction=0.7)
                )
    return found


def test_a_block_that_is_not_convex_is_a_closed_surface_of_prisms() -> None:
    patches = ell()
    assert len(patches) == 14
    obstacles = Obstacles.of(patches)
    (surface,) = obstacles.closed
    assert surface.name == "the body of patches 0 to 13"
    assert len(obstacles.convex) == 14
    assert surface.triangles_m.shape == (28, 3, 3)


def test_the_winding_number_knows_inside_from_outside() -> None:
    (surface,) = Obstacles.of(ell()).closed
    points = np.random.default_rng(3).uniform([-0.5, -0.5, -0.5], [2.5, 2.5, 1.5], size=(400, 3))
    inside = [
        0.0 < z < 1.0 and any(x < px < x + 1 and y < py < y + 1 for x, y in SQUARES)
        for px, py, z in points.tolist()
    ]
    assert 20 < sum(inside) < 200
    np.testing.assert_array_equal(surface.holds(points), inside)
    notch = np.array([[1.5, 1.5, 0.5]])  # within the box of the surface, not within it
    assert not surface.holds(notch).any()


def test_depth_is_to_the_nearest_plane_in_front_of_which_nothing_is() -> None:
    (surface,) = Obstacles.of(ell()).closed
    for depth in (THICKNESS_M + 0.01, 0.2, 0.4):
        assert surface.depth(np.array([0.5, 0.5, 1.0 - depth])) == pytest.approx(depth, abs=1e-12)


def test_a_surface_that_is_open_or_turned_inside_out_holds_nothing() -> None:
    patches = ell()
    assert Obstacles.of(patches[:-1]).closed == ()
    turned = [
        Patch(
            vertices_m=p.vertices_m,
            normal=-p.normal,
            shear_reference=p.shear_reference,
            friction=0.7,
        )
        for p in patches
    ]
    assert Obstacles.of(turned).closed == ()
