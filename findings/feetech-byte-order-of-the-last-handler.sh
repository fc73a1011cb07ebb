#!/bin/sh
# feetech-servo-sdk: a robot whose legs are STS servos, which send the low byte first, and whose neck is an SCS
# servo, which sends the high byte first.
#
# Seen with feetech-servo-sdk 1.0.0: PacketHandler(0) and PacketHandler(1) are two handlers with one byte order,
# which is that of whichever was made last. A leg's position of 2048 (upright) reads 8 once the neck's handler is
# made, with success and no error; and what is sent to the leg is turned around as well. Made anew, PacketHandler(0)
# turns the neck's.
#
# Guess beforehand: a handler keeps the order that it was made with.
# What seems to happen: the order is a global of the module scservo_def, which PacketHandler sets.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "feetech-servo-sdk==1.0.0" "pyserial==3.5"
cat > order.py <<'PYTHON'
import io
import sys
from importlib.metadata import version
from types import SimpleNamespace

from scservo_sdk import COMM_SUCCESS, PacketHandler

UPRIGHT = 2048


def port(come=b""):
    """A port that keeps what is sent, and has these bytes."""
    wire = SimpleNamespace(is_using=False, sent=[], readPort=io.BytesIO(come).read)
    wire.clearPort = lambda: None
    wire.setPacketTimeout = lambda _: None
    wire.isPacketTimeout = lambda: True
    wire.writePort = lambda packet: wire.sent.extend(packet) or len(packet)
    return wire


def read(handler):
    """Position that the leg's servo 7 reports, low byte first."""
    body = bytes([7, 4, 0]) + UPRIGHT.to_bytes(2, "little")
    packet = b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
    position, result, error = handler.read2ByteRx(port(packet), 7)
    if (result, error) != (COMM_SUCCESS, 0):
        sys.exit("a whole packet is not read")
    return position


def sent(handler):
    """Position of the goal that leaves for the leg's servo, low byte first."""
    wire = port()
    handler.write2ByteTxOnly(wire, 7, 42, UPRIGHT)
    return int.from_bytes(bytes(wire.sent[6:8]), "little")


legs = PacketHandler(0)
alone = read(legs), sent(legs)
neck = PacketHandler(1)
beside = read(legs), sent(legs)
legs_again = PacketHandler(0)
last = read(neck), sent(neck)
print(f"feetech-servo-sdk {version('feetech-servo-sdk')}: a leg at {UPRIGHT}, read and sent")
print("alone", alone, "once the neck's handler is made", beside, "by the neck's, at last", last)
right = alone == last == (UPRIGHT, UPRIGHT) and beside == (8, 8)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python order.py
