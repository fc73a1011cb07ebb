"""Meshes of links: few triangles on the same surface, outsides outside, kept once read, and files
that are none.
"""

from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.robot import meshes
from stancekit.planners.robot.meshes import (
    Triangles,
    faced_outward,
    read_mesh,
    thinned,
    thinned_mesh,
)
from tests.refusals import refuses

pytest.importorskip("coal")

CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
BOX = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 7, 5],
        [4, 6, 7],
        [0, 5, 1],
        [0, 4, 5],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 7, 3],
        [1, 5, 7],
    ]
)


def ball(rows: int = 60) -> Triangles:
    """A sphere of radius 1 about (3, 0, 0), to the left from outside, its poles left open."""
    tilt, turn = (
        np.linspace(0.05, np.pi - 0.05, rows),
        np.linspace(0.0, 2.0 * np.pi, 2 * rows, endpoint=False),
    )
    points = [
        [3.0 + np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)] for a in tilt for b in turn
    ]
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(2 * rows), indexing="ij")
    a, b = 2 * rows * row + column, 2 * rows * row + (column + 1) % (2 * rows)
    faces = np.concatenate(
        [np.stack([a, a + 2 * rows, b], -1), np.stack([b, a + 2 * rows, b + 2 * rows], -1)]
    )
    return Triangles(vertices_m=np.array(points), faces=faces.reshape(-1, 3))


def volume(mesh: Triangles) -> float:
    a, b, c = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c))) / 6.0


@pytest.mark.parametrize("most", [100, 1000, 5000])
def test_a_thinned_mesh_has_few_triangles_and_the_same_surface(most: int) -> None:
    whole = ball()
    few = thinned(whole, most)
    assert most / 4 < len(few.faces) <= most < len(whole.faces)
    away = np.abs(np.linalg.norm(few.vertices_m - [3.0, 0.0, 0.0], axis=1) - 1.0)
    assert away.max() < 4.0 / np.sqrt(most)
    assert volume(few) == pytest.approx(4.0 / 3.0 * np.pi, rel=8.0 / np.sqrt(most))
    assert len(np.unique(np.sort(few.faces, axis=1), axis=0)) == len(few.faces)


def test_a_mesh_of_few_triangles_stays_as_it_is() -> None:
    box = Triangles(vertices_m=CORNERS, faces=BOX)
    assert thinned(box, 12) is box


def test_outside_is_outside_whichever_way_a_mesh_was_written() -> None:
    assert volume(Triangles(vertices_m=CORNERS, faces=BOX)) == pytest.approx(8.0)
    for faces in (BOX, BOX[:, ::-1]):
        found = faced_outward(
            Triangles(vertices_m=CORNERS + np.array([5.0, 0.0, 0.0]), faces=faces)
        )
        assert len(found.faces) == 12
        assert volume(found) == pytest.approx(8.0)
    mixed = np.vstack([BOX[:5], BOX[5:, ::-1]])
    found = faced_outward(Triangles(vertices_m=CORNERS, faces=mixed))
    normals = np.cross(
        *(found.vertices_m[found.faces[:, k]] - found.vertices_m[found.faces[:, 0]] for k in (1, 2))
    )
    assert len(found.faces) == 24
    np.testing.assert_allclose(normals[:12], -normals[12:])


def test_a_file_is_read_once_and_kept_thinned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STANCEKIT_CACHE", str(tmp_path / "cache"))
    lines = [f"v {x} {y} {z}" for x, y, z in ball().vertices_m] + [
        f"f {a} {b} {c}" for a, b, c in ball().faces + 1
    ]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    scale = np.array([2.0, 2.0, 2.0])
    first = thinned_mesh(tmp_path / "ball.obj", scale, 500)
    assert 100 < len(first.faces) <= 500
    assert np.ptp(first.vertices_m, axis=0) == pytest.approx(4.0, rel=0.2)
    (kept,) = (tmp_path / "cache" / "meshes").iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(meshes, "read_mesh", lambda *_: pytest.fail("read again"))
        again = thinned_mesh(tmp_path / "ball.obj", scale, 500)
    np.testing.assert_array_equal(again.faces, first.faces)
    np.testing.assert_allclose(again.vertices_m, first.vertices_m, atol=1e-6)
    kept.write_bytes(kept.read_bytes()[:100])
    anew = thinned_mesh(tmp_path / "ball.obj", scale, 500)
    np.testing.assert_array_equal(anew.faces, first.faces)


def test_what_is_no_mesh_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STANCEKIT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    for name in ("broken.stl", "none.dae"):
        with refuses(name):
            read_mesh(tmp_path / name, np.ones(3))
        with refuses(name):
            thinned_mesh(tmp_path / name, np.ones(3), 10)
    assert not (tmp_path / "cache").exists()
