"""One surface has the same footholds however it is cut into triangles, rounded, or given twice."""

import warnings
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.terrain.footholds import FootholdLimits
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.mesh_footholds import mesh_footholds
from stancekit.planners.terrain.triangle_mesh import TriangleMesh

trimesh = pytest.importorskip("trimesh")
QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def footholds(corners, triangles):
    """Footholds of a mesh as it is read."""
    mesh = TriangleMesh.of(np.asarray(corners), np.asarray(triangles), ImportOptions(), "it")
    return mesh_footholds(mesh, FootholdLimits(), 0.8)


def plane(degrees, turn_rad=0.0):
    """A tilted rectangle of 1.5 m by 1 m, turned about z, as two triangles."""
    x, y = np.array([-0.75, 0.75, 0.75, -0.75]), np.array([-0.5, -0.5, 0.5, 0.5])
    corners = np.column_stack([x, y, np.tan(np.radians(degrees)) * x])
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]), QUAD


def cut(corners, triangles, side_m):
    """The same in small triangles."""
    corners, triangles = trimesh.remesh.subdivide_to_size(corners, triangles, side_m)
    _, first, number = np.unique(corners.round(9), axis=0, return_index=True, return_inverse=True)
    return corners[first], number.reshape(-1)[triangles]


@pytest.mark.parametrize("degrees", [0, 12, 30])
@pytest.mark.parametrize("turn_rad", [0.0, 0.5236])
@pytest.mark.parametrize("digits", [9, 4, 3])
def test_a_plane_in_small_triangles_is_one_foothold_to_a_millimetre(degrees, turn_rad, digits):
    whole = footholds(*plane(degrees, turn_rad))
    corners, triangles = cut(*plane(degrees, turn_rad), 0.1)
    assert len(triangles) > 400
    found = footholds(corners.round(digits), triangles)
    assert len(found.pieces) == len(whole.pieces) == 1
    assert found.area_m2 == pytest.approx(whole.area_m2, rel=3e-3)
    np.testing.assert_allclose(
        found.pieces[0].patch.normal, whole.pieces[0].patch.normal, atol=2e-3
    )
    off = (corners - found.surfaces[0].centre_m) @ found.surfaces[0].normal
    assert np.abs(off).max() < 1.5e-3


@pytest.mark.parametrize("degrees", [0, 5, 20])
@pytest.mark.parametrize(("digits", "rows"), [(9, 10), (3, 10), (3, 40)])
def test_bricks_whose_corners_are_within_the_edges_of_others_are_one_surface(degrees, digits, rows):
    corners, slope, wide = list[tuple[float, float, float]](), np.tan(np.radians(degrees)), 2 / rows
    for row in range(rows):
        ends = np.clip(np.arange(-1.0 - wide * (row % 2), 1.0 + 1.5 * wide, 2 * wide), -1.0, 1.0)
        for a, b in pairwise(np.unique(ends)):
            y = wide * row - 1.0
            corners += [
                (x, z, slope * x) for x, z in ((a, y), (b, y), (b, y + wide), (a, y + wide))
            ]
    quads = np.concatenate([4 * k + QUAD for k in range(len(corners) // 4)])
    found = footholds(np.round(corners, digits), quads)
    assert len(found.pieces) == 1
    assert found.area_m2 == pytest.approx(1.96**2 / np.cos(np.arctan(slope)), rel=5e-3)


def step(height, riser, side_m):
    """Two planes of 1 m² beside each other, one so much higher, in small triangles."""
    low = cut(np.array([[-1.0, -0.5, 0], [0, -0.5, 0], [0, 0.5, 0], [-1.0, 0.5, 0]]), QUAD, side_m)
    side = np.array([[0, -0.5, 0], [0, 0.5, 0], [0, 0.5, height], [0, -0.5, height]])
    parts = [low, (low[0] + [1.0, 0.0, height], low[1]), cut(side, QUAD[:, ::-1], side_m)]
    parts = [trimesh.Trimesh(*part, process=False) for part in parts[: 3 if riser else 2]]
    return trimesh.util.concatenate(parts)


@pytest.mark.parametrize(("noise_m", "pieces"), [(2e-4, 2), (5e-4, 16)])
def test_the_sides_of_a_step_that_was_measured_are_two_surfaces(noise_m, pieces):
    mesh = step(0.1, True, 0.1)
    mesh.merge_vertices()
    noise = np.random.default_rng(0).normal(0.0, noise_m, mesh.vertices.shape)
    found = footholds(mesh.vertices + noise, mesh.faces)
    assert len({piece.surface for piece in found.pieces}) == 2 <= len(found.pieces) <= pieces
    heights = np.array([piece.patch.centre_m[2] for piece in found.pieces])
    np.testing.assert_allclose(np.minimum(np.abs(heights), np.abs(heights - 0.1)), 0.0, atol=5e-4)
    assert found.area_m2 == pytest.approx(2 * 0.96**2, rel=5e-3)


@pytest.mark.parametrize("digits", [9, 3])
@pytest.mark.parametrize("riser", [False, True])
def test_planes_four_millimetres_apart_stay_two(digits, riser):
    mesh = step(0.004, riser, 0.1)
    found = footholds(mesh.vertices.round(digits), mesh.faces)
    assert sorted(piece.patch.centre_m[2] for piece in found.pieces) == pytest.approx([0.0, 0.004])


@pytest.mark.parametrize("lean", [-0.0437, 0.02])
def test_two_planes_that_meet_stay_two(lean):
    x = np.repeat([-1.0, 0.0, 1.0], 2)
    corners = np.column_stack([x, np.tile([-0.5, 0.5], 3), lean * np.abs(x)])
    small = cut(corners, [[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]], 0.1)
    for digits in (9, 3):
        found = footholds(small[0].round(digits), small[1])
        leans = sorted(piece.patch.normal[0] for piece in found.pieces if piece.area_m2 > 0.1)
        assert leans == pytest.approx([-abs(lean), abs(lean)], abs=2e-3)


def boxes(*bounds):
    """A floor and closed boxes on it."""
    made = [trimesh.creation.box(bounds=each) for each in bounds]
    floor = trimesh.Trimesh([[-1, -1, 0], [2.5, -1, 0], [2.5, 1, 0], [-1, 1, 0]], QUAD)
    return trimesh.util.concatenate([floor, *made])


@pytest.mark.parametrize("order", ["front first", "back first", "mixed", "twice alike"])
def test_faces_given_twice_are_one_surface(order):
    mesh = boxes([[0.5, -0.8, 0.0], [0.9, 0.8, 0.08]], [[1.2, -0.8, 0.0], [1.6, 0.8, 0.12]])
    once, faces = footholds(mesh.vertices, mesh.faces), mesh.faces
    back = faces[:, ::-1]
    both = {
        "front first": [faces, back],
        "back first": [back, faces],
        "mixed": [back[::2], faces[1::2], faces[::2], back[1::2]],
        "twice alike": [faces, np.roll(faces, 1, axis=1)],
    }[order]
    double = footholds(mesh.vertices, np.concatenate(both))
    assert len(double.pieces) == len(once.pieces)
    assert double.area_m2 == pytest.approx(once.area_m2, rel=1e-6)


def test_a_solid_with_room_inside_that_is_given_from_both_sides_is_told():
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [2, 2, 1]])
    with pytest.warns(UserWarning, match="both sides"):
        found = footholds(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))
    assert [round(float(piece.patch.centre_m[2]), 6) for piece in found.pieces] == [1.0]


def test_a_sheet_that_is_given_from_both_sides_has_ground_below():
    sheet = trimesh.Trimesh([[0, -0.5, 1], [1, -0.5, 1], [1, 0.5, 1], [0, 0.5, 1]], QUAD)
    mesh = trimesh.util.concatenate([boxes(), sheet])
    both = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = footholds(mesh.vertices, both)
    heights = [float(piece.patch.centre_m[2]) for piece in found.pieces]
    assert found.area_m2 > 3.5 * 2.0
    assert max(heights) == pytest.approx(1.0)
