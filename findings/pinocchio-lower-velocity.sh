#!/bin/sh
# pinocchio: the lower limit of a joint's velocity.
#
# Seen with pin 4.1.0, a URDF whose hinge has velocity="5" and effort="30", and a free base:
# - efforts are limited from -30 to 30 Nm;
# - velocities from 5 to 5 rad/s: lowerVelocityLimit has the upper limit's sign. For the base, which has no limit,
#   both are 1.8e308, so that no velocity is between them.
# Releases before 4 have velocityLimit alone.
#
# Guess beforehand: the lower limit of a velocity is minus the upper one, as it is for the effort
# beside it. A velocity of 0 that is clipped to the limits becomes 5 rad/s, and a program that has them as bounds
# of a leg that stands has no solution.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "pin==4.1.0"
cat > limits.py <<'PYTHON'
import sys

import numpy as np
import pinocchio as pin

INERTIA = (
    '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
ROBOT = (
    f'<robot name="leg"><link name="trunk">{INERTIA}</link><link name="leg">{INERTIA}</link>'
    '<joint name="hip" type="revolute"><parent link="trunk"/><child link="leg"/>'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="30" velocity="5"/></joint></robot>'
)
model = pin.buildModelFromXML(ROBOT, pin.JointModelFreeFlyer())
effort = float(model.lowerEffortLimit[-1]), float(model.upperEffortLimit[-1])
velocity = float(model.lowerVelocityLimit[-1]), float(model.upperVelocityLimit[-1])
rest = np.clip(np.zeros(model.nv), model.lowerVelocityLimit, model.upperVelocityLimit)
print(f"pinocchio {pin.__version__}: effort {effort} Nm, velocity {velocity} rad/s")
print(f"at rest, clipped to the limits: {rest[-1]} rad/s, the base {rest[0]:.1e} m/s")
right = effort == (-30.0, 30.0) and velocity == (5.0, 5.0) and rest[0] > 1e300
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python limits.py
