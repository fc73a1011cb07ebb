#!/bin/sh
# urdf2mjcf on a robot whose trunk has a mass, a centre and an inertia, as trunks in URDFs have.
#
# Seen with urdf2mjcf 0.2.39 and mujoco 4.0.0, a trunk of 5 kg in a box of .4 x .2 x .1 m, and a leg:
# - the leg has the mass and centre of the URDF, the trunk has no <inertial> in the MJCF;
# - so MuJoCo makes one of the box, as if it were of water: 8 kg, with the centre 5 cm lower than the URDF has it;
# - with another box for a battery, .2 x .2 x .1 m, it is 12 kg.
# With floating_base=False, for a robot that is bolted down, the trunk has its 5 kg. Not a word of it is said; that products
# of inertia are left out is.
#
# Guess beforehand: what is read of every link is read of the first one, and a free base needs its mass more than a fixed one.
# Feet bear half as much again, and a policy that was trained on the file falls on the robot.
# What seems to happen: the step that adds the free joint takes the trunk's inertial out.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "urdf2mjcf==0.2.39" "mujoco==4.0.0" "numpy==2.4.6"
cat > trunk.py <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
from urdf2mjcf.convert import convert_urdf_to_mjcf
from urdf2mjcf.model import ConversionMetadata

LINK = (
    '<link name="{name}"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>'
    '<inertia ixx="{across}" iyy="{across}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial>{boxes}</link>'
)
BOX = '<collision><origin xyz="{x} 0 0"/><geometry><box size="{length} .2 .1"/></geometry></collision>'
HIP = (
    '<joint name="hip" type="revolute"><parent link="trunk"/><child link="leg"/><origin xyz="0 .1 0"/>'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="20" velocity="10"/></joint>'
)


def converted(boxes, **options):
    """Masses of trunk and leg, and the height of the trunk's centre, in the MJCF."""
    trunk = LINK.format(name="trunk", centre=0.05, mass=5, across=0.06, along=0.1, boxes=boxes)
    leg = LINK.format(name="leg", centre=-0.1, mass=1, across=0.004, along=0.001, boxes="")
    Path("robot.urdf").write_text(f'<robot name="robot">{trunk}{leg}{HIP}</robot>')
    convert_urdf_to_mjcf("robot.urdf", "robot.mjcf", metadata=ConversionMetadata(**options))
    model = mujoco.MjModel.from_xml_path("robot.mjcf")
    trunk, leg = model.body("trunk"), model.body("leg")
    return np.array([trunk.mass[0], leg.mass[0], trunk.ipos[2]])


body, battery = BOX.format(x=0, length=0.4), BOX.format(x=0.3, length=0.2)
print(f"urdf2mjcf {version('urdf2mjcf')}, MuJoCo {mujoco.__version__}")
free, loaded, bolted = converted(body), converted(body + battery), converted(body, floating_base=False)
for name, (trunk, leg, centre) in (("free", free), ("with a battery", loaded), ("bolted down", bolted)):
    print(f"{name:14} trunk {trunk:4.1f} kg with its centre at {100 * centre:.0f} cm, leg {leg:.1f} kg")
right = np.allclose(free, [8, 1, 0]) and np.allclose(loaded, [12, 1, 0]) and np.allclose(bolted, [5, 1, 0.05])
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python trunk.py
