#!/bin/sh
# The velocity of a body on a curve of ndcurves, handed to pinocchio as the motion that it says it is.
#
# Seen with ndcurves 2.3.0 and pinocchio 4.1.0, and a body that goes 1 m along x up a ramp, pitched by 25 degrees, and turns
# by 90 degrees about its own upright axis: SE3Curve.derivateAsMotion is a pinocchio.Motion, whose linear half is in
# axes of the world and whose angular half in axes of the body. It is none of LOCAL, WORLD and LOCAL_WORLD_ALIGNED, and
# what follows it as any of them does not end where the curve does:
# - as LOCAL 0.81 m off, as LOCAL_WORLD_ALIGNED 0.62 rad, as WORLD 0.73 m and 0.62 rad;
# - the halves read apart, each in its own axes, end where the curve ends.
#
# Guess beforehand: a Motion is in one frame, and one of the three is right.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "ndcurves==2.3.0" "pin==4.1.0" "numpy==2.4.6"
cat > ramp.py <<'PYTHON'
import sys
import warnings
from importlib.metadata import version

import numpy as np

warnings.simplefilter("ignore", RuntimeWarning)
import pinocchio
from ndcurves import SE3Curve
from pinocchio import SE3, Motion, exp3, exp6, log3

STEPS = 4000
START = SE3(exp3(np.array([0.0, np.radians(-25), 0.0])), np.zeros(3))
END = SE3(START.rotation @ exp3(np.array([0.0, 0.0, np.pi / 2])), np.array([1.0, 0.0, 0.0]))
CURVE = SE3Curve(START, END, 0.0, 1.0)


def local(pose, motion):
    return pose * exp6(Motion(motion * (1 / STEPS)))


def world(pose, motion):
    return exp6(Motion(motion * (1 / STEPS))) * pose


def aligned(pose, motion):
    return SE3(exp3(motion.angular / STEPS) @ pose.rotation, pose.translation + motion.linear / STEPS)


def apart(pose, motion):
    return SE3(pose.rotation @ exp3(motion.angular / STEPS), pose.translation + motion.linear / STEPS)


print(f"ndcurves {version('ndcurves')}, pinocchio {pinocchio.__version__}")
middle = CURVE.derivateAsMotion(0.5, 1)
print("halfway:", type(middle).__name__, "linear", middle.linear.round(3), "angular", middle.angular.round(3))
off = {}
for follow in (local, world, aligned, apart):
    pose = START
    for k in range(STEPS):
        pose = follow(pose, CURVE.derivateAsMotion((k + 0.5) / STEPS, 1))
    metres = np.linalg.norm(pose.translation - END.translation)
    radians = np.linalg.norm(log3(END.rotation.T @ pose.rotation))
    off[follow.__name__] = metres, radians
    print(f"followed as {follow.__name__:8s} ends {metres:.3f} m and {radians:.3f} rad off")
wrong = off["local"][0] > 0.4 and off["aligned"][1] > 0.4 and min(off["world"]) > 0.4
sys.exit(0 if isinstance(middle, Motion) and wrong and max(off["apart"]) < 1e-3 else "something is otherwise now")
PYTHON
env/bin/python ramp.py
