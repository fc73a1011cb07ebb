#!/bin/sh
# CasADi: the height of ground beyond the edge of its map.
#
# Seen with casadi 3.8.2, a map of 2 x 1 m that rises by .1 along x, asked for at x = 2.0 and 2.1 m:
# - "linear" goes on as the last cell does: .20 and .21 m, slope .1;
# - "bspline" says .20 m and then 0 m, with a slope of 0, beyond every edge.
# Neither says a word, in the value or in the derivatives.
#
# Guess beforehand: both go on, or stay at the edge's height, so that the one can be put in place of the
# other where a solver wants second derivatives. An optimizer of footholds that looks over the edge for a
# moment finds level ground .2 m below, where nothing leads back: the slope is 0.
# The spline also passes a riser of .2 m at up to .22 m above and 2 cm below the treads.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "casadi==3.8.2" "numpy==2.3.5"
cat > map.py <<'PYTHON'
import sys

import casadi as ca
import numpy as np

x, y = np.linspace(0.0, 2.0, 9), np.linspace(0.0, 1.0, 9)
ramp = np.add.outer(0.1 * x, 0.0 * y)
riser = np.add.outer(np.where(x < 1.0, 0.0, 0.2), 0.0 * y)
at = ca.MX.sym("at", 2)


def asked(kind, heights, xs):
    surface = ca.interpolant("surface", kind, [x, y], heights.ravel(order="F"))
    slope = ca.Function("slope", [at], [ca.gradient(surface(at), at)])
    return (
        np.array([float(surface([each, 0.5])) for each in xs]),
        np.array([float(slope([each, 0.5])[0]) for each in xs]),
    )


right = True
for kind, beyond, slopes in (("linear", 0.21, 0.1), ("bspline", 0.0, 0.0)):
    height, slope = asked(kind, ramp, (2.0, 2.1))
    print(f"{kind:8}height at 2.0 and 2.1 m {height.round(3)}, slope at 2.1 m {slope[1]:.3f}")
    right &= np.allclose(height, [0.2, beyond], atol=1e-6) and abs(slope[1] - slopes) < 1e-6
top, _ = asked("bspline", riser, np.linspace(0.0, 2.0, 201))
print(f"bspline at a riser: {top.min():.3f} to {top.max():.3f} m where the treads are at 0 and .2")
right &= top.min() < -0.015 and top.max() > 0.215
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python map.py
