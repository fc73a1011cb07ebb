"""Mesh files whose nodes place what they hold.

COLLADA files (.dae) have triangles and polygons of geometries. Corners are in metres by the unit that
the file states; its axis up is left to whoever asks, as readers of robots' files leave it. GLB files
are glTF 2.0 in one file, with the triangles of meshes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from ...files.arrays import Array
from ...files.documents import decoded, parse_json, parse_xml, shown
from .numbers import (
    Node,
    Surface,
    Triangles,
    broken,
    check_count,
    check_fields,
    fans,
    joined,
    moved,
    polygons,
    reals_of,
    so_many,
    strip,
    walked,
    wholes_of,
)

_DEEPEST = 60
_POLYGONS = ("triangles", "polylist", "polygons", "trifans", "tristrips")


def read_collada(content: bytes, most: int) -> Surface:
    """Corners and triangles of the scene; of every geometry where the file has no scene.

    Raises InvalidInput.
    """
    root = parse_xml(content, "COLLADA", deepest=_DEEPEST)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    corners, triangles = _ColladaScene(root, most).surface()
    return _metres(root) * corners, triangles


def _metres(root: Element) -> float:
    """Metres of the file's unit, 1 where it says none.

    Raises InvalidInput for what is no length.
    """
    unit = root.find("asset/unit")
    metres = reals_of(("1" if unit is None else unit.get("meter", "1")).encode())
    if metres.shape != (1,) or not 0.0 < metres[0] < np.inf:
        raise broken(f"unit: expected a length above 0 m, got {shown(metres.tolist())}")
    return float(metres[0])


class _Scene:
    """Surfaces by name, read once, and counted anew each time that they are placed."""

    def __init__(self, most: int) -> None:
        self._most, self._left, self._known = most, most, dict[str | int, list[Surface]]()

    def _counted(self, surfaces: list[Surface]) -> list[Surface]:
        """Surfaces that are placed.

        Raises InvalidInput where they are too many with those before.
        """
        self._left -= sum(len(triangles) for _, triangles in surfaces)
        check_count(self._most - self._left, self._most)
        return surfaces


class _ColladaScene(_Scene):
    """The geometries of a file, by their names, and the nodes that place them."""

    def __init__(self, root: Element, most: int) -> None:
        super().__init__(most)
        self._root = root
        self._named = {name: element for element in root.iter() if (name := element.get("id"))}

    def surface(self) -> Surface:
        """All of it, in one."""
        return joined(self._placed())

    def _placed(self) -> Iterator[Surface]:
        scene = self._root.find("scene/instance_visual_scene")
        if scene is None:
            for number, geometry in enumerate(self._root.findall("library_geometries/geometry")):
                yield from self._of_geometry(geometry.get("id", f"\0{number}"), geometry)
            return
        yield from walked([self._meant(scene.get("url", ""), "visual_scene")], self._node)

    def _node(self, node: Element) -> Node[Element]:
        check_fields(".dae", [each.tag for each in node])
        below, surfaces = node.findall("node"), list[Surface]()
        below += [
            self._meant(each.get("url", ""), "node") for each in node.findall("instance_node")
        ]
        for each in node:
            if each.tag in ("instance_geometry", "instance_controller"):
                surfaces += self._instance(each)
        return _place_of(node), surfaces, below

    def _meant(self, url: str, tag: str) -> Element:
        """The element that a reference names.

        Raises InvalidInput unless it is there, and of this kind.
        """
        element = self._named.get(url.removeprefix("#")) if url.startswith("#") else None
        if element is None or element.tag != tag:
            raise broken(f"expected a {tag} of the file, got {shown(url)}")
        return element

    def _instance(self, element: Element) -> list[Surface]:
        """The surfaces of a geometry, or of one under a skin as it is bound."""
        url, place = element.get("url", ""), np.eye(4)
        if element.tag == "instance_controller":
            controller = self._meant(url, "controller")
            check_fields(".dae", [each.tag for each in controller])
            if (skin := controller.find("skin")) is None:
                return []
            url = skin.get("source", "")
            if (bound := skin.findtext("bind_shape_matrix")) is not None:
                place = _transformation("matrix", reals_of(bound.encode()))
        surfaces = self._of_geometry(url.removeprefix("#"), self._meant(url, "geometry"))
        return [(moved(corners, place), triangles) for corners, triangles in surfaces]

    def _of_geometry(self, name: str, geometry: Element) -> list[Surface]:
        """The surfaces of a geometry."""
        if name not in self._known:
            check_fields(".dae", [each.tag for each in geometry.iter()])
            meshes = geometry.findall("mesh")
            parts = [(mesh, part) for mesh in meshes for part in mesh if part.tag in _POLYGONS]
            self._known[name] = [self._of_part(mesh, part) for mesh, part in parts]
        return self._counted(self._known[name])

    def _of_part(self, mesh: Element, part: Element) -> Surface:
        """Corners and triangles of one list of polygons."""
        inputs = [
            (each.get("semantic"), _whole_of(each, "offset", 0, 100), each)
            for each in part.findall("input")
        ]
        vertex = next((source for source in inputs if source[0] == "VERTEX"), None)
        if vertex is None:
            raise broken("expected polygons with an input VERTEX")
        corners, stride = self._corners(mesh, vertex[2]), 1 + max(offset for _, offset, _ in inputs)
        lists = [wholes_of((p.text or "").encode()) for p in part.iter("p")]
        if any(len(each) % stride for each in lists):
            raise broken(f"expected {stride} numbers per corner of a polygon")
        lists = [each[vertex[1] :: stride] for each in lists]
        every = np.concatenate([np.zeros(0, dtype=np.int64), *lists])
        if len(every) and not (every.min() >= 0 and every.max() < len(corners)):
            raise broken(f"its polygons are not all of its {len(corners)} corners")
        return corners, self._triangles(part, lists, every, corners)

    def _triangles(
        self,
        part: Element,
        lists: list[NDArray[np.int64]],
        every: NDArray[np.int64],
        corners: Array,
    ) -> Triangles:
        if part.tag == "triangles":
            check_count(len(every) // 3, self._left)
            return np.asarray(every[: len(every) // 3 * 3].reshape(-1, 3), dtype=np.int_)
        if part.tag == "tristrips":
            none = np.zeros((0, 3), dtype=np.int_)
            return np.concatenate([none, *(strip(each, self._left) for each in lists)])
        counts = np.array([len(each) for each in lists], dtype=np.int64)
        if part.tag == "trifans":
            return fans(counts, every, self._left)
        if part.tag == "polylist":
            counts = wholes_of((part.findtext("vcount") or "").encode())
            if counts.min(initial=0) < 0 or sum(counts.tolist()) != len(every):
                raise broken("expected as many corners as vcount declares")
        return polygons(counts, every, corners, self._left)

    def _corners(self, mesh: Element, given: Element) -> Array:
        """The positions that an input VERTEX names, shape (V, 3)."""
        elements = {name: element for element in mesh.iter() if (name := element.get("id"))}
        vertices = elements.get(given.get("source", "").removeprefix("#"))
        position = None if vertices is None else vertices.find("input[@semantic='POSITION']")
        source = (
            None if position is None else elements.get(position.get("source", "").removeprefix("#"))
        )
        if source is None:
            raise broken(f"expected vertices with a POSITION, got {shown(given.get('source', ''))}")
        numbers = source.find("float_array")
        accessor = source.find("technique_common/accessor")
        if numbers is None or accessor is None:
            raise broken("expected a float_array and its accessor of every POSITION")
        values = reals_of((numbers.text or "").encode())
        stride, offset = (
            _whole_of(accessor, "stride", 1, 1000),
            _whole_of(accessor, "offset", 0, len(values) + 1),
        )
        count = _whole_of(accessor, "count", 0, len(values) + 1)
        if stride < 3 or offset + count * stride > len(values):
            raise broken(
                f"its POSITION declares {count} corners of {stride} numbers, and has {len(values)}"
            )
        return values[offset : offset + count * stride].reshape(-1, stride)[:, :3]


def _whole_of(element: Element, name: str, default: int, most: int) -> int:
    """A whole number from 0 to below ``most`` in an attribute.

    Raises InvalidInput.
    """
    text = element.get(name, str(default)).strip()
    if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) < most):
        raise broken(f"{name}: expected a whole number below {most}, got {shown(text)}")
    return int(text)


def _place_of(node: Element) -> Array:
    """Transformation from a node to the one above it, shape (4, 4): its transformations in their
    order.
    """
    place = np.eye(4)
    for each in node:
        if each.tag in ("matrix", "translate", "rotate", "scale"):
            place = place @ _transformation(each.tag, reals_of((each.text or "").encode()))
    return place


def _transformation(tag: str, values: Array) -> Array:
    numbers = so_many(values, {"matrix": 16, "rotate": 4}.get(tag, 3), tag)
    if tag == "matrix":
        return numbers.reshape(4, 4)
    from scipy.spatial.transform import Rotation  # slow to import

    place = np.eye(4)
    if tag == "translate":
        place[:3, 3] = numbers
    elif tag == "scale":
        place[:3, :3] = np.diag(numbers)
    elif np.any(numbers[:3]):
        turn = np.deg2rad(numbers[3]) / np.linalg.norm(numbers[:3]) * numbers[:3]
        place[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    return place


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
    return _GlbScene(tree, binary, most).surface()


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


class _GlbScene(_Scene):
    """The meshes of a file; bytes are looked at where a node places them."""

    def __init__(self, tree: dict[str, Any], binary: bytes, most: int) -> None:
        super().__init__(most)
        self._tree, self._binary, self._nodes = tree, binary, _objects(tree, "nodes")
        self._meshes, self._views = _objects(tree, "meshes"), _objects(tree, "bufferViews")
        self._accessors = _objects(tree, "accessors")

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
        """The surfaces of a mesh."""
        if number not in self._known:
            parts = _objects(self._meshes[number], "primitives")
            self._known[number] = [
                surface for part in parts if (surface := self._of_part(part)) is not None
            ]
        return self._counted(self._known[number])

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
