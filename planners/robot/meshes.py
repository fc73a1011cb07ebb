"""Meshes of a robot's links, as pictures need them: of few triangles, and kept on disk once
thinned.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal, TypeVar
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, archive_of, locked, read_archive, read_only
from ..files.documents import read_bytes, shown
from ..files.writing import cache_folder, write_bytes
from ..terrain.mesh_formats.numbers import MOST_BYTES

Kind = Literal["sphere", "box", "cylinder", "capsule", "mesh"]
_PACKAGE_PATHS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
_SIZES: dict[str, tuple[str, ...]] = {
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

    @cached_property
    def points_m(self) -> Array | None:
        """Points whose hull is the shape, in its own frame, shape (K, 3) [m]; None for a mesh
        without a hull.
        """
        return self.corners_m if self.kind == "mesh" else locked(_points_of(self.kind, self.size_m))

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
    files = {name: None if folder is None else _mesh_file(name, folder, packages) for name in names}
    shapes = tuple(_shape(*each, files) for each in shape_elements(root))
    return shapes, () if folder is None else tuple(name for name in files if files[name] is None)


def shape_elements(root: Element) -> list[tuple[str, Element, bool]]:
    """Link, element and whether it collides, of every shape of a URDF in their order."""
    return [
        (link.get("name", ""), element, what == "collision")
        for link in root.findall("link")
        for what in ("collision", "visual")
        for element in link.findall(what)
        if (body := element.find("geometry/*")) is not None and body.tag in (*_SIZES, "mesh")
    ]


def unknown_shapes(root: Element) -> Iterator[tuple[str, str]]:
    """Link and kind of every shape of a URDF that is none of those that are known."""
    for link in root.findall("link"):
        for element in link.findall("collision") or link.findall("visual"):
            body = element.find("geometry/*")
            if body is None or body.tag not in (*_SIZES, "mesh"):
                yield link.get("name", ""), "nothing" if body is None else body.tag


def remove_empty_shapes(root: Element) -> list[str]:
    """Take out balls, boxes, cylinders and capsules of which a size is 0, which no simulator has; the
    links that had one.
    """
    gone = list[str]()
    for link, element, _ in shape_elements(root):
        body = element.find("geometry/*")
        assert body is not None
        texts = " ".join(body.get(key, "") for key in _SIZES.get(body.tag, ())).split()
        with suppress(ValueError):  # told where shapes are read
            if 0.0 in map(float, texts):
                next(each for each in root.iterfind("link") if element in each).remove(element)
                gone.append(link)
    return gone


def _mesh_file(name: str, folder: Path, packages: Sequence[Path] = ()) -> Path | None:
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
    for variable in _PACKAGE_PATHS:
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
            for key in _SIZES[body.tag]
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


_CORNERS = 24
"""Corners of the polygon that stands for a circle."""
_RINGS = 10
"""Rings of a sphere, from pole to pole."""


def solid_shapes(shapes: Sequence[Shape]) -> list[Shape]:
    """For each link the shapes that it collides with, or where there are none what it looks
    like.
    """
    bodies = {shape.link for shape in shapes if shape.collides}
    return [shape for shape in shapes if shape.collides or shape.link not in bodies]


def _points_of(kind: Kind, size_m: Array) -> Array:
    """Points whose hull is a shape that is no mesh, shape (K, 3) [m]."""
    if kind == "box":
        return np.asarray(np.array(list(product((-0.5, 0.5), repeat=3))) * size_m)
    radius = float(size_m[0])
    half = 0.5 * float(size_m[1]) if len(size_m) > 1 else 0.0
    turn = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    rim = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_CORNERS)])
    if kind == "cylinder":
        return np.vstack([rim + np.array([0.0, 0.0, end]) for end in (-half, half)])
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _RINGS)
    rings = np.cos(angle)[:, None, None] * rim
    rings[..., 2] += (radius * np.sin(angle) + np.sign(angle) * half)[:, None]
    return rings.reshape(-1, 3)


def link_points(shape: Shape) -> Array | None:
    """``Shape.points_m`` in the link's frame."""
    points = shape.points_m
    return None if points is None else np.asarray(shape.origin_m + points @ shape.rotation.T)


def surface_points(points: Array, apart_m: float) -> Array:
    """Points all over the hull of others, shape (K, 3), not much farther apart than this, shape (P,
    3) [m].
    """
    from scipy.spatial import ConvexHull  # slow to import

    hull = ConvexHull(points)
    every = _all_over(points[hull.vertices], points[hull.simplices], apart_m)
    return np.asarray(every[np.union1d(_apart(every, apart_m), np.arange(len(hull.vertices)))])


def points_on(triangles: Array, apart_m: float) -> Array:
    """Points all over triangles, shape (F, 3, 3), not much farther apart than this, shape (P, 3)
    [m].
    """
    every = _all_over(triangles.reshape(-1, 3), triangles, apart_m)
    return np.asarray(every[_apart(every, apart_m)])


def _all_over(corners: Array, triangles: Array, apart_m: float) -> Array:
    """Corners, and points on triangles that are larger than this."""
    points = [corners]
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    for pieces in np.unique(np.ceil(sides / apart_m)).astype(int):
        if pieces > 1:
            part = triangles[np.ceil(sides / apart_m) == pieces]
            i, j = np.triu_indices(pieces + 1)
            shares = np.stack([i, j - i, pieces - j], axis=1) / pieces
            points.append(np.einsum("sk,tkj->tsj", shares, part).reshape(-1, 3))
    return np.concatenate(points)


def _apart(points: Array, apart_m: float) -> NDArray[np.int_]:
    """Thin out points: lay a grid of cells half as wide as ``apart_m`` [m] over them, and return
    the indices of the first point in each cell.
    """
    cells = np.round(points / (0.5 * apart_m))
    ranks = [np.unique(axis, return_inverse=True)[1] for axis in cells.T]
    number = np.ravel_multi_index(ranks, [int(rank.max(initial=0)) + 1 for rank in ranks])
    return np.asarray(np.unique(number, return_index=True)[1])


_VERSION = "mesh/2"
"""Part of every digest: a change of method changes it, and older files are no longer found."""
_FINEST, _COARSER = 96, 0.85
"""Cells along a mesh's longest side at first, and by how much fewer there are at every further
try."""
_DISAGREE = 0.02
"""Share of edges at which two faces turn opposite ways, beyond which nobody knows which side of a
mesh is outside."""

Value = TypeVar("Value")


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangles:
    """A surface: vertices_m, shape (V, 3) [m], and faces, corners by index, shape (F, 3)."""

    vertices_m: Array
    faces: Any


def read_mesh(path: Path, scale: Array) -> Triangles:
    """All of a mesh's file at a scale, each corner once.

    Raises InvalidInput as ``read_corners`` does.
    """
    from ..terrain.mesh_file import read_corners  # slow to import

    corners, faces = read_corners(path)
    first, number = _different(corners)
    return Triangles(vertices_m=corners[first] * scale, faces=number[faces])


def _different(points: Array) -> tuple[Any, Any]:
    """The first of each point that is there several times, and which of those each point is.

    Points are told apart by a hash, as sorting their coordinates takes ten times as long, and then
    compared.
    """
    bits = (points + 0.0).view(np.uint64)  # one zero for both
    mixed = bits * np.array(
        [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64
    )
    hashes = np.bitwise_xor.reduce(mixed ^ (mixed >> np.uint64(29)), axis=1)
    _, first, number = np.unique(hashes, return_index=True, return_inverse=True)
    if np.array_equal(points[first][number], points):
        return first, number
    _, first, number = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first, number.reshape(-1)


def thinned_mesh(path: Path, scale: Array, most: int) -> Triangles:
    """A mesh of ``most`` triangles or fewer, to the left from outside, kept by the digest of its
    file. One whose faces disagree has all of them twice, seen from either side.

    Raises InvalidInput where it cannot be had.
    """

    def made() -> dict[str, Any]:
        mesh = faced_outward(thinned(read_mesh(path, scale), most))
        return {"vertices": np.float32(mesh.vertices_m), "faces": np.int32(mesh.faces)}

    said = f"{_VERSION}\0{most}\0{np.asarray(scale).tolist()}\0".encode()
    said += read_bytes(path, MOST_BYTES)
    return kept("meshes/", said, made, lambda each: _checked(each["vertices"], each["faces"]))


def kept(
    where: str,
    said: bytes,
    make: Callable[[], Mapping[str, Any]],
    read: Callable[[Mapping[str, Array]], Value],
) -> Value:
    """Read arrays that were kept, or else make and keep them.

    Arguments:
        where: beginning of the file's name in the folder of what is kept.
        said: all that they depend on, e.g. a mesh's file and what is made of it.
        make: the arrays.
        read: raises InvalidInput, KeyError or ValueError for arrays that are damaged, which are
            made anew.
    """
    file = cache_folder() / f"{where}{hashlib.sha256(said).hexdigest()}.npz"
    with suppress(InvalidInput, KeyError, ValueError):
        return read(read_archive(file))
    arrays = make()
    with suppress(InvalidInput, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(file, archive_of(arrays))
    return read(arrays)


def unseen(shapes: Sequence[Shape], most: int) -> list[str]:
    """Doubts on meshes that are no body, and cannot be drawn with ``most`` triangles: the links
    that look like them, the file, and why, in a line per mesh. Meshes that are bodies have doubts
    of their own.
    """
    bodies, links = (
        {id(shape) for shape in solid_shapes(shapes)},
        dict[tuple[Path, bytes], list[Shape]](),
    )
    for shape in shapes:
        if shape.mesh is not None and id(shape) not in bodies:
            links.setdefault((shape.mesh, shape.size_m.tobytes()), []).append(shape)
    missing = []
    for (path, _), links_of_mesh in links.items():
        try:
            thinned_mesh(path, links_of_mesh[0].size_m, most)
        except InvalidInput as error:
            why = str(error).removeprefix(f"{path}: ")
            names = ", ".join(dict.fromkeys(shape.link for shape in links_of_mesh))
            missing.append(f"link {names}: not in the picture, mesh {shown(path.name)}: {why}")
    return missing


def _checked(vertices: Any, faces: Any) -> Triangles:
    """Check the triangles that were kept.

    Raises InvalidInput for a file that something else has written.
    """
    points = read_only(vertices, (None, 3), "vertices")
    whole = faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind == "i"
    if not whole or not np.all((faces >= 0) & (faces < len(points))):
        raise InvalidInput(
            f"faces: expected corners of {len(points)} vertices by index, got something else"
        )
    return Triangles(vertices_m=points, faces=faces.astype(np.int64))


def thinned(mesh: Triangles, most: int) -> Triangles:
    """The mesh with ``most`` triangles or fewer: vertices in one cell of a grid become one, in
    their middle (Rossignac and Borrel, 1993), the grid as fine as may be. Needs no mesh that is
    closed or clean.
    """
    cells = float(_FINEST)
    low, size = mesh.vertices_m.min(axis=0), float(np.ptp(mesh.vertices_m, axis=0).max())
    coarser = mesh
    while len(coarser.faces) > most and cells >= 2.0 and size > 0.0:
        cell = np.floor((mesh.vertices_m - low) * (cells / size)).astype(np.int64)
        _, cell_of = np.unique(cell, axis=0, return_inverse=True)
        cell_of = cell_of.reshape(-1)
        count = np.bincount(cell_of)
        middle = np.stack(
            [np.bincount(cell_of, mesh.vertices_m[:, k]) / count for k in range(3)], axis=1
        )
        faces = cell_of[mesh.faces]
        apart = (
            (faces[:, 0] != faces[:, 1])
            & (faces[:, 1] != faces[:, 2])
            & (faces[:, 2] != faces[:, 0])
        )
        faces = faces[apart]
        _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        coarser = Triangles(vertices_m=middle, faces=faces[np.sort(first)])
        cells *= _COARSER
    return coarser


def faced_outward(mesh: Triangles) -> Triangles:
    """The mesh with its faces to the left as seen from outside, whichever way it was written or
    mirrored; where faces disagree, each of them from both sides.
    """
    faces, count = mesh.faces, len(mesh.vertices_m)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, edge, uses = np.unique(
        np.sort(ends, axis=1) @ [count, 1], return_inverse=True, return_counts=True
    )
    ahead = np.bincount(edge, ends[:, 0] < ends[:, 1])
    pairs = uses == 2
    if int(np.count_nonzero(pairs & (ahead != 1))) > _DISAGREE * int(np.count_nonzero(pairs)):
        both = np.vstack([faces, faces[:, ::-1] + count])
        return Triangles(vertices_m=np.vstack([mesh.vertices_m, mesh.vertices_m]), faces=both)
    corners = (mesh.vertices_m - mesh.vertices_m.mean(axis=0))[faces]
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    return mesh if volume >= 0.0 else Triangles(vertices_m=mesh.vertices_m, faces=faces[:, ::-1])
