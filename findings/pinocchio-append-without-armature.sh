#!/bin/sh
# pinocchio: a leg and an arm, whose motors have inertia behind their gears, put together by appendModel.
#
# Seen with pin 4.1.0, two limbs of two joints with damping, friction, limits and an armature of .02 kg m2 each:
# - in the model of both, damping, friction and limits are those of the parts; every armature is 0, also those of the model
#   that is appended to;
# - 5 Nm at the hip accelerate it by 202 rad/s2, where the leg alone has 69, although the arm hangs from the world beside it;
# - by rnea the swing that takes 5 Nm of the hip takes 3.6;
# - buildReducedModel, which locks joints, keeps the armature of the others.
#
# Guess beforehand: what carries limits, damping and friction carries what stands beside them. Feed-forward torques of a leg
# are too low for its motors as soon as something is mounted on the robot. The function's text says nothing of it.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "pin==4.1.0" "libpinocchio==4.1.0" "numpy==2.4.6"
cat > mount.py <<'PYTHON'
import sys

import numpy as np
import pinocchio

ARMATURE = 0.02


def limb(name, joints, mass):
    parts = [f'<robot name="{name}"><link name="{name}"/>']
    parent = name
    for joint in joints:
        parts.append(
            f'<link name="below {joint}"><inertial><origin xyz="0 0 -.1"/><mass value="{mass}"/>'
            '<inertia ixx=".002" iyy=".002" izz=".0002" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="below {joint}"/>'
            '<origin xyz="0 0 -.2"/><axis xyz="0 1 0"/><dynamics damping=".5" friction=".1"/>'
            '<limit lower="-2" upper="2" effort="20" velocity="20"/></joint>'
        )
        parent = f"below {joint}"
    model = pinocchio.buildModelFromXML("".join(parts) + "</robot>")
    model.armature = np.full(model.nv, ARMATURE)
    return model


def accelerated(model, torques):
    return pinocchio.aba(model, model.createData(), pinocchio.neutral(model), np.zeros(model.nv), np.array(torques))


leg, arm = limb("leg", ("hip", "knee"), 0.5), limb("arm", ("shoulder", "elbow"), 0.4)
both = pinocchio.appendModel(leg, arm, 0, pinocchio.SE3.Identity())
locked = pinocchio.buildReducedModel(leg, [leg.getJointId("knee")], pinocchio.neutral(leg))
alone = accelerated(leg, [5.0, 1.0])
mounted = accelerated(both, [5.0, 1.0, 0.0, 0.0])
kept = [np.concatenate([getattr(leg, of), getattr(arm, of)]) for of in ("damping", "friction", "upperEffortLimit")]
found = [getattr(both, of) for of in ("damping", "friction", "upperEffortLimit")]
swing = np.append(alone, [0.0, 0.0])
needed = pinocchio.rnea(both, both.createData(), pinocchio.neutral(both), np.zeros(both.nv), swing)
leg.armature = np.zeros(leg.nv)
without = accelerated(leg, [5.0, 1.0])
print(f"pinocchio {pinocchio.__version__}, joints {list(both.names)[1:]}")
print(f"armature {both.armature} kg m2, damping {both.damping}, friction {both.friction}")
print(f"hip by 5 Nm: the leg alone {alone[0]:.1f} rad/s2, with an arm beside it {mounted[0]:.1f} rad/s2")
print(f"by rnea the leg's swing takes {needed[0]:.2f} Nm of the hip")
gone = not both.armature.any() and np.allclose(mounted[:2], without)
lighter = mounted[0] > 2.5 * alone[0] and abs(needed[0] - 3.6) < 0.1
carried = np.allclose(kept, found) and np.allclose(locked.armature, ARMATURE)
sys.exit(0 if gone and lighter and carried else "something is otherwise now")
PYTHON
env/bin/python mount.py
