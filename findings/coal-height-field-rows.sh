#!/bin/sh
# coal and MuJoCo: which side of a height field its first row of heights is.
#
# Seen with coal 3.0.2 and mujoco 4.0.0, one matrix of heights with 1 m in its first row and 0 m elsewhere:
# MuJoCo has the high row at the side of -y, coal at the side of +y. Columns go along +x in both.
#
# Guess beforehand: a terrain that is handed to the simulator and to the collision checker as one
# matrix is one ground. It is its mirror image: feet that the checker holds clear of a step walk into it, and no
# flat or symmetric test of the pair shows it.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "coal==3.0.2" "mujoco==4.0.0" "numpy==2.3.5"
cat > rows.py <<'PYTHON'
import sys

import coal
import mujoco
import numpy as np

heights = np.zeros((21, 31))
heights[0], heights[:, -1] = 1.0, 0.5
model = mujoco.MjModel.from_xml_string(
    '<mujoco><asset><hfield name="ground" nrow="21" ncol="31" size="1.5 1 1 .1"/></asset>'
    '<worldbody><geom type="hfield" hfield="ground"/></worldbody></mujoco>'
)
model.hfield_data[:] = heights.ravel()
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
field = coal.HeightFieldOBBRSS(3.0, 2.0, heights, -0.1)
ball = coal.Sphere(0.01)


def seen_by_mujoco(x, y):
    begin, down, geom = np.array([x, y, 2.0]), np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    return 2.0 - mujoco.mj_ray(model, data, begin, down, None, 1, -1, geom, None)


def seen_by_coal(x, y):
    for z in np.arange(1.3, -0.1, -0.005):
        pose = coal.Transform3s(np.eye(3), np.array([x, y, z]))
        if coal.collide(
            field, coal.Transform3s(), ball, pose, coal.CollisionRequest(), coal.CollisionResult()
        ):
            return z - 0.01
    return -0.1


places = {"y = -1": (0.0, -0.995), "y = +1": (0.0, 0.995), "x = +1.5": (1.495, 0.0)}
right = True
for (name, place), expected in zip(places.items(), [(1, 0), (0, 1), (0.5, 0.5)], strict=True):
    two = np.array([seen_by_mujoco(*place), seen_by_coal(*place)])
    print(f"height at {name:9}MuJoCo {two[0]:.2f} m, coal {two[1]:.2f} m")
    right &= bool(np.all(np.abs(two - expected) < 0.1))
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python rows.py
