#!/bin/sh
# A humanoid let go in the air, by crocoddyl and the pinocchio that pip brings with it.
#
# Seen with crocoddyl 3.2.1, which asks for pinocchio of any version:
# - with pinocchio 4.1.0, the newest, DifferentialActionModelFreeFwdDynamics leaves it where it is: no joint and no axis
#   of its base is accelerated, though gravity stands in the model that the state holds. Its derivatives are those of a
#   robot that falls; forward dynamics with a list of no contacts, and pinocchio.aba, let it fall at 9.81 m/s²;
# - with pinocchio 4.0.0 all three fall alike.
#
# Guess beforehand: versions that pip lets stand beside each other fall alike, and whatever is wrong is said at import.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat > fall.py <<'PYTHON'
import sys
from importlib.metadata import version

import crocoddyl
import numpy as np
import pinocchio

model = pinocchio.buildSampleModelHumanoid()
state = crocoddyl.StateMultibody(model)
actuation = crocoddyl.ActuationModelFloatingBase(state)
costs = crocoddyl.CostModelSum(state, actuation.nu)
free = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
contacts = crocoddyl.ContactModelMultiple(state, actuation.nu)
held = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs)
torques, still = np.zeros(actuation.nu), state.zero()
falls = {}
for name, dynamics in (("free", free), ("no contacts", held)):
    data = dynamics.createData()
    dynamics.calc(data, still, torques)
    falls[name] = data.xout.copy()
falls["pinocchio"] = pinocchio.aba(model, model.createData(), still[: model.nq], np.zeros(model.nv), np.zeros(model.nv))
print(f"crocoddyl {version('crocoddyl')}, pinocchio {pinocchio.__version__}, gravity {state.pinocchio.gravity.linear}")
for name, acceleration in falls.items():
    print(f"  {name:11s} base upward {acceleration[2]:8.4f} m/s2, largest of all {np.abs(acceleration).max():8.4f}")
right = all(abs(falls[name][2] + 9.81) < 1e-6 for name in ("no contacts", "pinocchio"))
expected = -9.81 if sys.argv[1] == "falls" else 0.0
sys.exit(0 if right and abs(falls["free"][2] - expected) < 1e-6 else "something is otherwise now")
PYTHON
check() {
  "${PYTHON:-python3}" -m venv "with-$1"
  "with-$1/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: \
    "crocoddyl==3.2.1" "pin==$1" "libpinocchio==$1" "numpy==2.4.6"
  "with-$1/bin/python" fall.py "$2"
}
check 4.1.0 stays
check 4.0.0 falls
