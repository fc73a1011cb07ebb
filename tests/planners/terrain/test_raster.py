"""The upper side of triangles on a grid, against one triangle after the other; and meshes that are
read as maps.
"""

import numpy as np
import pytest

from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.terrain_file import read_terrain
from stancekit.planners.terrain.triangle_mesh import EDGE, PAIRS, raised
from tests.refusals import refuses

X, Y = np.linspace(-1.0, 1.0, 41), np.linspace(-0.5, 0.7, 31)


def one_by_one(triangles, x, y):
    heights = np.full((len(x), len(y)), -np.inf)
    for a, b, c in triangles:
        matrix = np.stack([(b - a)[:2], (c - a)[:2]], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-14:
            continue
        for i, j in np.ndindex(heights.shape):
            second, third = np.linalg.solve(matrix, np.array([x[i], y[j]]) - a[:2])
            if min(second, third) > -EDGE and second + third < 1.0 + EDGE:
                heights[i, j] = max(heights[i, j], a[2] + second * (b - a)[2] + third * (c - a)[2])
    return heights


def test_each_node_has_the_height_of_the_highest_triangle_over_it():
    rng = np.random.default_rng(5)
    middles = rng.uniform([-1.2, -0.8, 0.0], [1.2, 1.0, 0.5], (60, 3))
    triangles = middles[:, None] + rng.uniform(-0.25, 0.25, (60, 3, 3))
    triangles[7, 2] = triangles[7, 1]  # one without an area
    found, expected = raised(triangles, X, Y), one_by_one(triangles, X, Y)
    assert np.isfinite(found).sum() > 100
    assert np.isneginf(found).any()
    assert np.array_equal(np.isfinite(found), np.isfinite(expected))
    covered = np.isfinite(found)
    assert np.allclose(found[covered], expected[covered], atol=1e-12)


def test_triangles_with_more_nodes_than_are_looked_at_together_are_still_seen():
    x = y = np.linspace(0.0, 1.0, 1100)
    assert len(x) * len(y) > PAIRS
    square = np.array(
        [[[0, 0, 0.0], [1, 0, 1.0], [1, 1, 1.0]], [[0, 0, 0.0], [1, 1, 1.0], [0, 1, 0.0]]]
    )
    found = raised(np.concatenate([square, square - 3.0 * np.eye(3)[2]]), x, y)
    assert np.allclose(found, x[:, None] * np.ones(len(y)), atol=1e-12)


def sheet(path, rows, columns):
    """A binary .ply of 2 × rows × columns triangles, z = x / 10, a metre long."""
    x, y = np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 0.5, columns + 1)
    corners = np.stack(
        [*np.meshgrid(x, y, indexing="ij"), np.repeat(0.1 * x[:, None], len(y), axis=1)], axis=-1
    )
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, -1)
    a, b, c, d = (
        part.ravel()
        for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.zeros(2 * len(a), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {corners[..., 0].size}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + corners.astype("<f4").tobytes() + faces.tobytes())
    return path


def test_a_mesh_too_fine_to_be_read_as_it_is_says_how_it_can_be_read(tmp_path):
    path = sheet(tmp_path / "fine.ply", 420, 250)
    with refuses(path):
        read_terrain(path, ImportOptions())


def test_a_mesh_that_is_read_as_a_grid_is_its_upper_side(tmp_path):
    found = read_terrain(
        sheet(tmp_path / "fine.ply", 420, 250), ImportOptions(kind="grid", spacing_m=0.02)
    )
    assert isinstance(found, ElevationMap)
    assert found.heights_m.shape == (50, 25) or found.heights_m.shape == (51, 26)
    assert np.allclose(found.heights_m, 0.1 * found.x_m[:, None], atol=1e-6)


def test_a_mesh_that_is_read_as_a_grid_is_cropped(tmp_path):
    options = ImportOptions(kind="grid", spacing_m=0.02, crop_m=(0.2, 0.6, 0.1, 0.4))
    found = read_terrain(sheet(tmp_path / "some.ply", 42, 25), options)
    assert found.x_m[[0, -1]] == pytest.approx([0.2, 0.6], abs=0.021)
    assert found.y_m[[0, -1]] == pytest.approx([0.1, 0.4], abs=0.021)
    assert np.allclose(found.heights_m, 0.1 * found.x_m[:, None], atol=1e-6)
    with refuses("crop_m"):
        read_terrain(tmp_path / "some.ply", ImportOptions(kind="grid", crop_m=(3.0, 4.0, 0.0, 1.0)))
