#!/bin/sh
# pycapacity: what force a foot bears, as the polytope of what the torques of its leg allow.
#
# Seen with pycapacity 2.1.9, a leg of two links of .2 m in its plane whose hip and knee hold 20 Nm each:
# - bent by .02 rad, the foot bears up to 7,500 N upward, and every corner keeps the torques' limits;
# - straight, where bones bear any weight, every corner has 0 N upward, so that the leg bears none; and corners
#   of 60 N sideways need 24 Nm of a hip that holds 20.
# There is no error and no warning, and the corners' own torques, which are returned beside them, are within limits.
#
# Guess beforehand: a set without an end is refused, or its corners are very far away, as those of the leg that is nearly
# straight are. A robot that stands on straight legs, which is how bipeds rest, is found too weak for its own weight.
# What seems to happen: corners are found by the pseudo-inverse of the Jacobian, whose rank is one here.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "pycapacity==2.1.9" "numpy==2.4.6"
cat > leg.py <<'PYTHON'
import sys
from importlib.metadata import version

import numpy as np
from pycapacity.robot import force_polytope

LINK, TORQUE = 0.2, 20.0


def corners(hip, knee):
    """Forces on the foot, and the torques that they need by the leg's Jacobian."""
    upper, lower = hip, hip + knee
    jacobian = LINK * np.array(
        [
            [-np.cos(upper) - np.cos(lower), -np.cos(lower)],
            [np.sin(upper) + np.sin(lower), np.sin(lower)],
        ]
    )
    most = np.full((2, 1), TORQUE)
    found = force_polytope(jacobian, most, -most)
    return found.vertices, jacobian.T @ found.vertices, found.torque_vertices


print(f"pycapacity {version('pycapacity')}")
seen = []
for name, bend in (("bent by .02 rad", 0.02), ("straight", 0.0)):
    forces, needed, told = corners(bend, -2 * bend)
    seen.append((forces[1].max(), abs(needed).max(), abs(told).max()))
    print(f"{name}: corners {forces.T.round(1).tolist()} N (x, z)")
    print("  up to {:.0f} N upward, needs {:.1f} Nm, told {:.1f} Nm".format(*seen[-1]))
bent, straight = seen
right = bent[0] > 7000 and bent[1] < TORQUE + 1e-6
odd = abs(straight[0]) < 1e-6 and straight[1] > 1.1 * TORQUE and straight[2] <= TORQUE
sys.exit(0 if right and odd else "something is otherwise now")
PYTHON
env/bin/python leg.py
