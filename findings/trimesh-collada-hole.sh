#!/bin/sh
# trimesh with pycollada on a COLLADA face with a hole: <polygons> with a <ph>, whose <p> is the border of
# 16 m2 and whose <h> is that of the hole, 4 m2.
#
# Seen with trimesh 5.2.0 and pycollada 0.9.3: of the face nothing is left, 0 m2, and nothing is said;
# pycollada has a set of polygons with none in it. The same border as a plain <p> is 16 m2.
#
# Guess beforehand: 12 m2, or, where holes are not known, 16 m2 or an error.
# What seems to happen: pycollada looks for the <p> that are children of <polygons>, of which there is
# none, and makes a set of no polygons of that.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "trimesh==5.2.0" "pycollada==0.9.3" "numpy==2.4.6"
cat > hole.py <<'PYTHON'
import io
import sys

import collada
import trimesh

NUMBERS = "0 0 0 4 0 0 4 4 0 0 4 0 1 1 0 3 1 0 3 3 0 1 3 0"
FILE = f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>
<up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="24">{NUMBERS}</float_array><technique_common>
<accessor source="#a" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polygons count="1"><input semantic="VERTEX" source="#v" offset="0"/>FACE</polygons>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def seen(face):
    data = FILE.replace("FACE", face).encode()
    area = trimesh.load_scene(io.BytesIO(data), file_type="dae").area
    (part,) = collada.Collada(io.BytesIO(data)).geometries[0].primitives
    return float(area), len(part)


print(f"trimesh {trimesh.__version__}, pycollada {collada.__version__}")
plain = seen("<p>0 1 2 3</p>")
holed = seen("<ph><p>0 1 2 3</p><h>4 7 6 5</h></ph>")
print(f"border: {plain[0]:g} m2, {plain[1]} polygons; with a hole: {holed[0]:g} m2, {holed[1]}")
sys.exit((plain, holed) != ((16.0, 1), (0.0, 0)))
PYTHON
env/bin/python hole.py
