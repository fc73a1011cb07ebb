"""Convex polygons cut and shrunk as half-planes say (scipy's Qhull), and surfaces that hand out
pieces of them.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import linprog, minimize
from scipy.spatial import ConvexHull, HalfspaceIntersection

from stancekit.planners.terrain.patch import THICKNESS_M, Patch, Solid, solids_of
from stancekit.planners.terrain.polygon import (
    SMALLEST_M,
    Surface,
    clipped,
    half_planes,
    in_square,
    nearest,
    patches_of,
    shrunk,
    signed_area,
    surface_patch,
    surface_patches,
    width,
)
from tests.refusals import refuses

TRIANGLE = Patch(
    vertices_m=[[0.0, 0.0, 1.0], [0.4, 0.0, 1.0], [0.0, 0.3, 1.0]],
    normal=[0, 0, 1],
    shear_reference=[1, 0, 0],
    friction=0.5,
)


def test_its_triangles_are_closed_and_turned_outwards() -> None:
    solid = TRIANGLE.solid
    a, b, c = (solid.corners[solid.triangles[:, i]] for i in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)
    volume = (
        np.einsum("ij,ij->", a, areas) / 3.0
    )  # divergence theorem: positive only if turned outwards
    assert volume == pytest.approx(0.06 * THICKNESS_M)


def test_it_lies_behind_the_surface() -> None:
    solid = TRIANGLE.solid
    assert solid.corners[:, 2].max() == pytest.approx(1.0)
    inside, above, below = solid.distance(
        np.array([[0.1, 0.1, 0.99], [0.1, 0.1, 1.2], [0.1, 0.1, 0.9]])
    )
    assert inside < 0.0
    assert above == pytest.approx(0.2)
    assert below == pytest.approx(0.1 - THICKNESS_M)


@given(st.tuples(*[st.floats(-1.0, 2.0)] * 3))
def test_the_distance_is_never_more_than_the_true_one(point: tuple[float, float, float]) -> None:
    solid = TRIANGLE.solid
    shares = np.random.default_rng(0).dirichlet(np.ones(len(solid.corners)), 500)
    nearest = np.linalg.norm(shares @ solid.corners - np.array(point), axis=1).min()
    assert solid.distance(np.array([point]))[0] <= nearest + 1e-12


def test_a_corner_that_is_given_twice_does_no_harm() -> None:
    doubled = Patch(
        vertices_m=TRIANGLE.vertices_m[[0, 1, 1, 2]],
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    assert len(doubled.solid.corners) == 6


def test_it_is_the_hull_of_its_corners_whichever_way_its_border_turns() -> None:
    rng = np.random.default_rng(3)
    for count in (3, 4, 7):
        turn = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))[:: rng.choice([-1, 1])]
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        border = (
            rng.normal(size=3) + 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:2]
        )
        patch = Patch(vertices_m=border, normal=axes[2], shear_reference=axes[0], friction=0.5)
        solid, hull = patch.solid, Solid.of_corners(patch.solid.corners)
        points = border.mean(axis=0) + rng.normal(size=(200, 3))
        np.testing.assert_allclose(solid.distance(points), hull.distance(points), atol=1e-9)
        volumes = [np.linalg.det(of.corners[of.triangles]).sum() / 6.0 for of in (solid, hull)]
        assert volumes[0] == pytest.approx(volumes[1], abs=1e-9)
        assert volumes[0] > 0.0


def test_solids_made_at_once_are_those_made_one_by_one() -> None:
    rng, patches = np.random.default_rng(5), list[Patch]()
    for count in (3, 4, 4, 7, 3):
        turn = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        border = 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:2]
        border += rng.normal(size=3)
        border += 1e-4 * rng.normal(size=(count, 1)) * axes[2] * (len(patches) == 2)  # a bent one
        patches.append(
            Patch(vertices_m=border, normal=axes[2], shear_reference=axes[0], friction=0.5)
        )
    alone = [Solid.behind(patch.vertices_m, patch.normal) for patch in patches]
    together = solids_of(patches)
    assert [patch.solid for patch in patches] == list(together)
    for one, solid in zip(alone, together, strict=True):
        for name in ("corners", "normals", "offsets_m", "triangles"):
            np.testing.assert_array_equal(getattr(one, name), getattr(solid, name))


SEEDS = st.integers(0, 2**32 - 1)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def polygon_of(rng):
    """A convex polygon of 3 to about 8 corners within a metre or so, its corners either way
    round.
    """
    points = rng.normal(size=(int(rng.integers(3, 12)), 2)) * rng.uniform(0.1, 1.0, 2)
    corners = points[ConvexHull(points).vertices] + rng.normal(size=2)
    return corners if rng.random() < 0.5 else corners[::-1]


def intersection(normals, offsets):
    """Area and corners of an intersection of half-planes by Qhull; None where it has no interior to
    speak of.
    """
    lengths = np.linalg.norm(normals, axis=1)
    found = linprog(
        [0.0, 0.0, -1.0],
        np.column_stack([normals, lengths]),
        offsets,
        bounds=[(None, None)] * 2 + [(0.0, None)],
    )
    if found.status != 0 or found.x[2] < SMALLEST_M:
        return None
    corners = HalfspaceIntersection(np.column_stack([normals, -offsets]), found.x[:2]).intersections
    hull = ConvexHull(corners)
    return hull.volume, corners[hull.vertices]


def tilted(rng, corners):
    """A patch with these plane coordinates, somewhere in space, some way up."""
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    normal = np.cross(axes[:, 0], axes[:, 1])
    vertices = rng.normal(size=3) + corners @ axes[:, :2].T
    return Patch(
        vertices_m=vertices,
        normal=normal,
        shear_reference=axes[:, 0] + 0.3 * axes[:, 1],
        friction=0.5,
    )


# -----------------------------------------------------------------------------------------------------------
# polygons


@given(SEEDS)
def test_clipping_leaves_the_intersection_of_the_half_planes(seed):
    rng = np.random.default_rng(seed)
    polygon = polygon_of(rng)
    normals = rng.normal(size=(int(rng.integers(1, 5)), 2))
    offsets = normals @ polygon.mean(axis=0) + rng.uniform(-0.3, 0.5, len(normals))
    own, own_offsets = half_planes(polygon)
    expected = intersection(np.vstack([own, normals]), np.concatenate([own_offsets, offsets]))
    piece = clipped(polygon, normals, offsets)
    if expected is None:
        assert len(piece) == 0 or width(piece) < 4.0 * SMALLEST_M
        return
    area, corners = expected
    if len(piece) == 0:
        assert width(corners) < 1.01 * SMALLEST_M
        return
    assert abs(signed_area(piece)) == pytest.approx(area, abs=1e-9)
    assert np.sign(signed_area(piece)) == np.sign(signed_area(polygon))
    gaps = np.linalg.norm(piece[:, None] - corners, axis=2)
    assert gaps.min(axis=1).max() < 1e-7
    assert gaps.min(axis=0).max() < 1e-7


@given(SEEDS)
def test_what_is_left_after_shrinking_keeps_its_distance_from_every_edge(seed):
    rng = np.random.default_rng(seed)
    polygon, margin = polygon_of(rng), rng.uniform(0.0, 0.1)
    normals, offsets = half_planes(polygon)
    expected = intersection(normals, offsets - margin)
    piece = shrunk(polygon, margin)
    if expected is None or len(piece) == 0:
        assert len(piece) == 0 or width(piece) < 4.0 * SMALLEST_M
        return
    assert abs(signed_area(piece)) == pytest.approx(expected[0], abs=1e-9)
    assert np.max(normals @ piece.T - offsets[:, None]) < -margin + 1e-12


def test_shrinking_by_nothing_changes_nothing():
    np.testing.assert_allclose(shrunk(SQUARE, 0.0), SQUARE, atol=1e-15)


def test_a_polygon_narrower_than_twice_the_margin_is_gone():
    assert len(shrunk(SQUARE * [1.0, 0.039], 0.02)) == 0
    assert len(shrunk(SQUARE * [1.0, 0.043], 0.02)) == 4


@given(SEEDS)
def test_the_nearest_point_is_the_least_squares_point_of_the_half_planes(seed):
    rng = np.random.default_rng(seed)
    polygon, point = polygon_of(rng), 2.0 * rng.normal(size=2)
    normals, offsets = half_planes(polygon)
    found = nearest(polygon, point)
    assert np.max(normals @ found - offsets) < 1e-9
    inside = {"type": "ineq", "fun": lambda x: offsets - normals @ x, "jac": lambda x: -normals}
    best = minimize(
        lambda x: np.sum((x - point) ** 2),
        polygon.mean(axis=0),
        jac=lambda x: 2.0 * (x - point),
        method="SLSQP",
        constraints=[inside],
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert np.linalg.norm(found - point) <= np.linalg.norm(best.x - point) + 1e-7


@given(SEEDS)
def test_the_width_is_the_least_extent_over_all_directions(seed):
    polygon = polygon_of(np.random.default_rng(seed))
    angles = np.linspace(0.0, np.pi, 2001)
    extents = np.ptp(polygon @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
    assert width(polygon) <= extents.min() + 1e-12
    assert width(polygon) >= extents.min() - 2.0 * np.ptp(polygon, axis=0).max() * np.pi / 2000


# -----------------------------------------------------------------------------------------------------------
# surfaces


@given(SEEDS)
def test_a_window_is_the_part_of_the_patch_inside_the_margin_and_the_square(seed):
    rng = np.random.default_rng(seed)
    patch = tilted(rng, polygon_of(rng))
    surface, side, margin = Surface(patch, 0.02), rng.uniform(0.05, 0.4), 0.02
    centre = patch.vertices_m.mean(axis=0) + 0.2 * rng.normal(size=3)
    piece = surface.window(centre, side)
    if piece is None:
        return
    local = (piece.vertices_m - centre) @ patch.frame
    assert np.abs(local[:, 1:]).max() <= 0.5 * side + 1e-12
    assert np.ptp(local[:, 0]) < 1e-9  # in the patch's plane
    edges = np.roll(patch.vertices_m, -1, axis=0) - patch.vertices_m
    inward = np.cross(patch.normal, edges)
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    inward *= np.sign(inward[0] @ (patch.centre_m - patch.vertices_m[0]))
    depth = np.einsum("ej,pej->pe", inward, piece.vertices_m[:, None] - patch.vertices_m)
    assert depth.min() >= margin - 1e-9
    assert (piece.friction, piece.normal.tolist()) == (patch.friction, patch.normal.tolist())


@given(SEEDS)
def test_a_polygon_in_a_square_is_the_one_that_half_planes_leave(seed):
    rng = np.random.default_rng(seed)
    polygon, centre, side = polygon_of(rng), rng.normal(size=2), float(rng.uniform(0.02, 2.0))
    axes = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    expected = clipped(polygon, axes, axes @ centre + 0.5 * side)
    corners = in_square([(y, z) for y, z in polygon.tolist()], (centre[0], centre[1]), side)
    np.testing.assert_array_equal(np.array(corners).reshape(-1, 2), expected)


@given(SEEDS)
def test_pieces_put_together_at_once_are_the_windows_one_by_one(seed):
    rng = np.random.default_rng(seed)
    surfaces = [Surface(tilted(rng, polygon_of(rng)), 0.01) for _ in range(6)]
    centres = [each.patch.centre_m + 0.1 * rng.normal(size=3) for each in surfaces]
    windows = [each.window(at, 0.3) for each, at in zip(surfaces, centres, strict=True)]
    found = [(each, each.piece(at, 0.3)) for each, at in zip(surfaces, centres, strict=True)]
    kept = [window for window in windows if window is not None]
    pieces = patches_of([(surface, piece) for surface, piece in found if piece])
    assert len(pieces) == len(kept)
    for piece, window in zip(pieces, kept, strict=True):
        np.testing.assert_allclose(piece.vertices_m, window.vertices_m, rtol=0.0, atol=1e-15)
        assert piece.friction == window.friction


@given(SEEDS)
def test_a_point_that_is_covered_is_in_the_hull(seed):
    rng = np.random.default_rng(seed)
    patch = tilted(rng, polygon_of(rng))
    hull = ConvexHull((patch.vertices_m - patch.centre_m) @ patch.frame[:, 1:])
    for _ in range(20):
        flat = 1.5 * rng.normal(size=2)
        point = patch.centre_m + patch.frame @ np.array([rng.normal(), *flat])
        room = float((hull.equations[:, :2] @ flat + hull.equations[:, 2]).max())
        if abs(room) > 1e-7:
            assert Surface(patch, 0.0).covers(point) == (room < 0.0)


def test_surfaces_made_at_once_are_those_made_one_by_one():
    rng = np.random.default_rng(7)
    borders = np.array([tilted(rng, SQUARE + rng.normal(size=2)).vertices_m for _ in range(9)])
    borders[::2] = borders[::2, ::-1]
    towards, frictions = rng.normal(size=(9, 3)), rng.uniform(0.0, 1.0, 9).tolist()
    for patch, corners, friction, point in zip(
        surface_patches(borders, frictions, towards), borders, frictions, towards, strict=True
    ):
        alone = surface_patch(corners, friction, towards_m=point)
        assert patch.friction == friction
        for name in ("vertices_m", "normal", "shear_reference", "frame"):
            np.testing.assert_array_equal(getattr(patch, name), getattr(alone, name))
            assert not getattr(patch, name).flags.writeable


def test_one_surface_that_is_none_among_many_is_refused():
    flat = np.column_stack([SQUARE, np.zeros(4)])
    bent = flat + np.array([0.0, 0.0, 0.1]) * np.array([0.0, 1.0, 0.0, 0.0])[:, None]
    with refuses("vertices_m"):
        surface_patches(np.array([flat, bent]), [0.5, 0.5], np.ones((2, 3)))
    with refuses("friction"):
        surface_patches(np.array([flat]), [-0.5], np.ones((1, 3)))


def test_a_window_far_from_the_patch_is_none():
    surface = Surface(surface_patch(np.column_stack([SQUARE, np.zeros(4)]), 0.5), 0.02)
    assert surface.window(np.array([3.0, 0.0, 0.0]), 0.3) is None


def test_the_height_is_positive_on_the_side_of_the_robot():
    surface = Surface(surface_patch(np.column_stack([SQUARE, np.ones(4)]), 0.5), 0.0)
    assert surface.height(np.array([0.2, 0.2, 1.5])) == pytest.approx(0.5)
    assert surface.height(np.array([0.2, 0.2, 0.5])) == pytest.approx(-0.5)


def test_walls_have_their_shear_axis_up_and_ground_has_it_forward():
    ground = surface_patch(np.column_stack([SQUARE, np.zeros(4)]), 0.5)
    wall = surface_patch(np.column_stack([SQUARE[:, :1], np.zeros(4), SQUARE[:, 1:]]), 0.5)
    np.testing.assert_allclose(ground.frame[:, 2], [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(wall.frame[:, 2], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(wall.normal, [0.0, -1.0, 0.0], atol=1e-15)


def test_the_normal_turns_towards_the_robot_when_told_where_it_is():
    corners = np.column_stack([SQUARE, np.zeros(4)])
    np.testing.assert_allclose(surface_patch(corners[::-1], 0.5).normal, [0.0, 0.0, -1.0])
    turned = surface_patch(corners[::-1], 0.5, towards_m=np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(turned.normal, [0.0, 0.0, 1.0])


def test_corners_on_a_line_are_no_patch():
    with refuses():
        surface_patch(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), 0.5)
