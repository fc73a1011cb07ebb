#!/bin/sh
# proxsuite's dense ProxQP: forces of one stance after another, kept in a list.
#
# Seen with proxsuite 0.8.0: results.x, results.y and results.z are windows into the solver, not answers. After
# the second solve the x that was kept from the first is the second's; np.asarray of it, too. So a list of what a loop
# found holds the last answer as often as it has entries. A copy at once keeps the first.
#
# Guess beforehand: an answer that was given stays as it was, as with OSQP, Clarabel and quadprog. A plan of forces
# that is gathered stance by stance has the last stance's forces under every stance, and each is within its cone.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "proxsuite==0.8.0" "numpy==2.4.6"
cat > kept.py <<'PYTHON'
import sys
from importlib.metadata import version

import numpy as np
from proxsuite import proxqp

# Two feet share 100 N; the centre of mass lies at a share of the way from the first to the second.
WEIGHT = 100.0
program = proxqp.dense.QP(2, 2, 2)
rows, most = np.array([[1.0, 1.0], [0.0, 1.0]]), np.full(2, 1e3)
kept, viewed, copied = [], [], []
for share in (0.1, 0.5, 0.9):
    wanted = np.array([WEIGHT, share * WEIGHT])
    if not kept:
        program.init(np.eye(2), np.zeros(2), rows, wanted, np.eye(2), np.zeros(2), most)
    else:
        program.update(b=wanted)
    program.solve()
    if program.results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED:
        sys.exit("a program of two forces is not solved")
    kept.append(program.results.x)
    viewed.append(np.asarray(program.results.x))
    copied.append(program.results.x.copy())
print(f"proxsuite {version('proxsuite')}")
for name, found in (("kept", kept), ("as arrays", viewed), ("copied", copied)):
    print(f"{name:10}", *(np.round(x, 1).tolist() for x in found))
shares = np.array([[90.0, 10.0], [50.0, 50.0], [10.0, 90.0]])
same = all(np.array_equal(x, copied[-1]) for x in (*kept, *viewed))
sys.exit(0 if same and np.abs(np.array(copied) - shares).max() < 1e-2 else "something is otherwise now")
PYTHON
env/bin/python kept.py
