#!/bin/sh
# trimesh's reader of glTF on KHR_mesh_quantization, as gltfpack and glTF-Transform write it: corners as
# normalized integers of 16 bits, which the file says it requires.
#
# Seen with trimesh 5.2.0: a square of 1 m is read as one of 32767 m. Nothing is said. With a scale in
# the node that brings it back to 2 m it is one of 65534 m.
#
# Guess beforehand: "normalized": true means c / 32767, in a reader that opens a file which requires the
# extension, and a reader without it refuses the file.
# What seems to happen: integers are taken as they are, and extensionsRequired is not asked.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6"
cat > quantized.py <<'PYTHON'
import io
import json
import struct
import sys

import numpy as np
import trimesh


def glb(tree, content):
    """A .glb of a tree and of what its buffer holds."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    content += bytes(-len(content) % 4)
    whole = 28 + len(text) + len(content)
    return (
        b"glTF" + struct.pack("<II", 2, whole)
        + struct.pack("<I4s", len(text), b"JSON") + text
        + struct.pack("<I4s", len(content), b"BIN\0") + content
    )


def size(scale):
    corners = np.zeros((4, 4), "<i2")
    corners[:, :2] = [[0, 0], [32767, 0], [32767, 32767], [0, 32767]]
    content = corners.tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    extension = ["KHR_mesh_quantization"]
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": extension,
        "extensionsRequired": extension,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [scale] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(content)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 32, "byteStride": 8, "target": 34962},
            {"buffer": 0, "byteOffset": 32, "byteLength": 12, "target": 34963},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5122, "normalized": True, "type": "VEC3", "count": 4,
             "min": [0, 0, 0], "max": [32767, 32767, 0]},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6},
        ],
    }
    scene = trimesh.load_scene(io.BytesIO(glb(tree, content)), file_type="glb")
    return float(scene.extents.max())


print(f"trimesh {trimesh.__version__}")
seen = {scale: size(scale) for scale in (1.0, 2.0)}
for scale, found in seen.items():
    print(f"a square of {scale:g} m: {found:g} m")
sys.exit(seen != {1.0: 32767.0, 2.0: 65534.0})
PYTHON
env/bin/python quantized.py
