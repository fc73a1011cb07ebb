"""Readers of mesh files: what trimesh writes is read as it was, and what is damaged is refused,
never believed.
"""

from __future__ import annotations

import json
import re
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.terrain.mesh_file import READERS, read_corners
from stancekit.planners.terrain.mesh_formats.numbers import FIELDS, TooMany
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


L = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
PLY = "element vertex 6\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
HEADS = {
    "off": "OFF\n6 1 0\n",
    "ply": f"ply\nformat ascii 1.0\n{PLY}property list uchar int vertex_indices\nend_header\n",
    "obj": "",
}


@pytest.mark.parametrize("kind", HEADS)
@pytest.mark.parametrize("turns", [1, -1])
def test_a_face_that_is_not_convex_is_cut_within_it(kind: str, turns: int) -> None:
    obj = kind == "obj"
    for first in range(6):
        order = [(first + turns * k) % 6 + obj for k in (*range(6), 5)]  # the last one twice
        lines = [f"{'v ' * obj}{x} {0.5 * x} {y}" for x, y in L]
        text = "\n".join([*lines, " ".join(map(str, ["f" if obj else 7, *order]))])
        corners, triangles = read((HEADS[kind] + text + "\n").encode(), kind)
        a, b, c = np.moveaxis(corners[triangles][:, :, [0, 2]], 1, 0)
        (ux, uy), (vx, vy) = (b - a).T, (c - a).T
        areas = 0.5 * (ux * vy - uy * vx)
        assert sorted(np.sign(areas) * turns) == [0, 1, 1, 1, 1]
        assert abs(areas).sum() == pytest.approx(3.0)


def test_a_dae_is_in_the_unit_that_it_states() -> None:
    pytest.importorskip("collada")
    text = content(trimesh.creation.box([1.0, 2.0, 3.0]), "dae").decode()
    for unit, size in (("", 3.0), ('<unit meter="0.01" name="x"/>', 0.03), ("<unit/>", 3.0)):
        stated = text.replace("<up_axis>", f"{unit}<up_axis>").encode()
        assert np.ptp(read(stated, "dae")[0]) == pytest.approx(size)
    with refuses("unit", "0"):
        read(text.replace("<up_axis>", '<unit meter="0"/><up_axis>').encode(), "dae")


GLB = {
    "uri": lambda tree: tree.update(images=[{"uri": "x.png"}]),
    "sparse": lambda tree: tree["accessors"][0].update(sparse={}),
    "skin": lambda tree: [node.update(skin=0) for node in tree["nodes"]],
    "weights": lambda tree: tree["meshes"][0].update(weights=[1.0]),
}
"""Changes of a .glb by a field; others are extensions."""


def holding(kind: str, field: str) -> bytes:
    """A file of a box that holds a field."""
    whole = content(trimesh.creation.box(), f"{'text.' * (kind == 'ply')}{kind}")
    if kind == "glb":
        return glb_with(whole, GLB.get(field, lambda tree: extended(tree, field)))
    old, new = {
        "obj": (b"v ", f"{field} 1 2\nv ".encode()),
        "off": (b"OFF", b"OFF BINARY" if field == "BINARY" else f"{field}OFF".encode()),
        "ply": (b"end_header", f"element {field} 0\nend_header".encode()),
        "dae": (b"</mesh>", f"</mesh><{field}/>".encode()),
    }[kind]
    if field in ("lookat", "skew"):
        old, new = b"<instance_geometry", f"<{field}/><instance_geometry".encode()
    return whole.replace(old, new, 1)


def glb_with(whole: bytes, change: Callable[[Any], object]) -> bytes:
    size = int.from_bytes(whole[12:16], "little")
    tree = json.loads(whole[20 : 20 + size])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = whole[:8] + (len(whole) - size + len(text)).to_bytes(4, "little")
    return head + len(text).to_bytes(4, "little") + whole[16:20] + text + whole[20 + size :]


def extended(tree: Any, name: str) -> None:
    for each in (*tree["nodes"], *tree["meshes"][0]["primitives"], *tree["bufferViews"]):
        each["extensions"] = {name: {}}


REFUSED = [(kind[1:], field) for kind, rows in FIELDS.items() for field in rows[1].split()]


@pytest.mark.parametrize(("kind", "field"), REFUSED)
def test_a_field_that_nobody_follows_is_refused_by_its_name(kind: str, field: str) -> None:
    assert f"`{field}`" in Path("docs/reference/grounds.md").read_text()
    with refuses(field):
        read(holding(kind, field), kind)


def test_what_a_glb_requires_is_asked_and_a_mirror_turns_its_faces_round() -> None:
    whole = content(trimesh.creation.box([1.0, 2.0, 3.0]), "glb")
    for name, taken in (("KHR_materials_unlit", True), ("EXT_mesh_gpu_instancing", False)):
        required = glb_with(whole, lambda tree, name=name: tree.update(extensionsRequired=[name]))
        with nullcontext() if taken else refuses("extensionsRequired", name):
            assert len(read(required, "glb")[1]) == 12
    for scale, volume in (([1, 1, 1], 6.0), ([-1, 1, 1], 6.0), ([-2, -1, 1], 12.0)):
        place = {"mesh": 0, "scale": scale}
        mirrored = glb_with(whole, lambda tree, p=place: tree.update(nodes=[p], scenes=[]))
        corners, triangles = read(mirrored, "glb")
        assert np.linalg.det(corners[triangles]).sum() / 6.0 == pytest.approx(volume)


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
