"""Mesh files (STL, OBJ, PLY, OFF, GLB), read by trimesh in bounds: what a file declares is held against its size."""

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
PLY_HEAD = 65_536
"""Bytes within which a PLY file's header ends."""

Triangles = NDArray[np.int_]


def read_corners(path: str | Path) -> tuple[Array, Triangles]:
    """Corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners' numbers.

    Raises InvalidInput for a file that is missing or damaged, that declares more than it can hold, whose triangles name
    corners that it does not have, and for one without triangles or with corners that are not finite.
    """
    try:
        import trimesh
    except ImportError:
        raise InvalidInput(f"{path}: meshes need trimesh: pip install 'stancekit[viz]'") from None
    suffix = Path(path).suffix.lower()
    content = read_bytes(path, MOST_BYTES)
    try:
        _check_declared(content, suffix)
        with np.errstate(all="ignore"):
            mesh: Any = trimesh.load(
                io.BytesIO(content), file_type=suffix[1:], force="mesh", process=False, skip_materials=True
            )
            corners, triangles = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: expected a mesh: {error}") from None
    except Exception as error:  # trimesh's readers raise whatever struck them
        message = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInput(f"{path}: expected a mesh, which trimesh cannot read: {message:.120}") from None
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


def _check_declared(content: bytes, suffix: str) -> None:
    """Raise InvalidInput where a header asks for more than the bytes behind it can hold."""
    if suffix == ".ply":
        head = content[:PLY_HEAD].partition(b"end_header")[0]
        counts = [int(count) for count in re.findall(rb"^element\s+\S+\s+(\d{1,18})", head, re.MULTILINE)]
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
