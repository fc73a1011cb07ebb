"""COLLADA files (.dae): triangles and polygons of all geometries where the scene's nodes place
them.

Corners are in metres by the unit that the file states. Its axis up is left to whoever asks, as
readers of robots' files leave it.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from ...files.arrays import Array
from ...files.documents import parse_xml, shown
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
    corners, triangles = _Scene(root, most).surface()
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
    """The geometries of a file, by their names, and the nodes that place them."""

    def __init__(self, root: Element, most: int) -> None:
        self._most, self._left, self._root = most, most, root
        self._named = {name: element for element in root.iter() if (name := element.get("id"))}
        self._known = dict[str, list[Surface]]()

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
        return _matrix(node), surfaces, below

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
        """The surfaces of a geometry; counted anew each time that it is placed, read once."""
        if name not in self._known:
            check_fields(".dae", [each.tag for each in geometry.iter()])
            meshes = geometry.findall("mesh")
            parts = [(mesh, part) for mesh in meshes for part in mesh if part.tag in _POLYGONS]
            self._known[name] = [self._of_part(mesh, part) for mesh, part in parts]
        self._left -= sum(len(triangles) for _, triangles in self._known[name])
        check_count(self._most - self._left, self._most)
        return self._known[name]

    def _of_part(self, mesh: Element, part: Element) -> Surface:
        """Corners and triangles of one list of polygons."""
        inputs = [
            (each.get("semantic"), _whole(each, "offset", 0, 100), each)
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
            _whole(accessor, "stride", 1, 1000),
            _whole(accessor, "offset", 0, len(values) + 1),
        )
        count = _whole(accessor, "count", 0, len(values) + 1)
        if stride < 3 or offset + count * stride > len(values):
            raise broken(
                f"its POSITION declares {count} corners of {stride} numbers, and has {len(values)}"
            )
        return values[offset : offset + count * stride].reshape(-1, stride)[:, :3]


def _whole(element: Element, name: str, default: int, most: int) -> int:
    """A whole number from 0 to below ``most`` in an attribute.

    Raises InvalidInput.
    """
    text = element.get(name, str(default)).strip()
    if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) < most):
        raise broken(f"{name}: expected a whole number below {most}, got {shown(text)}")
    return int(text)


def _matrix(node: Element) -> Array:
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
