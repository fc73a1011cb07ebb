#!/bin/sh
# mink: whose centre of mass a ComTask moves where the world's file has ground in it.
#
# Seen with mink 1.3.0 and mujoco 4.0.0, a robot with a free base and a box to step on:
# - where the robot is the first body of the file, a ComTask moves its centre of mass by the 5 cm asked for;
# - where the box is, the task takes the box's place for the centre of mass: its target starts 1 m away, its
#   Jacobian is 0, the robot stays where it is, and solve_ik neither fails nor says so.
# The task reads the tree of body 1.
#
# Guess beforehand: the centre of mass is that of what moves, or of everything. A balance task added after
# other tasks is silently none, in every scene whose file includes the terrain before the robot.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "mink==1.3.0" "mujoco==4.0.0" "daqp==0.11.0" "numpy==2.3.5"
cat > balance.py <<'PYTHON'
import sys

import mink
import mujoco
import numpy as np

ROBOT = (
    '<body name="trunk" pos="0 0 .5"><freejoint/><geom type="box" size=".3 .1 .05" mass="10"/>'
    '<body pos=".3 0 0"><joint axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1"/></body></body>'
)
STEP = '<body name="step" pos="1 0 .1"><geom type="box" size=".3 1 .1"/></body>'


def moved(bodies):
    """How far a task of 5 cm moves the robot, and the task's Jacobian."""
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
    )
    configuration = mink.Configuration(model)
    trunk = model.body("trunk").id
    begin = configuration.data.subtree_com[trunk].copy()
    task = mink.ComTask(cost=np.ones(3))
    task.set_target_from_configuration(configuration)
    task.set_target(task.target_com + [0.05, 0.0, 0.0])
    for _ in range(50):
        velocity = mink.solve_ik(configuration, [task], 0.02, "daqp", damping=1e-6)
        configuration.integrate_inplace(velocity, 0.02)
    mujoco.mj_comPos(model, configuration.data)
    gone = configuration.data.subtree_com[trunk] - begin
    return gone[0], np.abs(task.compute_jacobian(configuration)).max()


first, second = moved(ROBOT + STEP), moved(STEP + ROBOT)
print(f"robot first: moved {1e3 * first[0]:.1f} mm of 50, largest entry of the Jacobian {first[1]:.2f}")
print(f"step first:  moved {1e3 * second[0]:.1f} mm of 50, largest entry of the Jacobian {second[1]:.2f}")
right = abs(first[0] - 0.05) < 1e-4 and second == (0.0, 0.0)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python balance.py
