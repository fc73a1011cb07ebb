"""Mesh files become the convex facets that their shapes have, and what is no terrain is refused in
one line.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.terrain.facets import facets_of
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.terrain_file import read_terrain
from tests.refusals import assert_names

trimesh = pytest.importorskip("trimesh")
KINDS = ("stl", "obj", "ply")


def read_mesh(path, *, friction, **named):
    mesh = read_terrain(path, ImportOptions(**named))
    mesh.check_size()
    return tuple(patch for facet in facets_of(mesh) for patch in facet.patches(1e-3, friction))


@pytest.fixture
def saved(tmp_path):
    def save(mesh, kind="ply"):
        path = tmp_path / f"mesh.{kind}"
        mesh.export(path)
        return path

    return save


def prism(plan, height):
    """A solid over a plane outline, its corners to the left."""
    outline = np.array(plan, dtype=float)
    count = len(outline)
    vertices = np.vstack(
        [
            np.column_stack([outline, np.zeros(count)]),
            np.column_stack([outline, np.full(count, height)]),
        ]
    )
    sides = [
        face
        for i in range(count)
        for j in [(i + 1) % count]
        for face in ((i, j, j + count), (i, j + count, i + count))
    ]
    return vertices, sides, count


def letter_l(height=0.5):
    """An L, its top and bottom triangulated by hand."""
    vertices, sides, count = prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], height)
    top = [(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)]
    faces = sides + [tuple(i + count for i in face) for face in top] + [face[::-1] for face in top]
    return trimesh.Trimesh(vertices, faces, process=False)


def area(patch):
    corners = patch.vertices_m - patch.vertices_m[0]
    return 0.5 * np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))


def refusal(path, **named):
    with pytest.raises(InvalidInput) as error:
        read_mesh(path, friction=0.5, **named)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("mesh", "facets", "corners"),
    [
        (trimesh.creation.box((1.0, 2.0, 0.5)), 6, [4]),
        (trimesh.creation.box((1.0, 2.0, 0.5)).subdivide().subdivide(), 6, [4]),
        (trimesh.creation.cylinder(0.5, 1.0, sections=10), 12, [4, 10]),
        (trimesh.creation.icosahedron(), 20, [3]),
    ],
)
def test_a_convex_solid_gets_a_patch_a_facet(mesh, facets, corners, kind, saved):
    patches = read_mesh(saved(mesh, kind), friction=0.4)
    assert len(patches) == facets
    assert sorted({len(patch.vertices_m) for patch in patches}) == corners
    assert sum(area(patch) for patch in patches) == pytest.approx(mesh.area, rel=1e-5)
    centre = mesh.bounds.mean(axis=0)
    assert all(patch.normal @ (patch.centre_m - centre) > 0.0 for patch in patches)
    assert {patch.friction for patch in patches} == {0.4}


@pytest.mark.parametrize(
    ("mesh", "top"), [(letter_l(), 2), (trimesh.creation.annulus(0.3, 0.6, 0.2, sections=12), 12)]
)
def test_a_facet_that_is_not_convex_or_has_a_hole_becomes_a_few_convex_patches(mesh, top, saved):
    patches = read_mesh(saved(mesh), friction=0.4)
    upward = [patch for patch in patches if patch.normal[2] > 0.9]
    assert 2 <= len(upward) <= top
    height = mesh.vertices[:, 2].max()
    expected = mesh.area_faces[
        np.all(mesh.vertices[mesh.faces][:, :, 2] > height - 1e-9, axis=1)
    ].sum()
    assert sum(area(patch) for patch in upward) == pytest.approx(expected, rel=1e-6)
    for patch in upward:  # every patch lies inside the facet
        middles = 0.5 * (patch.vertices_m + np.roll(patch.vertices_m, -1, axis=0))
        _, distance, _ = trimesh.proximity.closest_point(mesh, np.vstack([middles, patch.centre_m]))
        assert distance.max() < 1e-6


def test_walls_have_their_shear_axis_up(saved):
    for patch in read_mesh(saved(trimesh.creation.box((1.0, 1.0, 1.0))), friction=0.4):
        expected = [0.0, 0.0, 1.0] if abs(patch.normal[2]) < 0.5 else [1.0, 0.0, 0.0]
        np.testing.assert_allclose(patch.frame[:, 2], expected, atol=1e-6)


def test_the_unit_and_the_offset_are_taken_into_account(saved):
    mesh = trimesh.creation.box((1000.0, 2000.0, 500.0))
    patches = read_mesh(saved(mesh), friction=0.4, unit_m=0.001, offset_m=(0.0, 0.0, 3.0))
    corners = np.vstack([patch.vertices_m for patch in patches])
    np.testing.assert_allclose(np.ptp(corners, axis=0), [1.0, 2.0, 0.5], atol=1e-6)
    assert corners[:, 2].mean() == pytest.approx(3.0)


def test_a_course_on_a_mesh_beside_its_file(saved, tmp_path):
    saved(trimesh.creation.box((3.0, 3.0, 0.1)), "stl")
    path = tmp_path / "course.yaml"
    terrain = {"kind": "mesh", "file": "mesh.stl", "friction": 0.6, "offset_m": [0.0, 0.0, -0.05]}
    path.write_text(
        yaml.safe_dump(
            {
                "name": "slab",
                "frames": 4,
                "start_m": [0, 0, 0.2],
                "goal_m": [0.2, 0, 0.2],
                "terrain": terrain,
            }
        )
    )
    course = read_course(path)
    assert len(course.terrain) == 6
    assert {
        round(float(v), 6) for p in course.footholds for v in p.candidates[0].vertices_m[:, 2]
    } == {0.0}


# -----------------------------------------------------------------------------------------------------------
# refusals


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("side_m", [2000.0, 60.0])
def test_a_mesh_that_is_too_large_is_told_of_units_and_of_none_alone(kind, side_m, saved):
    path = saved(trimesh.creation.box((0.5 * side_m, side_m, 0.25 * side_m)), kind)
    message = refusal(path)
    assert_names(message, path.name, f"{side_m:g} m", "unit_m")
    assert "millimetres" not in message


def test_a_mesh_smaller_than_a_foot_is_refused(saved):
    assert (
        "expected a terrain of at least 0.01 m from end to end, got 0.002 m; see unit_m"
        in refusal(saved(trimesh.creation.box((0.001, 0.002, 0.001))))
    )


@pytest.mark.parametrize("kind", KINDS)
def test_an_edge_of_three_triangles_spoils_no_facet(kind, saved):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    fin = np.vstack([box.vertices, [[0.9, 0.0, 0.0]]])
    mesh = trimesh.Trimesh(fin, np.vstack([box.faces, [[*box.faces[0][:2], 8]]]), process=False)
    areas = sorted(area(patch) for patch in read_mesh(saved(mesh, kind), friction=0.5))
    assert len(areas) == 7
    np.testing.assert_allclose(
        [a for a in areas if abs(a - mesh.area_faces[-1]) > 1e-4], 1.0, atol=1e-5
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_triangle_that_faces_the_other_way_is_turned(kind, saved):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    faces = box.faces.copy()
    faces[3] = faces[3][::-1]
    with pytest.warns(UserWarning, match="1 triangles"):
        patches = read_mesh(
            saved(trimesh.Trimesh(box.vertices, faces, process=False), kind), friction=0.5
        )
    assert [round(area(patch), 4) for patch in patches] == [1.0] * 6
    assert all(patch.normal @ patch.centre_m > 0.0 for patch in patches)


def test_what_covers_a_place_twice_counts_once(saved):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    twice = trimesh.Trimesh(box.vertices, np.vstack([box.faces, box.faces]), process=False)
    assert sum(area(patch) for patch in read_mesh(saved(twice), friction=0.5)) == pytest.approx(
        6.0, rel=1e-5
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "mesh.stl",
            b"solid nothing\nendsolid nothing\n",
            "expected a mesh with triangles, got an empty one",
        ),
        ("mesh.obj", b"# nothing\n", "expected a mesh"),
        (
            "mesh.ply",
            b"not a mesh at all",
            "expected a mesh: expected a header from ply to end_header",
        ),
        ("mesh.ply", b"", "expected a mesh"),
        (
            "mesh.tif",
            b"",
            "expected a terrain that ends in .npy, .npz, .csv, .png, .stl, .obj, .ply, .dae",
        ),
        (
            "mesh.obj",
            b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
            "expected a mesh with triangles, got an empty one",
        ),
        ("mesh.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "expected a mesh"),
    ],
)
def test_a_file_without_a_mesh_is_refused_in_one_line(name, content, message, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    assert message in refusal(path)
