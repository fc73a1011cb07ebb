#!/bin/sh
# Two humanoids of example-robot-data: whether their left halves are the mirror images of the right ones.
#
# Seen with example-robot-data 6.0.0 and pin 4.1.0:
# - iCub, "icub" and "icub_reduced": from hip to ankle the links of both legs have equal masses. The left ones have inertias
#   of up to .0076 kg m2, the right ones 0 or about 1e-18, some of them negative. About the hip's yaw the left leg has
#   .0055 kg m2, the right one .0024; the feet are alike.
# - Alex, with each of its three hands: shoulder and elbow of the left arm hold 80 to 150 Nm and go 9 to 11.5 rad/s, those of
#   the right arm 1000 Nm and 100 rad/s.
#
# Guess beforehand: the sides of a humanoid are alike, so that what is planned, learned or identified at one is mirrored to
# the other. Turned on the left foot, the other leg takes less than half of the torque that it takes on the right one, and
# whatever shares a load by what joints hold gives it to Alex's right arm.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "pin==4.1.0" "libpinocchio==4.1.0" "numpy==2.4.6"
env/bin/pip install --quiet --disable-pip-version-check --no-deps "example-robot-data==6.0.0"
cat > sides.py <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path
from sysconfig import get_path

import numpy as np
import pinocchio

ROBOTS = Path(get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch")
ARM = ("ShoulderPitch", "ShoulderRoll", "ShoulderYaw", "ElbowPitch")


def read(path):
    model = pinocchio.buildModelFromUrdf(str(ROBOTS / path), pinocchio.JointModelFreeFlyer())
    masses = pinocchio.crba(model, model.createData(), pinocchio.neutral(model)).diagonal()
    return model, masses


def of_joints(model, names, numbers):
    return np.array([numbers[model.idx_vs[model.getJointId(name)]] for name in names])


print(", ".join(f"{name} {version(name)}" for name in ("example-robot-data", "pin")))
right = True
for name in ("icub", "icub_reduced"):
    model, masses = read(f"icub_description/robots/{name}.urdf")
    sides = [[model.inertias[model.getJointId(f"{side}_{joint}")] for joint in LEG] for side in "lr"]
    weights = np.array([[link.mass for link in side] for side in sides])
    inertias = np.array([[np.linalg.eigvalsh(link.inertia).max() for link in side] for side in sides])
    yaw, feet = (of_joints(model, (f"l_{joint}", f"r_{joint}"), masses) for joint in ("hip_yaw", "ankle_roll"))
    negative = min(np.linalg.eigvalsh(link.inertia).min() for link in sides[1])
    print(f"{name}: inertias left {inertias[0].round(4)}, right {inertias[1].round(4)} kg m2, about the yaw {yaw.round(4)}")
    right &= np.allclose(weights[0], weights[1]) and inertias[0].min() > 5e-4 and inertias[1].max() < 1e-15 and negative < 0
    right &= abs(yaw[0] / yaw[1] - 2.27) < 0.05 and np.isclose(*feet)
for hands in ("nub", "sake", "psyonic"):
    model, _ = read(f"alex_description/urdf/alex_{hands}_hands.urdf")
    joints = [[f"{side}{joint}" for joint in ARM] for side in ("Left", "Right")]
    torques = np.array([of_joints(model, names, model.upperEffortLimit) for names in joints])
    speeds = np.array([of_joints(model, names, model.upperVelocityLimit) for names in joints])
    print(f"alex_{hands}_hands: left {torques[0]} Nm {speeds[0]} rad/s, right {torques[1]} Nm {speeds[1]} rad/s")
    right &= np.allclose(torques[0], [150, 150, 80, 80]) and np.allclose(torques[1], 1000)
    right &= np.allclose(speeds[0], [9, 9, 11.5, 11.5]) and np.allclose(speeds[1], 100)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python sides.py
