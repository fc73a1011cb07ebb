#!/bin/sh
# placo: how much friction a unilateral contact of its dynamics solver takes.
#
# Seen with placo 0.10.2, a trunk on four point contacts with mu = .6, pushed sideways by an acceleration:
# - along an axis, 5.5 m/s2 is solved and 6.5 is not, as mu g = 5.9 says;
# - at 45 degrees, 7.5 m/s2 is solved, with forces of .85 times the normal force: mu times the square root of 2.
#
# Guess beforehand: success means that the contacts hold with the friction that was set, since a pyramid
# that stands for a cone lies inside it. It lies around it, and a push that is turned by 45 degrees is taken
# where the feet slide. A margin of friction that was tuned along x says nothing of the diagonal.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "placo==0.10.2"
cat > push.py <<'PYTHON'
import sys
from pathlib import Path

import numpy as np
import placo

MU = 0.6
INERTIA = 'ixy="0" ixz="0" iyz="0"'
parts = [
    f'<link name="trunk"><inertial><mass value="10"/><inertia ixx=".1" iyy=".1" izz=".1" {INERTIA}/>'
    "</inertial></link>"
]
for leg, (x, y) in enumerate([(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]):
    parts.append(
        f'<link name="foot{leg}"><inertial><mass value=".1"/>'
        f'<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" {INERTIA}/></inertial></link>'
        f'<joint name="hip{leg}" type="revolute"><parent link="trunk"/><child link="foot{leg}"/>'
        f'<origin xyz="{x} {y} -.3"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="500" velocity="10"/></joint>'
    )
Path("robot").mkdir()
Path("robot/robot.urdf").write_text(f'<robot name="robot">{"".join(parts)}</robot>')
robot = placo.RobotWrapper("robot/robot.urdf", placo.Flags.ignore_collisions)
robot.update_kinematics()


def share(along, acceleration):
    """The largest share of tangential in normal force [1], or None where nothing is solved."""
    solver, contacts = placo.DynamicsSolver(robot), []
    for leg in range(4):
        task = solver.add_position_task(f"foot{leg}", robot.get_T_world_frame(f"foot{leg}")[:3, 3])
        task.configure(f"stays {leg}", "soft", 1.0)
        contacts.append(solver.add_unilateral_point_contact(task))
        contacts[-1].mu = MU
    centre = solver.add_com_task(robot.com_world())
    centre.ddtarget_world = acceleration * np.array([*along, 0.0]) / np.linalg.norm(along)
    centre.kp = centre.kd = 0.0
    centre.configure("push", "hard", 1.0)
    if not solver.solve(False).success:
        return None
    forces = np.array([each.wrench for each in contacts])
    held = forces[:, 2] > 1.0
    return float(np.max(np.linalg.norm(forces[held, :2], axis=1) / forces[held, 2]))


seen = [share((1, 0), 5.5), share((1, 0), 6.5), share((1, 1), 7.5)]
for name, each in zip(("5.5 along x", "6.5 along x", "7.5 at 45 degrees"), seen, strict=True):
    print(f"{name:18}", "not solved" if each is None else f"tangential force {each:.3f} of the normal one")
right = (
    seen[1] is None
    and abs(seen[0] - MU) < 0.01
    and abs(seen[2] - MU * 2**0.5) < 0.01
)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python push.py
