"""GLB files (glTF 2.0 in one file): the triangles of all meshes where the scene's nodes place
them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files.arrays import Array
from ...files.documents import decoded, parse_json, shown
from .numbers import (
    Node,
    Surface,
    broken,
    check_count,
    check_fields,
    fans,
    joined,
    so_many,
    strip,
    walked,
)

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_AT_REST = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
_HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_mesh_quantization",
    "EXT_texture_",
    "MSFT_texture_",
)
"""Beginnings of extensions that a file may require without a corner being elsewhere."""


def read_glb(content: bytes, most: int) -> Surface:
    """Corners and triangles of the default scene; of all nodes without a parent where there is no
    scene.

    Raises InvalidInput for a damaged file, one that names others, and one whose meshes are
    compressed.
    """
    tree, binary = _chunks(content)
    needed = tree.get("extensionsRequired", [])
    if not isinstance(needed, list) or not all(isinstance(name, str) for name in needed):
        raise broken(f"extensionsRequired: expected a list of names, got {shown(needed)}")
    if odd := [name for name in needed if not name.startswith(_HARMLESS)]:
        raise broken(f"extensionsRequired: expected ones that are known here, got {odd[0]}")
    for item in (*_objects(tree, "buffers"), *_objects(tree, "images"), *_objects(tree, "meshes")):
        check_fields(".glb", item)
    return _Scene(tree, binary, most).surface()


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    if len(content) < 20 or content[:4] != b"glTF":
        raise broken("its first bytes are not glTF's")
    version, length, size, kind = struct.unpack("<IIII", content[4:20])
    if version != 2:
        raise broken(f"expected version 2 of glTF, got {version}")
    if kind != 0x4E4F534A or size > len(content) - 20:
        raise broken("its first chunk is no JSON")
    if length > len(content):
        raise broken(f"its header declares {length} bytes, and it has {len(content)}")
    tree = parse_json(decoded(content[20 : 20 + size], "JSON").rstrip("\0 "), "JSON")
    if not isinstance(tree, dict):
        raise broken("its JSON is no object")
    at = 20 + size
    if len(content) < at + 8:
        return tree, b""
    size, kind = struct.unpack("<II", content[at : at + 8])
    if kind != 0x004E4942 or size > len(content) - at - 8:
        raise broken("its second chunk is not the bytes that it declares")
    return tree, content[at + 8 : at + 8 + size]


def _objects(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    objects = tree.get(name, [])
    if not isinstance(objects, list) or not all(isinstance(item, dict) for item in objects):
        raise broken(f"{name}: expected a list of objects")
    return objects


def _extensions(item: dict[str, Any]) -> tuple[str, ...]:
    """Names of an object's extensions."""
    extensions = item.get("extensions", {})
    return tuple(extensions) if isinstance(extensions, dict) else ()


def _whole(item: dict[str, Any], name: str, most: int, default: int | None = None) -> int:
    """A whole number of an object, from 0 to below ``most``.

    Raises InvalidInput.
    """
    number = item.get(name, default)
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < most:
        raise broken(f"{name}: expected a whole number below {most}, got {shown(number)}")
    return number


class _Scene:
    """The meshes of a file; bytes are looked at where a node places them."""

    def __init__(self, tree: dict[str, Any], binary: bytes, most: int) -> None:
        self._tree, self._binary, self._left = tree, binary, most
        self._most, self._nodes = most, _objects(tree, "nodes")
        self._meshes, self._views = _objects(tree, "meshes"), _objects(tree, "bufferViews")
        self._accessors = _objects(tree, "accessors")
        self._known = dict[int, list[Surface]]()

    def surface(self) -> Surface:
        """All of it, in one."""
        return joined(self._placed())

    def _placed(self) -> Iterator[Surface]:
        """The meshes of the nodes, each placed by its node and those above it."""
        if not self._nodes:
            for mesh in range(len(self._meshes)):
                yield from self._of_mesh(mesh)
            return
        yield from walked(self._roots(), self._node)

    def _node(self, number: int) -> Node[int]:
        node, surfaces = self._nodes[number], list[Surface]()
        check_fields(".glb", {*node, *_extensions(node)})
        if "mesh" in node:
            surfaces = self._of_mesh(_whole(node, "mesh", len(self._meshes)))
        return _matrix(node), surfaces, self._numbers(node, "children")

    def _roots(self) -> list[int]:
        scenes = _objects(self._tree, "scenes")
        if scenes:
            return self._numbers(scenes[_whole(self._tree, "scene", len(scenes), 0)], "nodes")
        children = {child for node in self._nodes for child in self._numbers(node, "children")}
        return [number for number in range(len(self._nodes)) if number not in children]

    def _numbers(self, item: dict[str, Any], name: str) -> list[int]:
        numbers = item.get(name, [])
        if not isinstance(numbers, list):
            raise broken(f"{name}: expected a list of nodes")
        return [_whole({name: each}, name, len(self._nodes)) for each in numbers]

    def _of_mesh(self, number: int) -> list[Surface]:
        """The surfaces of a mesh; counted anew each time that it is placed, read once."""
        if number not in self._known:
            parts = _objects(self._meshes[number], "primitives")
            self._known[number] = [
                surface for part in parts if (surface := self._of_part(part)) is not None
            ]
        surfaces = self._known[number]
        self._left -= sum(len(triangles) for _, triangles in surfaces)
        check_count(self._most - self._left, self._most)
        return surfaces

    def _of_part(self, part: dict[str, Any]) -> Surface | None:
        """Corners and triangles of a primitive; None for points and lines."""
        mode = _whole(part, "mode", 7, 4)
        if mode < 4:
            return None
        attributes = part.get("attributes")
        check_fields(".glb", _extensions(part))
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            raise broken("expected a POSITION of every primitive")
        corners = self._values(_whole(attributes, "POSITION", len(self._accessors)), "VEC3").astype(
            np.float64
        )
        count = len(corners)
        numbers = np.arange(count)
        if "indices" in part:
            numbers = (
                self._values(_whole(part, "indices", len(self._accessors)), "SCALAR")
                .ravel()
                .astype(np.int64)
            )
        if len(numbers) and not (numbers.min() >= 0 and numbers.max() < count):
            raise broken(f"its triangles are not all of its {count} corners")
        if mode == 4:
            check_count(len(numbers) // 3, self._left)
            return corners, numbers[: len(numbers) // 3 * 3].reshape(-1, 3).astype(np.int_)
        if mode == 5:
            return corners, strip(numbers, self._left)
        return corners, fans(np.array([len(numbers)]), numbers, self._left)

    def _values(self, number: int, kind: str) -> NDArray[Any]:
        """The values of an accessor, shape (count, width)."""
        accessor, size = self._accessors[number], len(self._binary)
        component, width = accessor.get("componentType"), _WIDTHS[kind]
        if (
            accessor.get("type") != kind
            or not isinstance(component, int)
            or component not in _COMPONENTS
        ):
            raise broken(
                f"accessors[{number}]: expected numbers as {kind}, got "
                f"{shown(accessor.get('type'))}"
            )
        check_fields(".glb", accessor)
        view = self._views[_whole(accessor, "bufferView", len(self._views))]
        check_fields(".glb", _extensions(view))
        dtype = np.dtype(_COMPONENTS[component])
        if kind == "SCALAR" and dtype.kind == "f":
            raise broken(f"accessors[{number}]: expected whole numbers")
        _whole(view, "buffer", 1)
        begin, length = (
            _whole(view, "byteOffset", size + 1, 0),
            _whole(view, "byteLength", size + 1),
        )
        offset = _whole(accessor, "byteOffset", size + 1, 0)
        count = _whole(accessor, "count", size + 1)
        row = width * dtype.itemsize
        stride = _whole(view, "byteStride", 253, row) or row
        if (
            stride < row
            or (count and offset + (count - 1) * stride + row > length)
            or begin + length > size
        ):
            raise broken(
                f"accessors[{number}]: expected {count} values within the bytes of its view, got "
                f"{length} bytes"
            )
        strides = (stride, dtype.itemsize)
        values = (
            np.ndarray((count, width), dtype, self._binary, begin + offset, strides)
            if count
            else np.zeros((0, width))
        )
        if accessor.get("normalized") is True and dtype.kind != "f":
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values


def _matrix(node: dict[str, Any]) -> Array:
    """Transformation from a node to the one above it, shape (4, 4)."""
    if "matrix" in node:
        return so_many(node["matrix"], 16, "matrix").reshape(4, 4).T
    translation, rotation, scale = (
        so_many(node.get(name, rest), len(rest), name) for name, rest in _AT_REST.items()
    )
    if not 0.0 < np.linalg.norm(rotation) < np.inf:
        raise broken("expected a rotation that is a quaternion")
    from scipy.spatial.transform import Rotation  # slow to import

    place = np.eye(4)
    place[:3, :3] = Rotation.from_quat(rotation).as_matrix() * scale
    place[:3, 3] = translation
    return place
