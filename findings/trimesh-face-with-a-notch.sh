#!/bin/sh
# trimesh's readers of OBJ, OFF and PLY, on one flat face in the shape of an L, 3 m2.
#
# Seen with trimesh 5.2.0: 3 m2 where the face begins at the corner from which all of it is seen, 4 m2
# where it begins at another; 4 m2 of the OFF and of the PLY that begin there. All are read without a
# word.
#
# Guess beforehand: a face is a polygon whichever corner is named first, and a reader that makes
# triangles of it covers what the face covers.
# What seems to happen: a face is cut into a fan about its first corner, whatever its shape, so that
# triangles lie in the notch, and one over another. Of a terrain that is ground in the air.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6"
cat > area.py <<'PYTHON'
import io
import sys

import trimesh

CORNERS = ["0 0 0", "2 0 0", "2 1 0", "1 1 0", "1 2 0", "0 2 0"]
PLY = """ply
format ascii 1.0
element vertex 6
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
"""


def area(kind, first):
    order = [(first + k) % 6 for k in range(6)]
    text = {
        "obj": "".join(f"v {c}\n" for c in CORNERS) + "f " + " ".join(str(k + 1) for k in order),
        "off": "\n".join(["OFF", "6 1 0", *CORNERS, "6 " + " ".join(map(str, order))]),
        "ply": PLY + "\n".join([*CORNERS, "6 " + " ".join(map(str, order))]),
    }[kind]
    return trimesh.load_mesh(io.BytesIO(text.encode() + b"\n"), file_type=kind).area


print(f"trimesh {trimesh.__version__}")
seen = True
for kind in ("obj", "off", "ply"):
    for first, told in ((0, 3.0), (2, 4.0)):
        found = area(kind, first)
        print(f"{kind}, beginning at corner {first}: {found:g} m2")
        seen &= abs(found - told) < 1e-9
sys.exit(not seen)
PYTHON
env/bin/python area.py
