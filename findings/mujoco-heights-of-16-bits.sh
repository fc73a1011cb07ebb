#!/bin/sh
# A height field of MuJoCo from a PNG of 16 bits, as elevation tools write them: 4096 heights on a ramp, each
# of them different.
#
# Seen with mujoco 4.0.0: 256 different heights are left, so that sixteen samples in a row lie on one level
# where each was higher than the one before. The same heights set as hfield_data keep all 4096.
#
# Guess beforehand: hfield_data is float32 and the picture has 16 bits, so that what is read is as fine as the
# picture.
# What seems to happen: pictures are decoded to 8 bits of grey, whatever they have.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "mujoco==4.0.0" "pillow==13.0.0" "numpy==2.4.6"
cat > heights.py <<'PYTHON'
import sys

import mujoco
import numpy as np
from PIL import Image

heights = 16 * np.arange(4096, dtype=np.uint16).reshape(64, 64)
Image.fromarray(heights).save("ramp.png")
model = mujoco.MjModel.from_xml_string(
    '<mujoco><asset><hfield name="h" file="ramp.png" size="1 1 1 .1"/></asset>'
    '<worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>'
)
read = len(np.unique(model.hfield_data))
model.hfield_data[:] = heights.ravel() / heights.max()
own = len(np.unique(model.hfield_data))
print(f"MuJoCo {mujoco.__version__}: {read} heights of {len(np.unique(heights))}; set: {own}")
sys.exit((read, own) != (256, 4096))
PYTHON
env/bin/python heights.py
