"""Convex parts of meshes: all of the mesh is in them, and what is not near it is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.convex_parts import MOST_PARTS, convex_parts


def boxes(*spans: tuple[tuple[float, float, float], tuple[float, float, float]]) -> tuple[Array, Array]:
    """A mesh of boxes from one corner to the other: vertices and faces."""
    vertices, faces = [], []
    for low, high in spans:
        ends = np.array([low, high])
        corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        faces += [simplex + 8 * len(vertices) for simplex in ConvexHull(corners).simplices]
        vertices.append(corners)
    return np.concatenate(vertices), np.array(faces)


def outside(points: Array, corners: Array) -> Array:
    """How far points are outside of a hull, negative inside."""
    equations = ConvexHull(corners).equations
    return np.asarray((points @ equations[:, :3].T + equations[:, 3]).max(axis=1))


FRAME = (
    ((0.0, 0.0, 0.0), (1.0, 0.1, 0.1)),
    ((0.0, 0.9, 0.0), (1.0, 1.0, 0.1)),
    ((0.0, 0.1, 0.0), (0.1, 0.9, 0.1)),
    ((0.9, 0.1, 0.0), (1.0, 0.9, 0.1)),
)
"""Four beams around a square hole."""
BENT = (((0.0, 0.0, 0.0), (0.1, 0.1, 1.0)), ((0.1, 0.0, 0.9), (0.8, 0.1, 1.0)))
"""An L."""


@pytest.mark.parametrize("spans", [FRAME, BENT])
@pytest.mark.parametrize("turned", [False, True])
def test_all_of_a_mesh_is_in_its_parts(spans, turned: bool) -> None:
    vertices, faces = boxes(*spans)
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    parts = convex_parts(vertices @ turn.T, faces)
    assert 2 <= len(parts) <= MOST_PARTS
    inside = np.concatenate([rng.uniform(low, high, (400, 3)) for low, high in spans]) @ turn.T
    assert np.min([outside(inside, part) for part in parts], axis=0).max() < 1e-9
    hull = ConvexHull(vertices)
    assert sum(ConvexHull(part).volume for part in parts) < 0.7 * hull.volume
    assert max(outside(np.concatenate(parts), vertices @ turn.T)) < 1e-9


def test_a_hole_is_not_in_the_parts_of_what_is_around_it() -> None:
    parts = convex_parts(*boxes(*FRAME))
    hole = np.random.default_rng(2).uniform([0.2, 0.2, 0.0], [0.8, 0.8, 0.1], (500, 3))
    assert np.min([outside(hole, part) for part in parts], axis=0).min() > 0.0


def test_what_is_convex_has_no_parts() -> None:
    corners = np.random.default_rng(3).normal(size=(200, 3))
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    assert convex_parts(corners, ConvexHull(corners).simplices) == ()
    assert convex_parts(*boxes(((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)))) == ()


def test_what_is_flat_has_none() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    assert convex_parts(vertices, np.array([[0, 1, 2], [1, 2, 3]])) == ()
