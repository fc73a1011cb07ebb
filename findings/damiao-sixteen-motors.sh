#!/bin/sh
# Motors of a robot's legs, numbered by leg and joint, as damiao-motor hears them.
#
# Seen with damiao-motor 1.0.6 and python-can 4.6.1, and the motors 0x01 (leg 0, joint 1) and 0x11 (leg 1, joint 1), whose
# frames of feedback come with ids of their own, 0x101 and 0x111, which add_motor is told:
# - both are taken, and commands reach each by its own id;
# - whatever frame comes is given to the motor that the low four bits of its first byte name, and the id with which it
#   came is kept but not looked at: motor 0x01 reads -0.5 rad, "DISABLED", which is what motor 0x11 said; motor 0x11 has
#   never said anything.
#
# Guess beforehand: feedback_id is what a motor is heard by, or add_motor says that there is one like it already.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "damiao-motor==1.0.6" "python-can==4.6.1" "flask==3.1.2"
cat > legs.py <<'PYTHON'
import sys
import warnings
from importlib.metadata import version

warnings.simplefilter("ignore", DeprecationWarning)
import can
from damiao_motor import DaMiaoController

ENABLED, DISABLED = 1, 0
HIPS = {0x01: (0x101, ENABLED, 0.5), 0x11: (0x111, DISABLED, -0.5)}

robot = can.Bus(channel="legs", interface="virtual")
controller = DaMiaoController(channel="legs", bustype="virtual")
hips = {name: controller.add_motor(name, feedback_id=row[0], motor_type="4340") for name, row in HIPS.items()}
controller._stop_polling()  # frames are taken when this program says so

for name, motor in hips.items():
    motor.send_raw(motor.encode_cmd_msg(0.0, 0.0, 0.0, 20.0, 1.0))
reached = [robot.recv(timeout=1.0).arbitration_id for _ in hips]

for name, (heard_by, status, angle) in HIPS.items():
    steps = round((angle + 12.5) / 25 * 0xFFFF)
    frame = [status << 4 | name & 0xF, steps >> 8, steps & 0xFF, 0x7F, 0xF7, 0xFF, 30, 30]
    robot.send(can.Message(arbitration_id=heard_by, data=frame, is_extended_id=False))
controller.poll_feedback()
states = {name: motor.get_states() for name, motor in hips.items()}

print(f"damiao-motor {version('damiao-motor')}, python-can {version('python-can')}")
print("commands went to", [f"0x{identifier:02x}" for identifier in reached])
for name, (heard_by, status, angle) in HIPS.items():
    state = states[name]
    read = f"{state['pos']:.2f} rad, {state['status']}, from 0x{state['arbitration_id']:x}" if state else "nothing"
    print(f"motor 0x{name:02x} sent {angle:.2f} rad from 0x{heard_by:x}; read of it: {read}")
controller.bus.shutdown()
robot.shutdown()
first = states[0x01]
mixed = abs(first["pos"] + 0.5) < 1e-3 and first["status"] == "DISABLED" and first["arbitration_id"] == 0x111
sys.exit(0 if reached == list(HIPS) and mixed and not states[0x11] else "something is otherwise now")
PYTHON
env/bin/python legs.py
