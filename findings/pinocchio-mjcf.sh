#!/bin/sh
# pinocchio 4.1.0's reader of MJCF (buildModelFromMJCF) against MuJoCo 4.0.0's compiler, on one valid
# file of a robot and a box.
#
# Seen with pin 4.1.0 and mujoco 4.0.0:
# - limits of a slide, -0.2 to 0.3 m, are read as degrees: -0.00349 to 0.00524;
# - of two bodies in the world, the second is not there: 6.7 kg of 9.7;
# - efforts are infinite for motors limited by ctrlrange and gear, and by forcerange;
# - a range of 10 to 90 degrees with ref 30 is one of -20 to 60, since angles count from ref, where
#   MuJoCo's count from the drawn posture at 30.
#
# Guess beforehand: both read one format, so that one file gives one robot: the same bodies, limits of
# slides in metres, and for every motor the effort that the file allows it.
# What seems to happen: every range of a file in degrees is turned into radians, whatever the joint's
# type; the first body of the world is the root, and the only one; efforts are those of joints
# (actuatorfrcrange), not of actuators.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "pin==4.1.0" "mujoco==4.0.0"
cat > robot.xml <<'XML'
<mujoco model="two">
  <worldbody>
    <body name="base" pos="0 0 1"><freejoint/>
      <geom type="box" size=".2 .1 .05" mass="5"/>
      <body name="thigh" pos="0 0 -.1">
        <joint name="hip" axis="0 1 0" range="-60 60"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".6"/>
        <body name="shank" pos="0 0 -.2">
          <joint name="slide" type="slide" axis="0 0 1" range="-.2 .3"/>
          <geom type="sphere" size=".03" mass=".6"/>
        </body>
      </body>
      <body name="arm" pos="0 .1 0">
        <joint name="shoulder" axis="1 0 0" range="10 90" ref="30"/>
        <geom type="box" size=".02 .1 .02" mass=".5"/>
      </body>
    </body>
    <body name="other" pos="2 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/></body>
  </worldbody>
  <actuator>
    <motor joint="hip" ctrlrange="-10 10" gear="2"/>
    <motor joint="slide" ctrlrange="-50 50"/>
    <motor joint="shoulder" forcerange="-7 7"/>
  </actuator>
</mujoco>
XML
env/bin/python - <<'PYTHON'
import sys

import mujoco
import numpy as np
import pinocchio as pin

theirs, read = mujoco.MjModel.from_xml_path("robot.xml"), pin.buildModelFromMJCF("robot.xml")
print(f"pinocchio {pin.__version__}, MuJoCo {mujoco.__version__}")
mass = sum(inertia.mass for inertia in read.inertias)
print(f"mass: MuJoCo {theirs.body_mass.sum():g} kg, pinocchio {mass:g} kg")
limits = {}
for name in ("hip", "slide", "shoulder"):
    at = read.joints[read.getJointId(name)].idx_q
    limits[name] = float(read.lowerPositionLimit[at]), float(read.upperPositionLimit[at])
    own = theirs.joint(name).range.round(5).tolist()
    print(f"{name}: MuJoCo {own}, pinocchio {[round(each, 5) for each in limits[name]]}")
print(f"efforts: pinocchio {read.effortLimit[6:].tolist()}")
seen = (
    np.allclose(limits["slide"], np.deg2rad([-0.2, 0.3]))
    and np.isclose(mass, 6.7)
    and np.isclose(theirs.body_mass.sum(), 9.7)
    and bool(np.isinf(read.effortLimit[6:]).all())
    and np.allclose(limits["shoulder"], np.deg2rad([-20.0, 60.0]))
)
sys.exit(not seen)
PYTHON
