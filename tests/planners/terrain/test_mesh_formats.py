"""Readers of mesh files: what trimesh writes is read as it was, and what is damaged is refused,
never believed.
"""

from __future__ import annotations

import re
import zlib
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.terrain.mesh_file import read_corners
from stancekit.planners.terrain.mesh_formats import READERS
from stancekit.planners.terrain.mesh_formats.numbers import TooMany
from tests.damage import mutations as m
from tests.refusals import refuses

trimesh: Any = pytest.importorskip("trimesh")

KINDS = ("stl", "text.stl", "obj", "ply", "text.ply", "off", "glb", "dae")
TEXTS = ("text.stl", "obj", "text.ply", "off", "dae")


def content(mesh: Any, kind: str) -> bytes:
    """The file of a mesh, as trimesh writes it."""
    if kind == "text.stl":
        found = trimesh.exchange.stl.export_stl_ascii(mesh)
    elif kind == "text.ply":
        found = trimesh.exchange.ply.export_ply(mesh, encoding="ascii")
    else:
        if kind == "dae":
            pytest.importorskip("collada")
        found = mesh.export(file_type=kind)
    return found.encode() if isinstance(found, str) else bytes(found)


def read(data: bytes, kind: str) -> Any:
    return READERS["." + kind.rpartition(".")[2]](data, 10_000)


@pytest.mark.parametrize("kind", KINDS)
def test_triangles_are_read_as_they_were_written(kind: str) -> None:
    mesh = trimesh.creation.icosphere(2, 0.3)
    mesh.apply_translation([1.0, -2.0, 0.5])
    corners, triangles = read(content(mesh, kind), kind)
    np.testing.assert_allclose(corners[triangles], mesh.triangles, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_mutated_files_are_meshes_or_refused(kind: str, tmp_path: Path) -> None:
    whole = content(trimesh.creation.icosphere(1, 0.3), kind)
    rng, seen = np.random.default_rng(zlib.crc32(kind.encode())), Counter[str]()
    ways = m.PLAIN + (3 * (m.renumbered, m.reordered) if kind in TEXTS else ())
    path = tmp_path / f"mesh.{kind}"
    for _ in range(250):
        path.write_bytes(ways[rng.integers(len(ways))](whole, rng))
        try:
            corners, triangles = read_corners(path, 10_000)
        except InvalidInput as error:
            seen["refused"] += 1
            seen["long"] += "\n" in str(error) or len(str(error)) > 500
        else:
            seen["read"] += 1
            assert np.all(np.isfinite(corners))
            assert triangles.min() >= 0
            assert triangles.max() < len(corners)
    assert min(seen["read"], seen["refused"]) > 10
    assert seen["long"] == 0


def test_faces_of_an_obj_may_count_back_and_have_many_corners() -> None:
    text = (
        b"# x\r\nv 0 0 0\r\nv 1 0 0 0.5 0.5 0.5\r\nv 1 1 0\r\nv 0 1 0\r\nf -4//1 -3//1 \\\r\n -2//1 -1//1\r\n"
        b"v 0 0 1\r\nf 1/1 2/1 -1\r\n"
    )
    corners, triangles = read(text, "obj")
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 4]]
    assert corners[4].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("order", ["little", "big"])
def test_a_ply_may_have_other_properties_and_faces_of_several_sizes(order: str) -> None:
    mark = "<" if order == "little" else ">"
    head = (
        f"ply\nformat binary_{order}_endian 1.0\ncomment a\nelement vertex 4\nproperty uchar red\nproperty double x\n"
        "property float z\nproperty short y\nelement edge 1\nproperty list uchar int pair\nelement face 2\n"
        "property list ushort uint vertex_index\nproperty float weight\nend_header\n"
    )
    rows = np.array(
        [(1, 0, 0, 0), (1, 2, 0, 0), (1, 2, 0, 3), (1, 0, 5, 3)],
        dtype=f"u1,{mark}f8,{mark}f4,{mark}i2",
    )
    edge = b"\x02" + np.array([0, 1], dtype=f"{mark}i4").tobytes()
    faces = [[0, 1, 2, 3], [0, 1, 2]]
    body = b"".join(
        np.array([len(face)], dtype=f"{mark}u2").tobytes()
        + np.array(face, dtype=f"{mark}u4").tobytes()
        + bytes(4)
        for face in faces
    )
    corners, triangles = read(head.encode() + rows.tobytes() + edge + body, "ply")
    assert corners.tolist() == [[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 5]]
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]


@pytest.mark.parametrize(
    ("kind", "old", "new", "name"),
    [
        ("dae", r"<p>[^<]*</p>", "<p>0 1 99999</p>", "mesh.dae"),
        ("dae", r"<COLLADA", "<!DOCTYPE x [<!ENTITY a 'b'>]><COLLADA", "mesh.dae"),
        ("dae", r"<node ", "<node><instance_node url='#node0'/></node><node ", None),
        ("obj", r"f 1 ", "f 99999 ", None),
        ("obj", r"v ", "v 1e400 ", "mesh.obj"),
        (
            "text.ply",
            r"element vertex \d+",
            "element vertex 999999999",
            "999999999",
        ),
        ("text.ply", r"element face \d+", "element face 9999", "9999"),
        ("off", r"OFF", "OFF BINARY", "mesh.off"),
        ("text.stl", r"vertex", "vertex x", "'x'"),
    ],
)
def test_what_is_wrong_with_a_mesh_is_said(
    tmp_path: Path, kind: str, old: str, new: str, name: str | None
) -> None:
    text = content(trimesh.creation.icosphere(1, 0.3), kind).decode()
    changed = re.sub(old, new, text, count=1)
    assert changed != text
    (tmp_path / f"mesh.{kind}").write_text(changed)
    if name is None:
        with suppress(InvalidInput):
            read_corners(tmp_path / f"mesh.{kind}")
        return
    with refuses(f"mesh.{kind}", name):
        read_corners(tmp_path / f"mesh.{kind}")


def test_a_name_that_is_no_text_is_said_as_it_can_be(tmp_path: Path) -> None:
    head = b"ply\nformat binary_little_endian 1.0\nelement ver\x80\x1b 99\nproperty float x\nend_header\n"
    (tmp_path / "mesh.ply").write_bytes(head)
    with refuses("mesh.ply", "99"):
        read_corners(tmp_path / "mesh.ply")


def test_a_node_within_itself_ends() -> None:
    pytest.importorskip("collada")
    text = content(trimesh.creation.box(), "dae").decode()
    name = re.search(r'<node [^>]*id="([^"]+)"', text)
    assert name is not None
    loop = text.replace("</node>", f'<instance_node url="#{name[1]}"/></node>', 1)
    with refuses(kind=TooMany):
        read(loop.encode(), "dae")


def test_other_endings_are_refused(tmp_path: Path) -> None:
    for name in ("mesh.fbx", "mesh", "mesh.gltf"):
        (tmp_path / name).write_bytes(b"x")
        with refuses(".stl"):
            read_corners(tmp_path / name)
