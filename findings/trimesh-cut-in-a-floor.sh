#!/bin/sh
# slice_faces_plane of trimesh, with a plane that a floor lies in.
#
# Seen with trimesh 5.2.0, a floor of two triangles at z = 0, whose normals point up, and what is above
# z = 0 asked for: nothing is left. With what is below asked for, both triangles are.
#
# Guess beforehand: what lies on the border of a half space belongs to it, or it does not: either way the
# same whichever way its normal points. To crop a scene at the height of its floor keeps the floor.
# What seems to happen: a face in the plane is kept only where its normal looks against the plane's.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "numpy==2.4.6" "scipy==1.17.1"
cat > cut.py <<'PYTHON'
import sys

import numpy as np
import trimesh
from trimesh.intersections import slice_faces_plane

corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
floor = np.array([[0, 1, 2], [0, 2, 3]])
print(f"trimesh {trimesh.__version__}")
left = {}
for word, normal in (("above", [0.0, 0.0, 1.0]), ("below", [0.0, 0.0, -1.0])):
    left[word] = len(slice_faces_plane(corners, floor, np.array(normal), np.zeros(3))[1])
    print(f"floor, {word} itself: {left[word]} of 2 triangles")
sys.exit(left != {"above": 0, "below": 2})
PYTHON
env/bin/python cut.py
