"""A foothold is a piece of the terrain, or nothing carries who stands on it."""

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.geometry import off_terrain


def square(z=0.0, friction=0.5, tilt=0.0, half=1.0):
    c, s = np.cos(tilt), np.sin(tilt)
    corners = (
        half
        * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    )
    normal = np.array([0.0, -s, c])
    return Patch(
        vertices_m=corners + np.array([0, 0, z]),
        normal=normal,
        shear_reference=[1, 0, 0],
        friction=friction,
    )


@pytest.mark.parametrize(
    ("toe", "off"),
    [
        ([0, 0, 0], 0.0),
        ([0, 0, 9e-4], 0.0),
        ([0, 0, -0.101], 0.1),
        ([1.301, 0, 0], 0.3),
        ([4, 5, 0], 4.999),
    ],
)
def test_distance_from_a_square_in_closed_form(toe, off):
    found = off_terrain(
        [square(), square(z=-50.0)], [square(half=9.0)], np.array([toe], dtype=float)
    )
    assert found == pytest.approx([off], abs=1e-12)


@pytest.mark.parametrize(
    "terrain",
    [[], [square(friction=0.4)], [square(tilt=0.03)], [square(tilt=np.pi)]],
    ids=["none", "slick", "tilted", "below"],
)
def test_terrain_that_is_slicker_or_faces_elsewhere_does_not_carry(terrain):
    assert np.isinf(off_terrain(terrain, [square()], np.zeros((1, 3))))


def test_a_plan_whose_terrain_is_elsewhere_is_refused(walk):
    plan = walk()
    assert check_plan(plan).accepted
    moved = tuple(
        patch.with_vertices(patch.vertices_m + np.array([50.0, 0.0, 0.0]))
        for patch in plan.problem.terrain
    )
    report = check_plan(replace(plan, problem=replace(plan.problem, terrain=moved)))
    worst = max(report.groups, key=lambda group: group.worst)
    assert not report.accepted
    assert worst.name == "terrain"
    assert 40.0 < worst.value < 60.0
