#!/bin/sh
# trimesh's reader of PLY on an element "tristrips", which scanners' tools since Stanford's own write in
# place of "face".
#
# Seen with trimesh 5.2.0: a strip of two triangles over four vertices is read as a cloud of four points,
# by load and by load_mesh alike, and nothing is said of the strip.
#
# Guess beforehand: a surface of 1 m2, or an error that the element is not known.
# What seems to happen: only an element called "face" makes a mesh. Whoever asks whether a file is a
# cloud or a surface is told that it is a cloud.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6"
cat > strips.py <<'PYTHON'
import io
import sys

import trimesh

TEXT = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element tristrips 1
property list int int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 0
4 0 1 2 3
"""
found = trimesh.load(io.BytesIO(TEXT), file_type="ply")
print(f"trimesh {trimesh.__version__}: {type(found).__name__} of {len(found.vertices)} points")
sys.exit(type(found).__name__ != "PointCloud")
PYTHON
env/bin/python strips.py
