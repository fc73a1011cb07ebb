"""Convex parts of meshes: all of the mesh is in them, and what is not near it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import embedded
from stancekit.planners.robot.hulls import (
    MOST_PARTS,
    convex_parts,
    hull_corners,
    hulls_of_text,
    hulls_to_text,
    with_known_hulls,
)
from stancekit.planners.robot.meshes import Shape
from tests.refusals import refuses


def boxes(
    *spans: tuple[tuple[float, float, float], tuple[float, float, float]],
) -> tuple[Array, Array]:
    """A mesh of boxes from one corner to the other: vertices and faces."""
    vertices, faces = [], []
    for low, high in spans:
        ends = np.array([low, high])
        corners = np.array(
            [[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        )
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


def concave(parts: bool = True) -> Shape:
    """The frame as a link's mesh."""
    vertices, faces = boxes(*FRAME)
    rounded = [hull_corners(part) for part in convex_parts(vertices, faces)] if parts else []
    return Shape(
        link="base",
        kind="mesh",
        size_m=np.ones(3),
        rotation=np.eye(3),
        origin_m=np.zeros(3),
        collides=True,
        corners_m=hull_corners(vertices),
        parts_m=tuple(part for part in rounded if part is not None),
    )


def test_parts_come_back_from_the_text_of_a_file() -> None:
    (ball,) = [
        replace(
            concave(), link="ball", kind="sphere", size_m=np.ones(1), corners_m=None, parts_m=()
        )
    ]
    shapes = (ball, concave())
    bare = tuple(replace(shape, corners_m=None, parts_m=()) for shape in shapes)
    read = with_known_hulls(bare, hulls_of_text(hulls_to_text(shapes)))
    assert read[0].corners_m is None
    assert len(read[1].parts_m) == len(shapes[1].parts_m) >= 2
    for mine, its in zip(read[1].parts_m, shapes[1].parts_m, strict=True):
        np.testing.assert_array_equal(mine, its)


def test_parts_that_leave_something_of_the_hull_out_are_refused() -> None:
    shape = concave()
    less = replace(shape, parts_m=shape.parts_m[:1])
    with refuses("shape 0"):
        with_known_hulls((concave(parts=False),), hulls_of_text(hulls_to_text((less,))))
    lower = hull_corners(shape.parts_m[0] - [0.0, 0.0, 0.01])
    assert lower is not None
    far = replace(shape, parts_m=(*shape.parts_m, lower))
    with refuses():
        with_known_hulls((concave(parts=False),), hulls_of_text(hulls_to_text((far,))))


def test_parts_without_their_hull_are_refused() -> None:
    alone = embedded({"0_0": concave().parts_m[0]})
    with refuses("shape 0"):
        hulls_of_text(alone)


def test_a_ball_in_a_hole_is_as_far_from_the_rim_as_it_is() -> None:
    """Against the closed form: to the nearest of four beams."""
    pytest.importorskip("coal")
    from tests.planners.robot.test_bodies import bodies

    rng, radius = np.random.default_rng(5), 0.35
    beams = replace(concave(), parts_m=tuple(boxes(span)[0] for span in FRAME))
    for _ in range(20):
        at = np.array([*rng.uniform(0.1 + radius + 0.001, 0.9 - radius - 0.001, 2), 0.05])
        ball = Shape(
            link="LF_FOOT",
            kind="sphere",
            size_m=np.array([radius]),
            rotation=np.eye(3),
            origin_m=np.zeros(3),
            collides=True,
        )
        rim = min(at[:2].min() - 0.1, 0.9 - at[:2].max()) - radius
        places = np.tile(np.eye(3), (1, 2, 1, 1)), np.array([[np.zeros(3), at]])
        assert bodies([beams, ball])._distances(places)(0, 0, 1) == pytest.approx(rim, abs=1e-5)
        assert bodies([concave(parts=False), ball])._distances(places)(0, 0, 1) < 0.0
