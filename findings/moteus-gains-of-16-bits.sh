#!/bin/sh
# Gains and positions of a moteus, which drives the joints of many quadrupeds, sent in two bytes each.
#
# Seen with moteus 1.1.1: one position command by Controller.make_position and PositionResolution, in four bytes a field
# and in two, the frame read back by moteus' own parser:
# - kp_scale=2 and kd_scale=1.5 are 2 and 1.5 in four bytes, and both 1 in two: a leg asked to be twice as stiff is not;
# - position=-3.5 revolutions (of a motor before its gears) is -3.28, which is 80 degrees off;
# - position=0.25197 is 0.2519 (0.2520 is nearer): what is left over is cut off towards 0.
# No word is said of any of it.
#
# Guess beforehand: a number that does not fit is an error, and one that does is rounded.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "moteus==1.1.1" "numpy==2.4.6" "scipy==1.17.1"
cat > stiff.py <<'PYTHON'
import sys
import warnings
from importlib.metadata import version

import moteus
from moteus import multiplex

ASKED = {"position": -3.5, "kp_scale": 2.0, "kd_scale": 1.5}
REGISTERS = {
    "position": moteus.Register.COMMAND_POSITION,
    "kp_scale": moteus.Register.COMMAND_KP_SCALE,
    "kd_scale": moteus.Register.COMMAND_KD_SCALE,
}


class Transport:
    """Nothing is sent: only what would be is looked at."""

    async def cycle(self, *_):
        return []


def read_back(resolution, **asked):
    """What a command says to a motor, by the name of each field."""
    fields = moteus.PositionResolution()
    for name in REGISTERS:
        setattr(fields, name, resolution)
    motor = moteus.Controller(id=1, position_resolution=fields, transport=Transport())
    said = {frame.register: frame.value for frame in multiplex.parse_frame(motor.make_position(**asked).data)
            if isinstance(frame, multiplex.RegisterSubframe)}
    scales = {"position": 0.0001, "kp_scale": 1 / 32767, "kd_scale": 1 / 32767}
    factors = scales if resolution == multiplex.INT16 else dict.fromkeys(scales, 1.0)
    return {name: said[REGISTERS[name].value] * factors[name] for name in asked}


print(f"moteus {version('moteus')}")
with warnings.catch_warnings():
    warnings.simplefilter("error")
    four, two = (read_back(resolution, **ASKED) for resolution in (multiplex.F32, multiplex.INT16))
    small = read_back(multiplex.INT16, position=0.25197)["position"]
for name, value in ASKED.items():
    print(f"{name}: asked {value}, in four bytes {four[name]:.4f}, in two {two[name]:.4f}")
print(f"position: asked 0.25197, in two bytes {small:.4f}")
whole = four == ASKED
cut = abs(two["position"] + 3.2767) < 1e-9 and abs(two["kp_scale"] - 1) < 1e-9 and abs(two["kd_scale"] - 1) < 1e-9
sys.exit(0 if whole and cut and abs(small - 0.2519) < 1e-9 else "something is otherwise now")
PYTHON
env/bin/python stiff.py
