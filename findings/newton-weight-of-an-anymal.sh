#!/bin/sh
# ANYmal C in Newton, from its URDF as example-robot-data has it.
#
# Seen with newton 1.8.0, warp-lang 1.19.0 and example-robot-data 6.0.0:
# - the file's link `base` has boxes and cylinders to collide with and no <inertial>: its frame is a name, the trunk's mass
#   stands in `base_inertia`, fixed to it. URDF says that a link without <inertial> has no mass: the file's links weigh 52.13 kg
#   together, and pinocchio and adam say so;
# - add_urdf gives `base` the mass of its shapes as if they were of water, 29.38 kg, besides the 52.13: the robot weighs
#   81.51 kg, and its centre of mass lies 25 mm higher. Nothing is said of it: finalize counts bodies whose
#   inertias it corrected, one of ANYmal B too;
# - with `default_shape_cfg.density = 0` it weighs what its file says.
# ANYmal B, whose `base` has a mass, weighs the same either way.
#
# Guess beforehand: an inertia that a file leaves out is none, as the format has it; shapes weigh something where the format
# is MJCF. Forces that were planned for the file are two thirds of what the feet have to bear there, and the other way round.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: \
  "newton==1.8.0" "warp-lang==1.19.0" "numpy==2.4.6"
env/bin/pip install --quiet --disable-pip-version-check --no-deps "example-robot-data==6.0.0"
cat > weights.py <<'PYTHON'
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from importlib.metadata import version
from pathlib import Path
from sysconfig import get_path

import newton
import numpy as np
import warp

ROBOTS = Path(get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
warp.config.quiet = True


def read(robot, density=None):
    builder = newton.ModelBuilder()
    if density is not None:
        builder.default_shape_cfg.density = density
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        builder.add_urdf(robot, floating=True, enable_self_collisions=False)
        model = builder.finalize(device="cpu")
    state = model.state()
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    poses, masses = state.body_q.numpy(), model.body_mass.numpy()
    turns = [np.array(warp.quat_to_matrix(warp.quat(*map(float, pose[3:])))).reshape(3, 3) for pose in poses]
    centres = [pose[:3] + turn @ centre for pose, turn, centre in zip(poses, turns, model.body_com.numpy())]
    words = [str(each.message) for each in said if "density" in str(each.message) or "weigh" in str(each.message)]
    return masses.sum(), (masses @ np.array(centres) / masses.sum())[2], words


print(", ".join(f"{name} {version(name)}" for name in ("newton", "warp-lang", "example-robot-data")))
right = True
for path, extra in (
    ("anymal_c_simple_description/urdf/anymal.urdf", 29.38),
    ("anymal_b_simple_description/robots/anymal.urdf", 0.0),
):
    robot = ElementTree.parse(ROBOTS / path).getroot()
    weight = sum(float(mass.get("value")) for mass in robot.findall("link/inertial/mass"))
    for link in robot.findall("link"):
        for visual in link.findall("visual"):  # they weigh nothing, and take minutes to be read
            link.remove(visual)
    robot = ElementTree.tostring(robot, encoding="unicode")
    (there, height, words), (without, lower, _) = read(robot), read(robot, density=0.0)
    print(f"{path}: file {weight:.2f} kg, Newton {there:.2f} kg, with a density of 0 {without:.2f} kg")
    print(f"  centre of mass {1000 * (height - lower):.1f} mm higher than with a density of 0; said of it: {words}")
    right &= abs(there - weight - extra) < 0.02 and abs(without - weight) < 0.01 and words == []
    right &= abs(height - lower - 0.025 * (extra > 0)) < 0.001
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python weights.py
