"""Mesh files (STL, OBJ, PLY, DAE, OFF, GLB), read by trimesh in bounds: their headers are held against their size."""

from __future__ import annotations

import io
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import decoded, parse_json, read_bytes

MOST_BYTES = 128_000_000
MOST_TRIANGLES = 3_000_000
"""Of any mesh, a robot's or a terrain's, unless fewer are wanted."""
PLY_HEAD = 65_536
"""Bytes within which a PLY file's header ends."""

Triangles = NDArray[np.int_]


def read_corners(path: str | Path, most_triangles: int = MOST_TRIANGLES) -> tuple[Array, Triangles]:
    """Corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners' numbers.

    most_triangles: more are refused, by the header where the format has one that counts them.
    Raises InvalidInput for a file that is missing or damaged, that declares more than it can hold, whose triangles name
    corners that it does not have, and for one without triangles or with corners that are not finite.
    """
    suffix = Path(path).suffix.lower()
    content = read_bytes(path, MOST_BYTES)
    _check_count(declared_triangles(content, suffix), most_triangles, path)
    try:
        check_declared(content, suffix)
        with np.errstate(all="ignore"):
            mesh = loaded(content, suffix, path)
            corners, triangles = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: expected a mesh: {error}") from None
    except Exception as error:  # trimesh's readers raise whatever struck them
        message = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInput(f"{path}: expected a mesh, which trimesh cannot read: {message:.120}") from None
    _check_count(len(triangles), most_triangles, path)
    if len(triangles) == 0:
        raise InvalidInput(f"{path}: expected a mesh with triangles, got an empty one")
    if corners.ndim != 2 or corners.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InvalidInput(f"{path}: expected a mesh of triangles in space, got {triangles.shape}, {corners.shape}")
    if not np.all((triangles >= 0) & (triangles < len(corners))):
        raise InvalidInput(f"{path}: expected a mesh whose triangles are of its {len(corners)} corners, got others")
    if not np.all(np.isfinite(corners)):
        raise InvalidInput(
            f"{path}: expected a mesh with finite corners, got {np.sum(~np.isfinite(corners))} numbers that are not"
        )
    return corners, triangles.astype(np.int_)


def loaded(content: bytes, suffix: str, path: str | Path) -> Any:
    """What trimesh makes of a file, a mesh or points, its corners as they are. Raises InvalidInput without trimesh."""
    try:
        import trimesh

        if suffix == ".dae":
            import collada  # noqa: F401
    except ImportError as error:
        raise InvalidInput(f"{path}: meshes need {error.name}: pip install 'stancekit[terrain]'") from None
    force = None if suffix == ".ply" else "mesh"
    return trimesh.load(io.BytesIO(content), file_type=suffix[1:], force=force, process=False, skip_materials=True)


def declared_triangles(content: bytes, suffix: str) -> int:
    """How many triangles a file says, or shows at a glance, to have; 0 where only reading it tells."""
    if suffix == ".stl" and len(content) >= 84:
        (count,) = struct.unpack("<I", content[80:84])
        if len(content) == 84 + 50 * count:
            return int(count)
    if suffix == ".stl":
        return content.count(b"endfacet")
    if suffix == ".obj":
        return content.count(b"\nf ")
    if suffix == ".ply":
        found = re.search(rb"^element\s+face\s+(\d{1,18})", _ply_head(content), re.MULTILINE)
        return int(found[1]) if found else 0
    return 0


def _check_count(count: int, most: int, path: str | Path) -> None:
    if count > most:
        raise InvalidInput(f"{path}: expected {most} triangles or fewer (most_triangles), got {count}; simplify it")


def _ply_head(content: bytes) -> bytes:
    return content[:PLY_HEAD].partition(b"end_header")[0]


def check_declared(content: bytes, suffix: str) -> None:
    """Raise InvalidInput where a header asks for more than the bytes behind it can hold."""
    if suffix == ".ply":
        counts = [int(count) for count in re.findall(rb"^element\s+\S+\s+(\d{1,18})", _ply_head(content), re.MULTILINE)]
        if sum(counts) > len(content):
            raise InvalidInput(f"its header declares {sum(counts)} elements in {len(content)} bytes")
    elif suffix == ".glb":
        _check_glb(content)


def _check_glb(content: bytes) -> None:
    """Raise InvalidInput for counts that the file cannot hold, and for meshes that are placed again and again."""
    if len(content) < 20 or content[:4] != b"glTF":
        raise InvalidInput("its first bytes are not glTF's")
    length, kind = struct.unpack("<II", content[12:20])
    if kind != 0x4E4F534A or length > len(content) - 20:
        raise InvalidInput("its first chunk is no JSON")
    tree = parse_json(decoded(content[20 : 20 + length], "JSON"), "JSON")
    if not isinstance(tree, dict):
        raise InvalidInput("its JSON is no object")
    accessors = _objects(tree, "accessors")
    counts = [item["count"] if isinstance(item.get("count"), int) else -1 for item in accessors]
    if not all(0 <= count <= len(content) for count in counts):
        raise InvalidInput(f"expected counts up to its {len(content)} bytes")
    if any("uri" in item for name in ("buffers", "images") for item in _objects(tree, name)):
        raise InvalidInput("expected a file that is whole, got one that names others")
    meshes = _objects(tree, "meshes")
    sizes = [
        sum(
            counts[part["indices"]] if isinstance(part.get("indices"), int) else max(counts, default=0)
            for part in _objects(mesh, "primitives")
        )
        for mesh in meshes
    ]
    placed = [node["mesh"] for node in _objects(tree, "nodes") if isinstance(node.get("mesh"), int)]
    if sum(sizes[mesh] for mesh in placed) > 3 * MOST_TRIANGLES:
        raise InvalidInput(f"expected {MOST_TRIANGLES} triangles or fewer, got more")


def _objects(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found = tree.get(name, [])
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        raise InvalidInput(f"{name}: expected a list of objects")
    return found
