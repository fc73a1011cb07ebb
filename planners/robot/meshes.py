"""Meshes of a robot's links, as pictures need them: of few triangles, and kept on disk once
thinned.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, read_archive, read_only
from ..files.documents import read_bytes, shown
from ..files.writing import cache_folder, write_bytes
from ..terrain.mesh_file import MOST_BYTES, read_corners
from .shapes import Shape
from .solids import solid_shapes

VERSION = "mesh/2"
"""Part of every digest: a change of method changes it, and older files are no longer found."""
FINEST, COARSER = 96, 0.85
"""Cells along a mesh's longest side at first, and by how much fewer there are at every further
try."""
DISAGREE = 0.02
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


def thinned_mesh(path: Path, scale: Array, most: int, *, cached: bool = True) -> Triangles | None:
    """A mesh of ``most`` triangles or fewer, to the left from outside, kept by the digest of its
    file; None where it cannot be had. One whose faces disagree has all of them twice, seen from
    either side.

    Arguments:
        cached: False reads the file and keeps nothing.
    """
    if not cached:
        try:
            return faced_outward(thinned(read_mesh(path, scale), most))
        except InvalidInput:
            return None
    try:
        key = f"{VERSION}\0{most}\0{np.asarray(scale).tolist()}\0".encode() + read_bytes(
            path, MOST_BYTES
        )
    except InvalidInput:
        return None

    def made() -> dict[str, Any] | None:
        mesh = thinned_mesh(path, scale, most, cached=False)
        return (
            None
            if mesh is None
            else {"vertices": np.float32(mesh.vertices_m), "faces": np.int32(mesh.faces)}
        )

    return kept(key, made, lambda arrays: _checked(arrays["vertices"], arrays["faces"]))


def kept(
    said: bytes,
    make: Callable[[], dict[str, Any] | None],
    read: Callable[[Mapping[str, Array]], Value],
) -> Value | None:
    """Read arrays that were kept for a mesh, or else make and keep them; None where there are none.

    Arguments:
        said: the mesh's file, and what is made of it.
        make: the arrays.
        read: raises InvalidInput, KeyError or ValueError for arrays that are damaged, which are
            made anew.
    """
    file = cache_folder() / "meshes" / f"{hashlib.sha256(said).hexdigest()}.npz"
    with suppress(InvalidInput, KeyError, ValueError):
        return read(read_archive(file))
    arrays = make()
    if arrays is None:
        return None
    with suppress(InvalidInput, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        stream = io.BytesIO()
        np.savez_compressed(stream, **arrays)
        write_bytes(file, stream.getvalue())
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
        if thinned_mesh(path, links_of_mesh[0].size_m, most) is None:
            try:
                read_mesh(path, links_of_mesh[0].size_m)
            except InvalidInput as error:
                why = str(error).removeprefix(f"{path}: ")
            else:
                continue
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
    cells = float(FINEST)
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
        cells *= COARSER
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
    if int(np.count_nonzero(pairs & (ahead != 1))) > DISAGREE * int(np.count_nonzero(pairs)):
        both = np.vstack([faces, faces[:, ::-1] + count])
        return Triangles(vertices_m=np.vstack([mesh.vertices_m, mesh.vertices_m]), faces=both)
    corners = (mesh.vertices_m - mesh.vertices_m.mean(axis=0))[faces]
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    return mesh if volume >= 0.0 else Triangles(vertices_m=mesh.vertices_m, faces=faces[:, ::-1])
