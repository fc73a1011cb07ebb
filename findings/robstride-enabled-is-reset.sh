#!/bin/sh
# Two packages read one status frame of a RobStride motor, the kind that hobby humanoids and quadrupeds are built of.
#
# Seen with robstride 0.1.0 and robstride-dynamics 0.0.1, and a frame whose bits 22 and 23 say 2, "run":
# - robstride says MotorMode.Reset: a motor that holds its torque reads as one that is off. Its mask has bit 22 alone,
#   so that its MotorMode.Run is never said;
# - the frame's torque of half its range is 60 Nm to robstride for every model but 1, and 30 Nm to
#   robstride-dynamics for an "rs-03", whose range is 60 Nm; its velocity is 7.5 and 25 rad/s.
#
# Guess beforehand: who is asked for the mode says which of the three that it names; and motor_model=3 is an RS03.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "robstride==0.1.0" "robstride-dynamics==0.0.1" \
  "python-can==4.6.1" "numpy==2.4.6" "tqdm==4.67.1"
cat > frame.py <<'PYTHON'
import sys
from importlib.metadata import version

import can
from robstride import Client
from robstride.client import MotorMode
from robstride_dynamics import Motor, RobstrideBus

HOST, MOTOR, STATUS, RUN = 0xAA, 7, 2, 2
HALF = (0x8000 + 0x4000).to_bytes(2, "big")  # halfway from 0 to the upper end of a range


class Wire:
    """A bus on which the motor answers whatever is sent by one status frame."""

    def send(self, message):
        pass

    def recv(self, timeout=None):
        identifier = STATUS << 24 | RUN << 22 | MOTOR << 8 | HOST
        data = HALF * 3 + (250).to_bytes(2, "big")
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=True)

    def shutdown(self):
        pass


first = Client(Wire(), host_can_id=HOST).enable(MOTOR, motor_model=3)
bus = RobstrideBus("none", {"knee": Motor(MOTOR, "rs-03")}, {"knee": {"direction": 1, "homing_offset": 0}})
bus.channel_handler = Wire()
position, velocity, torque, warmth = bus.read_operation_frame("knee")
bus.channel_handler = None
print(f"robstride {version('robstride')}, robstride-dynamics {version('robstride-dynamics')}")
print(f"mode {RUN} of the frame: {first.mode}")
print(f"robstride, model 3:        {first.velocity:6.2f} rad/s {first.torque:6.2f} Nm {first.temp:.0f} degrees")
print(f"robstride-dynamics, rs-03: {velocity:6.2f} rad/s {torque:6.2f} Nm {warmth:.0f} degrees")
same = abs(first.angle - position) < 1e-2 and first.temp == warmth == 25.0 and not first.errors
odd = first.mode is MotorMode.Reset and MotorMode.Run.value == RUN
twice = abs(first.torque / torque - 2) < 1e-2 and abs(velocity / first.velocity - 50 / 15) < 1e-2
sys.exit(0 if same and odd and twice else "something is otherwise now")
PYTHON
env/bin/python frame.py
