"""Mesh files (STL, OBJ, PLY, DAE, OFF, GLB) of terrains and of robots' links, read in bounds of
size and time.

A MuJoCo scene is a ground, too: what is fixed in its world and collides, as MuJoCo collides with it.
Trees of bodies with joints, such as robots and doors, are left out. MuJoCo takes the convex hull of
each mesh, and so does this.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InvalidInput, installed
from ..files.arrays import Array
from ..files.documents import parse_xml, read_bytes, read_text
from .import_options import doubt
from .mesh_formats.numbers import (
    MOST_BYTES,
    MOST_TRIANGLES,
    Reader,
    Surface,
    TooMany,
    Triangles,
    check_count,
)
from .mesh_formats.ply import read_obj, read_off, read_ply, read_stl
from .mesh_formats.scenes import read_collada, read_glb

READERS: Mapping[str, Reader] = MappingProxyType(
    {
        ".stl": read_stl,
        ".obj": read_obj,
        ".ply": read_ply,
        ".dae": read_collada,
        ".off": read_off,
        ".glb": read_glb,
    }
)
"""The reader of each format, by the ending of a file's name."""

_LARGEST = 1e9
"""A coordinate of a file in any unit."""


def read_corners(
    path: str | Path, most_triangles: int = MOST_TRIANGLES, hint: str = "simplify it"
) -> Surface:
    """Corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners' numbers.

    Arguments:
        most_triangles: more are refused, before memory is asked for them.
        hint: what the message says to do then.

    Raises:
        InvalidInput: for a file that is missing or damaged, that declares more than it holds, whose
            triangles name corners that it does not have, and for one without triangles or with
            corners that are not finite.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        raise InvalidInput(
            f"{path}: expected a mesh that ends in {', '.join(READERS)}, got {suffix or 'none'}"
        )
    content = read_bytes(path, MOST_BYTES)
    try:
        with np.errstate(all="ignore"):  # absurd magnitudes end as corners that are not finite
            corners, triangles = READERS[suffix](content, most_triangles)
    except InvalidInput as error:
        then = f"; {hint}" if isinstance(error, TooMany) else ""
        raise InvalidInput(f"{path}: {error}{then}") from None
    if len(triangles) == 0:
        raise InvalidInput(f"{path}: expected a mesh with triangles, got an empty one")
    if not np.all((triangles >= 0) & (triangles < len(corners))):
        raise InvalidInput(
            f"{path}: expected triangles of the mesh's {len(corners)} corners, got corners beyond them"
        )
    sound = np.abs(corners) <= _LARGEST
    if not np.all(sound):
        raise InvalidInput(
            f"{path}: expected a mesh with finite corners up to {_LARGEST:g}, got {np.sum(~sound)} "
            "numbers that are not"
        )
    return corners, triangles


_LONGEST = 160
"""Letters of a compiler's message that are passed on."""
_BEYOND_M = 10.0
"""A plane, which has no end, goes on so far beyond everything else that is fixed [m]."""
_WIDEST_M = 48.0
"""Where there is room for that on what is no wider than this [m]."""
_AROUND, _UP = 32, 17
"""Points of a circle, and circles of a ball."""
_MOST: dict[str, tuple[tuple[str, ...], float]] = {
    "replicate": (("count",), 2e3),
    "composite": (("count",), 2e3),
    "flexcomp": (("count",), 2e4),
    "mesh": (("params",), 1e4),
    "hfield": (("nrow", "ncol"), 4e6),
    "texture": (("width", "height"), 7e7),
    "size": (("nkey", "nuserdata", "nuser_body", "nuser_jnt", "nuser_geom", "nuser_site"), 1e5),
    "user": (("dim",), 1e5),
    "numeric": (("size",), 1e5),
}
"""By the name of an element the attributes that say how many it makes, and the most in all."""
_MOST_ELEMENTS = 50_000
"""Of a file and those that it includes."""
_HOLLOW = 1.05
"""A mesh whose hull has so many times its volume is hollow."""


def compiled_mjcf(path: Path) -> tuple[Any, set[str], list[str]]:
    """A model as MuJoCo compiles it, without what lies elsewhere: pairs with geoms of a scene that
    the file is meant to be part of, and meshes and textures whose files are not there.

    Returns:
        the model, geoms in such pairs, and names of such meshes.

    Raises:
        InvalidInput: in one line, for what MuJoCo does not compile.
    """
    try:
        every = _elements(parse_xml(read_text(path), "mujoco"), path.parent, (path.resolve(),))
        if len([*itertools.islice(every, _MOST_ELEMENTS + 1)]) > _MOST_ELEMENTS:
            raise InvalidInput(f"expected {_MOST_ELEMENTS} elements or fewer, got more")
    except InvalidInput as error:
        text = str(error)
        raise InvalidInput(
            text if text.startswith(str(path)) else f"{path}: expected an MJCF: {text}"
        ) from None
    mujoco = installed("mujoco", str(path), "mujoco", "MJCF", "robots")
    warned, before = list[str](), mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warned.append)  # else it prints, and writes a log where it runs
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        touching, absent = _without_what_is_elsewhere(spec, path)
        spec.compiler.discardvisual = False
        model = spec.compile()
        if wrong := [text for text in warned if "NaN" in text]:
            raise ValueError(wrong[0])
        return model, touching, absent
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise InvalidInput(f"{path}: expected an MJCF: {reason:.{_LONGEST}}") from None
    finally:
        mujoco.set_mju_user_warning(before)


def _elements(
    element: Element, folder: Path, above: tuple[Path, ...], copies: float = 1.0
) -> Iterator[Element]:
    """An element and all below it, also of files that are included or attached.

    Arguments:
        above: the files that the element is in.
        copies: how many there are to be of the element.

    Raises:
        InvalidInput: for a file in itself, and where an element asks for more than MuJoCo makes in
            seconds: MuJoCo cannot be interrupted.
    """
    names, most = _MOST.get(element.tag, ((), math.inf))
    many = copies
    for part in " ".join(element.get(name, "") for name in names).split():
        with suppress(ValueError):  # MuJoCo's to tell
            many *= max(1.0, abs(float(part)))
    if many > most:
        raise InvalidInput(f"{element.tag}: expected {most:g} or fewer, got {many:g}")
    yield element
    below, at = [*element], element.tag in ("include", "model") and element.get("file")
    if at and (file := (folder / at).resolve()).is_file():
        if file in above:
            raise InvalidInput(f"{element.tag}: expected another file, got {file.name} in itself")
        below, above = [parse_xml(read_text(file), "")], (*above, file)
    for child in below:
        yield from _elements(child, folder, above, many if element.tag == "replicate" else copies)


def read_scene(path: Path, most_triangles: int, hint: str = "simplify it") -> Surface:
    """Corners, shape (V, 3) [m], of what is fixed in a scene and collides, and triangles, shape
    (T, 3), of corners' numbers, which turn to the left as seen from outside.

    Arguments:
        most_triangles: more are refused.
        hint: what the message says to do then.

    Raises:
        InvalidInput: in one line, for what MuJoCo does not compile, and for a world in which nothing
            that is fixed collides.
    """
    model, touching, absent = compiled_mjcf(path)
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    moving = {int(model.body_rootid[b]) for b in range(model.nbody) if model.body_jntnum[b]}
    left_out = [model.body(b).name or f"body {b}" for b in sorted(moving)]
    made, planes = list[Surface](), list[tuple[Array, Array]]()
    for g in range(model.ngeom):
        name, kind = model.geom(g).name, int(model.geom_type[g])
        collides = model.geom_contype[g] or model.geom_conaffinity[g] or g in paired
        collides = collides or name in touching
        if not collides or int(model.body_rootid[model.geom_bodyid[g]]) in moving:
            continue
        place, turn = np.array(data.geom_xpos[g]), np.array(data.geom_xmat[g]).reshape(3, 3)
        if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
            planes.append((place, turn))
        elif (surface := _surface(mujoco.mjtGeom, model, g)) is not None:
            made.append((place + surface[0] @ turn.T, surface[1]))
        else:
            left_out.append(name or f"geom {g}")
    if absent:
        left_out.append(f"meshes that are not there, e.g. {absent[0]}")
    if not made and not planes:
        raise InvalidInput(
            f"{path}: expected a scene with a ground, got a world in which nothing that is fixed "
            f"collides; left out: {', '.join(left_out[-6:]) or 'nothing'}"
        )
    if left_out:
        doubt(f"{path.name}: no ground: {', '.join(left_out[-6:])}")
    made += _squares(planes, [corners for corners, _ in made])
    first = np.cumsum([0, *(len(corners) for corners, _ in made)])
    triangles = np.concatenate([k + each for k, (_, each) in zip(first, made, strict=False)])
    try:
        check_count(len(triangles), most_triangles)
    except TooMany as error:
        raise InvalidInput(f"{path}: {error}; {hint}") from None
    return np.concatenate([corners for corners, _ in made]), triangles


def _surface(kinds: Any, model: Any, g: int) -> Surface | None:
    """The surface of a geom in its own frame; None for a kind that has none.

    Arguments:
        kinds: MuJoCo's kinds of geoms.
    """
    kind, size = int(model.geom_type[g]), np.array(model.geom_size[g])
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=1)
    lean = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _UP)[:, None, None]
    ball = (np.cos(lean) * circle + np.sin(lean) * [0.0, 0.0, 1.0]).reshape(-1, 3)
    ends = size[1] * np.array([[[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]]])
    points = {
        int(kinds.mjGEOM_BOX): np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * size,
        int(kinds.mjGEOM_SPHERE): size[0] * ball,
        int(kinds.mjGEOM_ELLIPSOID): size * ball,
        int(kinds.mjGEOM_CAPSULE): (size[0] * ball + ends).reshape(-1, 3),
        int(kinds.mjGEOM_CYLINDER): (size[0] * circle + ends).reshape(-1, 3),
    }.get(kind)
    if kind == int(kinds.mjGEOM_HFIELD):
        return _heights(model, int(model.geom_dataid[g]))
    if kind == int(kinds.mjGEOM_MESH):
        return _mesh(model, int(model.geom_dataid[g]))
    return None if points is None else _hull(points)[:2]


def _mesh(model: Any, mesh: int) -> Surface | None:
    """The hull of a mesh; None for a flat one."""
    from scipy.spatial import QhullError  # slow to import

    first, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    points = np.array(model.mesh_vert[first:][: int(model.mesh_vertnum[mesh])], dtype=np.float64)
    faces = np.array(model.mesh_face[face:][: int(model.mesh_facenum[mesh])])
    try:
        corners, triangles, volume = _hull(points)
    except QhullError:
        return None
    if volume > _HOLLOW * (within := float(np.linalg.det(points[faces]).sum()) / 6.0):
        doubt(
            f"mesh {model.mesh(mesh).name}: its hull is the ground, as MuJoCo has it, of {volume:.3g} m³, "
            f"where the mesh has {within:.3g}"
        )
    return corners, triangles


def _hull(points: Array) -> tuple[Array, Triangles, float]:
    """The convex hull of points, shape (K, 3), and its volume [m³].

    Raises QhullError for points in a plane.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    a, b, c = (points[hull.simplices[:, i]] for i in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) > 0.0
    triangles = np.where(outward[:, None], hull.simplices, hull.simplices[:, ::-1])
    used, triangles = np.unique(triangles, return_inverse=True)
    return points[used], triangles.reshape(-1, 3), float(hull.volume)


def _heights(model: Any, field: int) -> Surface:
    """The upper side of a height field, whose rows go along y from its lower end on."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = int(model.hfield_adr[field])
    half_x, half_y, most, _ = model.hfield_size[field].tolist()
    x, y = np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows)
    z = most * np.array(model.hfield_data[first : first + rows * columns], dtype=np.float64)
    corners = np.stack([np.tile(x, rows), np.repeat(y, columns), z], axis=1)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    return corners, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def _squares(planes: list[tuple[Array, Array]], others: list[Array]) -> list[Surface]:
    """Planes as squares about everything else that is fixed.

    Arguments:
        planes: place, shape (3,) [m], and rotation, shape (3, 3), of each.
        others: corners of what else there is, shapes (V, 3) [m].
    """
    squares = list[Surface]()
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for place, turn in planes:
        seen = (np.concatenate([place[None], np.zeros((1, 3)), *others]) - place) @ turn[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.clip(0.5 * (_WIDEST_M - (high - low)), 0.0, _BEYOND_M)
        corners = place + np.where(signs < 0.0, low - room, high + room) @ turn[:, :2].T
        squares.append((corners, np.array([[0, 1, 2], [0, 2, 3]])))
    return squares


def _without_what_is_elsewhere(spec: Any, path: Path) -> tuple[set[str], list[str]]:
    """Take out pairs with geoms of a scene that the file is meant to be part of, and meshes and
    textures whose files are not there.

    Returns:
        the geoms of the robot in such pairs, and the names of the meshes.
    """
    known = {geom.name for geom in spec.geoms if geom.name}
    touching = set[str]()
    for pair in list(spec.pairs):
        ends = {pair.geomname1, pair.geomname2}
        if not ends <= known:
            touching |= ends & known
            spec.delete(pair)
    folder = path.parent
    absent = {
        mesh.name
        for mesh in spec.meshes
        if mesh.file and not _places(mesh.file, folder, spec.meshdir)
    }
    for geom in list(spec.geoms):
        if geom.meshname in absent:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name in absent:
            spec.delete(mesh)
    for looks in (*list(spec.textures), *list(spec.skins)):
        if looks.file and not _places(looks.file, folder, spec.texturedir):
            spec.delete(looks)
    kinds = ("hfield", spec.hfields, spec.meshdir), ("texture", spec.textures, spec.texturedir)
    for kind, pictures, inside in kinds:
        for file in (place for each in pictures for place in _places(each.file, folder, inside)):
            head, most = read_bytes(file)[:24], _MOST[kind][1]
            cells = math.prod(int.from_bytes(head[at:][:4], "big") for at in (16, 20))
            if head.startswith(b"\x89PNG") and cells > most:
                raise InvalidInput(f"{file.name}: expected {most:g} cells or fewer, got {cells:g}")
    return touching, sorted(absent)


def _places(file: str, folder: Path, inside: str | None) -> list[Path]:
    """Files that an asset may be, of the two places where MuJoCo looks for it."""
    places = (folder / (inside or "") / file, folder / file)
    return [place for place in places if file and place.is_file()]
