#!/bin/sh
# yourdfpy on a robot whose mesh is a COLLADA file in centimetres, by <unit meter="0.01"/>: a box of
# 200 x 200 x 100 cm.
#
# Seen with yourdfpy 0.0.60 and trimesh 5.2.0: the scene is 200 x 200 x 100, and its units are
# "0.01 * meters"; trimesh's convert_units("meters") of that scene gives 2 x 2 x 1. A link of the same
# URDF whose box is a <box size="2 2 1"/> stands beside it a hundred times smaller.
#
# Guess beforehand: a URDF is in metres, so that its scene is, too, and a mesh that states its unit comes
# in by it.
# What seems to happen: trimesh keeps the unit as a word, and yourdfpy puts meshes into its scene without
# asking for it.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "yourdfpy==0.0.60" "trimesh==5.2.0" "pycollada==0.9.3" "numpy==2.4.6" "scipy==1.17.1"
cat > size.py <<'PYTHON'
import re
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy

box = trimesh.creation.box([200.0, 200.0, 100.0]).export(file_type="dae").decode()
unit = '<unit name="centimeter" meter="0.01"/>'
box = re.sub("<unit[^>]*/>", "", box).replace("<up_axis>", f"{unit}<up_axis>")
Path("box.dae").write_text(box)


def scene(geometry):
    Path("robot.urdf").write_text(
        f'<robot name="r"><link name="a"><visual><geometry>{geometry}</geometry></visual></link></robot>'
    )
    return yourdfpy.URDF.load("robot.urdf").scene


print(f"yourdfpy {version('yourdfpy')}, trimesh {trimesh.__version__}")
meshed, plain = scene('<mesh filename="box.dae"/>'), scene('<box size="2 2 1"/>')
metres = meshed.convert_units("meters").extents
print(f"mesh: {meshed.extents} in {meshed.units}; in metres {metres}; box: {plain.extents}")
sys.exit(
    not (
        np.allclose(meshed.extents, [200, 200, 100])
        and np.allclose(metres, [2, 2, 1])
        and np.allclose(plain.extents, [2, 2, 1])
    )
)
PYTHON
env/bin/python size.py
