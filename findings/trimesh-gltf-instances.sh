#!/bin/sh
# trimesh's reader of glTF on EXT_mesh_gpu_instancing: one stepping stone of 1 m2, put down three times,
# in a file that says that it requires the extension.
#
# Seen with trimesh 5.2.0: one stone, 1 m2 of 3, 1 m of 7 from end to end, and no word.
#
# Guess beforehand: either three stones, or an error that names the extension, as the specification
# asks of a reader that does not know what extensionsRequired lists.
# What seems to happen: extensions of nodes are passed over.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6"
cat > instances.py <<'PYTHON'
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


corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
places = np.array([[0, 0, 0], [3, 0, 0], [6, 0, 0]], "<f4")
content = corners.tobytes() + places.tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
extension = "EXT_mesh_gpu_instancing"
tree = {
    "asset": {"version": "2.0"},
    "extensionsUsed": [extension],
    "extensionsRequired": [extension],
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "extensions": {extension: {"attributes": {"TRANSLATION": 1}}}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 2}]}],
    "buffers": [{"byteLength": len(content)}],
    "bufferViews": [
        {"buffer": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 36},
        {"buffer": 0, "byteOffset": 84, "byteLength": 12},
    ],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4,
         "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": 3},
        {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": 6},
    ],
}
scene = trimesh.load_scene(io.BytesIO(glb(tree, content)), file_type="glb")
print(f"trimesh {trimesh.__version__}: {scene.area:g} m2 of 3, {scene.extents[0]:g} m of 7")
sys.exit((scene.area, scene.extents[0]) != (1.0, 1.0))
PYTHON
env/bin/python instances.py
