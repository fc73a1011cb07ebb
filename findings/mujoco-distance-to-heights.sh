#!/bin/sh
# mj_geomDistance of MuJoCo between a foot and a height field: how far it is depends on how far one
# looks.
#
# Seen with mujoco 4.0.0, a ball of 3 cm that is 2 mm inside flat heights of 201 x 201
# samples, 1 cm apart, and the same ball over a box with the same top:
# - the contact of the simulation is 2 mm deep in both;
# - mj_geomDistance says -2 mm with distmax = 1 cm, over both;
# - with distmax = 50 cm it says +48.6 cm over the heights, and -2 mm over the box;
# - 20 cm above the heights it says 20.4 cm with distmax = 21 cm, and 48.7 cm with distmax = 50 cm.
# Over heights 25 cm apart all of it is right.
#
# Guess beforehand: distmax is a cutoff. A distance that is less than it does not depend on it, so
# that one generous cutoff serves to ask how much room links and feet have over a terrain.
# What seems to happen: every cell of the field within distmax of the ball counts as a possible
# contact, the list of contacts of a pair ends at fifty (mjMAXCONPAIR), and the least of those that
# came first is answered, which lie at one corner of what was looked at.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "mujoco==4.0.0"
cat > distance.py <<'PYTHON'
import sys

import mujoco
import numpy as np

GROUNDS = {
    "box": '<geom name="ground" type="box" size="1 1 .25" pos="0 0 -.25"/>',
    "heights": '<geom name="ground" type="hfield" hfield="heights"/>',
}


def scene(ground, samples):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
          <asset><hfield name="heights" nrow="{samples}" ncol="{samples}" size="1 1 .2 .5"/></asset>
          <worldbody>
            {GROUNDS[ground]}
            <body><freejoint/><geom name="foot" type="sphere" size=".03" mass="1"/></body>
          </worldbody>
        </mujoco>"""
    )
    model.hfield_data[:] = 0.0
    return model, mujoco.MjData(model)


def asked(ground, above_m, far_m, samples=201):
    """The distance with a cutoff, and that of the deepest contact, if any."""
    model, data = scene(ground, samples)
    data.qpos[:3] = [0.0013, 0.0021, 0.03 + above_m]
    mujoco.mj_forward(model, data)
    pair = model.geom("ground").id, model.geom("foot").id
    found = mujoco.mj_geomDistance(model, data, *pair, far_m, None)
    return found, min((contact.dist for contact in data.contact), default=np.nan)


print(f"MuJoCo {mujoco.__version__}")
rows = {}
for ground, samples in (("box", 201), ("heights", 201), ("heights", 9)):
    for above_m, far_m in ((-0.002, 0.01), (-0.002, 0.5), (0.2, 0.21), (0.2, 0.5)):
        found, contact = asked(ground, above_m, far_m, samples)
        rows[ground, samples, above_m, far_m] = found
        print(
            f"{ground} of {samples}: {1e3 * above_m:+.0f} mm above, distmax {far_m:g} m: "
            f"{1e3 * found:+.1f} mm, deepest contact {1e3 * contact:+.1f} mm"
        )
        if above_m < 0.0 and abs(contact - above_m) > 1e-4:
            sys.exit(1)
right = [
    abs(found - above_m) < (1e-3 if samples == 9 or ground == "box" or above_m < 0.0 else 5e-3)
    for (ground, samples, above_m, far_m), found in rows.items()
    if (ground, samples) != ("heights", 201) or (above_m, far_m) in ((-0.002, 0.01), (0.2, 0.21))
]
wrong = rows["heights", 201, -0.002, 0.5] > 0.4 and rows["heights", 201, 0.2, 0.5] > 0.4
sys.exit(not (all(right) and wrong))
PYTHON
env/bin/python distance.py
