"""Workspaces as half-spaces: what is refused, and that the convex sets for plans and for proofs are
what they say.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.equilibrium.scaled import HalfSpaces
from stancekit.planners.files.codec import from_json, to_json
from stancekit.planners.robot.model import Limb, ReachRows, turned_most
from tests.refusals import refuses

CUBE = np.vstack([np.eye(3), -np.eye(3)])


def test_rows_are_made_unit_and_unit_rows_stay_as_they_are():
    rng = np.random.default_rng(0)
    normals, size = rng.normal(size=(7, 3)), rng.uniform(0.1, 9.0, 7)
    unit = normals / np.linalg.norm(normals, axis=1)[:, None]
    first = ReachRows(normals=size[:, None] * unit, bounds_m=size * 0.3)
    np.testing.assert_allclose(first.normals, unit, atol=1e-15)
    np.testing.assert_allclose(first.bounds_m, 0.3, atol=1e-15)
    again = from_json(ReachRows, to_json(first))
    assert np.array_equal(again.normals, first.normals)
    assert np.array_equal(again.bounds_m, first.bounds_m)


@pytest.mark.parametrize(
    ("normals", "bounds", "message"),
    [
        ([[0.0, 0.0, 0.0]], [1.0], "normals[0]"),
        (CUBE, [0.1] * 5, "bounds_m"),
        (
            CUBE,
            [0.1, 0.1, 0.1, -0.2, 0.1, 0.1],
            "bounds_m",
        ),
        (np.zeros((0, 3)), [], "normals"),
        (np.ones((257, 3)), np.ones(257), "normals"),
    ],
)
def test_bad_rows_are_refused_in_one_line(normals, bounds, message):
    with refuses(message):
        ReachRows(normals=normals, bounds_m=bounds)


def test_sets_need_not_be_bounded_nor_hold_the_origin():
    assert len(ReachRows(normals=[[0.0, 0.0, -2.0]], bounds_m=[-0.6]).bounds_m) == 1


def test_the_largest_turn_of_a_vector_is_that_of_many_rotations_and_is_met():
    rng = np.random.default_rng(1)
    vectors, turns = rng.normal(size=(40, 3)), 0.3 * rng.uniform(-1.0, 1.0, (4000, 3))
    turns[:2000] = 0.3 * np.sign(turns[:2000])
    tried = np.linalg.norm(np.cross(turns[:, None], vectors), axis=-1).max(axis=0)
    np.testing.assert_allclose(tried, turned_most(vectors, 0.3), rtol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.1, 0.26])
def test_the_inner_set_is_in_the_true_one_and_that_in_the_outer_one(tilt):
    """Toes, rotations and rows at random; without a tilt all three are the same."""
    rng = np.random.default_rng(2)
    inside = between = 0
    for _ in range(30):
        normals = rng.normal(size=(6, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        shoulder, reach = rng.uniform(-0.3, 0.3, 3), 0.35
        bounds = normals @ (shoulder + rng.uniform(-0.05, 0.05, 3)) + rng.uniform(0.05, 0.2, 6)
        limb = Limb(
            name="a",
            shoulder_m=shoulder,
            reach_m=reach,
            reach_rows=ReachRows(normals=normals, bounds_m=bounds),
        )
        spaces = HalfSpaces.of([limb], 1.0, tilt)
        for _ in range(200):
            turn = tilt * rng.uniform(-1.0, 1.0, 3)
            out = rng.normal(size=3)
            out *= rng.uniform(0.0, reach) / np.linalg.norm(out)
            d = shoulder + np.cross(turn, shoulder) + out  # in the ball
            true = ((normals + np.cross(turn, normals)) @ d - bounds).max()
            across = np.linalg.norm(spaces.arms @ d - spaces.offsets, axis=1)
            middle = np.array([spaces.levers, np.cross(normals, d)])
            most = turned_most(normals, tilt) * np.linalg.norm(middle[1] - middle[0], axis=1)
            np.testing.assert_allclose(across, most, atol=1e-14)  # t(a) ‖a × (d − z)‖
            inner = (spaces.normals @ d + spaces.levers @ turn + across - spaces.bounds).max()
            outer = (spaces.normals @ d + spaces.outer_levers @ turn - spaces.outer_bounds).max()
            assert outer - 1e-12 <= true <= inner + 1e-12
            assert outer - 1e-12 <= (normals @ Rotation.from_rotvec(-turn).apply(d) - bounds).max()
            assert tilt > 0.0 or outer == pytest.approx(inner, abs=1e-12)
            inside, between = inside + (inner <= 0.0), between + (outer <= 0.0 < true)
    assert inside > 500
    assert (between > 100) == (tilt > 0.0)
