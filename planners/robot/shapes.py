"""Shapes of a robot's links: their meshes, and the pairs that may touch."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..files.documents import shown

Kind = Literal["sphere", "box", "cylinder", "capsule", "mesh"]
PACKAGE_PATHS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
SIZES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """One shape of a link, in the link's frame.

    Arguments:
        size_m: radius; or sides; or radius and length along z, shape (1,), (3,), (2,) [m]; of a
            mesh its scale, shape (3,).
        rotation, origin_m: pose of the shape in the link, shapes (3, 3), (3,) [m].
        mesh: path of its mesh, or None if none was found.
        collides: is it the link's body, or only what it looks like? corners_m: of a mesh that is a
            link's body the corners of its convex hull, at its scale, in the shape's own frame,
            shape (K, 3) [m]; None where they are not known.
        parts_m: corners of convex parts that together contain the mesh, likewise, if its hull is
            much larger than the mesh.
    """

    link: str
    kind: Kind
    size_m: Array
    rotation: Array
    origin_m: Array
    collides: bool
    mesh: Path | None = None
    corners_m: Array | None = None
    parts_m: tuple[Array, ...] = ()

    def __post_init__(self) -> None:
        if self.parts_m:
            where = f"link {shown(self.link)}: part of the hull"
            object.__setattr__(
                self, "parts_m", tuple(read_only(part, (None, 3), where) for part in self.parts_m)
            )
        if self.corners_m is not None:
            corners = read_only(self.corners_m, (None, 3), f"link {shown(self.link)}: hull")
            object.__setattr__(self, "corners_m", corners)

    @property
    def far_m(self) -> Array:
        """The point of a round or boxed shape that is farthest from the link's origin, about, shape
        (3,) [m].
        """
        half = {"sphere": [0, 0, 0], "box": 0.5 * self.size_m, "mesh": [0, 0, 0]}.get(self.kind)
        corner = (
            np.array([0.0, 0.0, 0.5 * self.size_m[-1]])
            if half is None
            else np.asarray(half, dtype=np.float64)
        )
        ends = self.rotation @ np.diag(corner)
        out = np.sign(ends.T @ self.origin_m)
        longest = int(np.argmax(corner))
        return np.asarray(self.origin_m + ends[:, longest] * (out[longest] or 1.0))


def shapes_of(
    root: Element, folder: Path | None, packages: Sequence[Path]
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """All shapes of a URDF, and the names of the meshes that are not there.

    Arguments:
        folder: folder of the URDF; None to look for no meshes.
        packages: folders in which ``package://NAME`` is a folder, or which are that package.

    Raises:
        InvalidInput: for sizes that no shape has.
    """
    names = dict.fromkeys(mesh.get("filename", "") for mesh in root.findall("link/*/geometry/mesh"))
    files = {name: None if folder is None else mesh_file(name, folder, packages) for name in names}
    shapes = tuple(_shape(*each, files) for each in shape_elements(root))
    return shapes, () if folder is None else tuple(name for name in files if files[name] is None)


def shape_elements(root: Element) -> list[tuple[str, Element, bool]]:
    """Link, element and whether it collides, of every shape of a URDF in their order."""
    return [
        (link.get("name", ""), element, what == "collision")
        for link in root.findall("link")
        for what in ("collision", "visual")
        for element in link.findall(what)
        if (body := element.find("geometry/*")) is not None and body.tag in (*SIZES, "mesh")
    ]


def mesh_file(name: str, folder: Path, packages: Sequence[Path] = ()) -> Path | None:
    """The file of a mesh, or None where there is none.

    ``package://NAME/rest`` is looked for in ``packages``, in the URDF's folder and those above it,
    and where ROS has its packages, and then from a folder above the URDF that ``rest`` names; other
    names from the URDF's folder.
    """
    try:
        return next((path for path in _places(name, folder, packages) if path.is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None


def _places(name: str, folder: Path, packages: Sequence[Path]) -> Iterator[Path]:
    scheme, colon, rest = name.partition("://")
    if not colon:
        yield folder / name
        yield from (each / name for each in packages)
        return
    if scheme == "file":
        yield Path(rest)
        return
    package, _, inside = rest.partition("/")
    here = folder.resolve()
    for place in (*packages, here, *here.parents, *_ros_places()):
        if place.name == package:
            yield place / inside
        yield place / package / inside
    folders = Path(inside).parts[
        :-1
    ]  # the URDF's folder was copied out of its package: from a folder it still has
    for place in (here, *here.parents):
        if place.name in folders and ".." not in folders:
            yield place.joinpath(*Path(inside).parts[folders.index(place.name) + 1 :])


def _ros_places() -> Iterator[Path]:
    for variable in PACKAGE_PATHS:
        for text in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(text) / "share" if variable.startswith("AMENT") else Path(text)


def disabled_pairs(root: Element) -> frozenset[frozenset[str]]:
    """Pairs of links that an SRDF lets touch, or that never do."""
    pairs = (
        frozenset((pair.get("link1", ""), pair.get("link2", "")))
        for pair in root.findall("disable_collisions")
    )
    return frozenset(pairs)


def _shape(link: str, element: Element, collides: bool, meshes: Mapping[str, Path | None]) -> Shape:
    body = element.find("geometry/*")
    assert body is not None
    where = f"link {shown(link)}: {body.tag}"
    mesh = None
    if body.tag == "mesh":
        size, mesh = (
            numbers_of(body.get("scale", "1 1 1"), 3, where),
            meshes[body.get("filename", "")],
        )
    else:
        size = [
            x
            for key in SIZES[body.tag]
            for x in numbers_of(body.get(key, ""), 3 if key == "size" else 1, where)
        ]
        if min(size) < 0.0:
            raise InvalidInput(f"{where}: expected sizes of 0 or more, got {min(size):g}")
    rotation, origin = pose_of(element.find("origin"), where)
    kind: Kind = body.tag  # type: ignore[assignment]
    return Shape(
        link=link,
        kind=kind,
        size_m=read_only(size, (None,), where),
        rotation=rotation,
        origin_m=origin,
        collides=collides,
        mesh=mesh,
    )


def pose_of(origin: Element | None, where: str) -> tuple[Array, Array]:
    """R and p of a URDF's <origin>, shapes (3, 3), (3,) [m]: roll, pitch, yaw about fixed axes."""
    place = numbers_of("0 0 0" if origin is None else origin.get("xyz", "0 0 0"), 3, where)
    angles = numbers_of("0 0 0" if origin is None else origin.get("rpy", "0 0 0"), 3, where)
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    turn = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return read_only(turn, (3, 3), where), read_only(place, (3,), where)


def write_pose(element: Element, turn: Array, place: Array) -> None:
    """Write a pose as a URDF's <origin> below an element: R, shape (3, 3), as roll, pitch and yaw,
    and p, shape (3,) [m].
    """
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], level)
    if level > 1e-9:
        roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = 0.0, np.arctan2(-turn[0, 1], turn[1, 1])
    SubElement(element, "origin", xyz=text_of(place), rpy=text_of([roll, pitch, yaw]))


def text_of(values: Iterable[float]) -> str:
    """Numbers as a URDF has them, to the last bit."""
    return " ".join(repr(float(value)) for value in values)


def numbers_of(text: str, count: int, where: str) -> list[float]:
    """The numbers of a URDF's attribute.

    Raises InvalidInput for any other count of them, and for what is no number.
    """
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InvalidInput(f"{where}: expected {count} numbers, got {shown(text)}")
    return numbers
