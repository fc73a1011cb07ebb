"""Numbers of mesh files: text as arrays, polygons and strips as triangles, each held against what
is there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidInput
from ...files.arrays import Array, flat_cross, plain_numbers
from ...files.documents import shown

Triangles: TypeAlias = NDArray[np.int_]
Surface: TypeAlias = tuple[Array, Triangles]
"""Corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners' numbers."""
Reader: TypeAlias = Callable[[bytes, int], Surface]
"""A function of a file's bytes and of the most triangles that are wanted."""
N = TypeVar("N")
Node: TypeAlias = tuple[Array, Iterable[Surface], Iterable[N]]

MOST_BYTES = 128_000_000
MOST_TRIANGLES = 3_000_000
"""Most triangles of any mesh, a robot's or a terrain's, unless fewer are wanted."""
BLOCK = 1 << 20
"""Bytes of text that become objects of Python at once."""
_MOST_NODES = 20_000
_WHOLE = re.compile(rb"[-+]?\d{1,18}")
_LONGEST = 400
"""Letters of a number at most."""
_TURNED = 1e-9
"""A triangle of a face that turns the other way by more than this share of the face's area shows
that the face is not convex."""
_MOST_BENT, _MOST_ALL = 1000, 50_000
"""Most corners of such a face, which take the square of their number, and of all of them."""


class TooMany(InvalidInput):
    """A mesh with more triangles than are wanted."""


def broken(reason: str) -> InvalidInput:
    """The error for a file that is damaged."""
    return InvalidInput(f"expected a mesh: {reason}")


def check_count(count: int, most: int) -> None:
    """Raise InvalidInput for more triangles than are wanted."""
    if count > most:
        raise TooMany(f"expected {most} triangles or fewer (most_triangles), got {count}")


def blocks(text: bytes, end: bytes) -> Iterator[bytes]:
    """Pieces of a text, each of about ``BLOCK`` bytes and complete up to an ``end``, a regular
    expression.
    """
    border, at = re.compile(end), 0
    while at < len(text):
        match = border.search(text, at + BLOCK)
        stop = len(text) if match is None else match.end()
        yield text[at:stop]
        at = stop


def reals(tokens: Iterable[bytes]) -> Array:
    """Tokens as numbers, shape (K,).

    Raises InvalidInput for one that is no number.
    """
    return np.array([_real(token) for token in tokens], dtype=np.float64)


def wholes(tokens: Iterable[bytes]) -> NDArray[np.int64]:
    """Tokens as whole numbers, shape (K,).

    Raises InvalidInput for one that is none, or is beyond 64 bits.
    """
    some = list(tokens)
    try:
        return np.array([int(token) for token in some], dtype=np.int64)
    except (ValueError, OverflowError):
        odd = next((each for each in some if not _WHOLE.fullmatch(each)), b"")
        came = shown(odd[:40].decode(errors="replace"))
        raise broken(f"expected whole numbers, got {came}") from None


def reals_of(text: bytes) -> Array:
    """Numbers with blanks between them, shape (K,)."""
    return np.concatenate([np.zeros(0), *(reals(piece.split()) for piece in blocks(text, rb"\s"))])


def wholes_of(text: bytes) -> NDArray[np.int64]:
    """Whole numbers with blanks between them, shape (K,)."""
    return np.concatenate(
        [np.zeros(0, dtype=np.int64), *(wholes(piece.split()) for piece in blocks(text, rb"\s"))]
    )


def fans(counts: NDArray[np.int64], corners: NDArray[np.int64], most: int) -> Triangles:
    """Fans as triangles about their first corners, shape (T, 3).

    Arguments:
        counts: corners per fan, shape (F,).
        corners: of all fans in a row, shape (sum of counts,).
    """
    pieces = np.maximum(counts - 2, 0)
    check_count(int(pieces.sum()), most)
    face = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(len(face)) - (np.cumsum(pieces) - pieces)[face]
    first = (np.cumsum(counts) - counts)[face]
    return np.asarray(
        corners[np.stack([first, first + step + 1, first + step + 2], axis=1)], dtype=np.int_
    )


def polygons(
    counts: NDArray[np.int64], corners: NDArray[np.int64], places: Array, most: int
) -> Triangles:
    """Polygons as triangles in their planes, shape (T, 3): fans, where all of a fan's triangles turn
    as the polygon does, else ears that are cut off one after the other.

    Arguments:
        counts: corners per polygon, shape (F,).
        corners: of all polygons in a row, shape (sum of counts,).
        places: where corners are, shape (V, 3).
    """
    triangles = fans(counts, corners, most)
    if not (counts > 3).any() or not np.all((triangles >= 0) & (triangles < len(places))):
        return triangles  # whoever reads the file refuses corners that it does not have
    face = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
    a, b, c = (places[triangles[:, k]] for k in range(3))
    normals, whole = np.cross(b - a, c - a), np.zeros((len(counts), 3))
    np.add.at(whole, face, normals)
    bent = np.vecdot(normals, whole[face]) < -_TURNED * np.vecdot(whole, whole)[face]
    ends = np.cumsum(counts)
    faces = np.unique(face[bent])
    if counts[faces].max(initial=0) > _MOST_BENT or counts[faces].sum() > _MOST_ALL:
        raise broken(
            f"expected {_MOST_BENT} corners or fewer of a face that is not convex, and {_MOST_ALL} "
            f"of all, got {counts[faces].sum()}; give triangles"
        )
    for k in faces.tolist():
        mine = corners[ends[k] - counts[k] : ends[k]]
        triangles[face == k] = mine[_ears(places[mine], whole[k])]
    return triangles


def _ears(places: Array, normal: Array) -> Triangles:
    """A simple polygon as triangles of its corners' numbers, shape (n − 2, 3); where rounding leaves
    no ear, the widest corner is cut off.
    """
    apart = np.any(places != np.roll(places, 1, axis=0), axis=1)
    if not apart.all() and apart.sum() > 2:  # corners that are given twice in a row
        kept = np.flatnonzero(apart)
        empty = np.full((len(places) - len(kept), 3), kept[0])
        return np.concatenate([kept[_ears(places[kept], normal)], empty])
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    flat = places @ np.stack([along, np.cross(normal, along)], axis=1)
    left, found = list(range(len(places))), list[tuple[int, int, int]]()
    while len(left) > 3:
        at = np.array(left)
        before, after = np.roll(at, 1), np.roll(at, -1)
        turns = _turn(flat[before], flat[at], flat[after])
        ear = int(turns.argmax())
        for k in np.argsort(turns)[np.count_nonzero(turns <= 0.0) :].tolist():  # least ears first
            one, two, three = (flat[each[k]] for each in (before, at, after))
            rest = flat[at][~(flat[at][:, None] == np.stack([one, two, three])).all(2).any(1)]
            inside = (_turn(one, two, rest) >= 0.0) & (_turn(two, three, rest) >= 0.0)
            if not (inside & (_turn(three, one, rest) >= 0.0)).any():
                ear = k
                break
        found.append((int(before[ear]), left.pop(ear), int(after[ear])))
    return np.array([*found, tuple(left)], dtype=np.int_)


def _turn(one: Array, two: Array, three: Array) -> Array:
    """Twice the area of triangles in a plane, above 0 where they turn to the left."""
    return flat_cross(two - one, three - one)


def strip(corners: NDArray[np.int64], most: int) -> Triangles:
    """The triangles of a strip, each from three corners in a row, every second one turned round,
    shape (T, 3).
    """
    check_count(max(len(corners) - 2, 0), most)
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    triangles[1::2] = triangles[1::2, ::-1]
    return np.asarray(triangles, dtype=np.int_)


def walked(roots: Iterable[N], of: Callable[[N], Node[N]]) -> Iterator[Surface]:
    """The surfaces of trees of nodes, each placed by its node and those above it.

    Raises InvalidInput for more nodes than any file needs, or one that is within itself.

    Arguments:
        of: transformation of a node to the one above it, shape (4, 4), its surfaces in its own
            frame, and the nodes below it.
    """
    stack, visits = [(root, np.eye(4)) for root in roots], 0
    while stack:
        node, above = stack.pop()
        visits += 1
        if visits > _MOST_NODES:
            raise broken(
                f"expected {_MOST_NODES} nodes or fewer, got more, or one that is within itself"
            )
        matrix, surfaces, below = of(node)
        here = above @ matrix
        turn = -1 if np.linalg.det(here[:3, :3]) < 0.0 else 1  # seen in a mirror, the other way
        yield from ((moved(corners, here), faces[:, ::turn]) for corners, faces in surfaces)
        stack += [(each, here) for each in below]


def moved(points: Array, place: Array) -> Array:
    """Points, shape (K, 3), by a matrix, shape (4, 4)."""
    return np.asarray(points @ place[:3, :3].T + place[:3, 3])


def so_many(values: Any, count: int, name: str) -> Array:
    """So many finite numbers, shape (count,).

    Raises InvalidInput for anything else.
    """
    try:
        numbers = plain_numbers(values)
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros(0)
    if numbers.shape != (count,) or not np.all(np.isfinite(numbers)):
        raise broken(f"{name}: expected {count} finite numbers, got {shown(values)}")
    return numbers


def joined(pieces: Iterable[Surface]) -> Surface:
    """Join several surfaces to one."""
    corners, triangles, start = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int_)], 0
    for points, faces in pieces:
        corners.append(points)
        triangles.append(faces + start)
        start += len(points)
    return np.concatenate(corners), np.concatenate(triangles)


def _real(token: bytes) -> float:
    with suppress(ValueError):
        if len(token) <= _LONGEST:
            return float(token)
    raise broken(f"expected numbers, got {shown(token[:40].decode(errors='replace'))}")


FIELDS: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
        ".stl": ("facet count vertex", "", "normal attribute name"),
        ".obj": ("v f", "surf curv curv2 cstype call csh", "vt vn vp p l g o s usemtl mtllib"),
        ".off": ("ST C N OFF vertices faces", "4 n BINARY", "edges colours normals"),
        ".ply": (
            "format vertex x y z face vertex_indices vertex_index",
            "tristrips",
            "comment obj_info edge material red green blue nx ny nz s t",
        ),
        ".dae": (
            "unit visual_scene node matrix translate rotate scale instance_node instance_geometry "
            "instance_controller skin bind_shape_matrix mesh vertices source accessor triangles polylist "
            "polygons trifans tristrips",
            "lookat skew ph morph convex_mesh spline brep",
            "up_axis lines linestrips normal texcoord material effect image camera light animation",
        ),
        ".glb": (
            "scene scenes nodes children mesh matrix translation rotation scale primitives mode POSITION "
            "indices byteStride normalized extensionsRequired",
            "uri sparse skin weights EXT_mesh_gpu_instancing KHR_draco_mesh_compression "
            "EXT_meshopt_compression KHR_meshopt_compression",
            "NORMAL TANGENT TEXCOORD COLOR targets materials textures samplers cameras animations extras",
        ),
    }
)
"""By the ending of a file's name. The axis up of a .dae is what ``up`` says."""


def check_fields(suffix: str, names: Iterable[str]) -> None:
    """Raise InvalidInput for a field that moves, adds or takes away what is no surface without
    it.
    """
    if odd := sorted(set(names) & set(FIELDS[suffix][1].split())):
        raise broken(f"expected a file without {odd[0]}, which no reader here follows")
