#!/bin/sh
# dynamixel-sdk's Protocol 2.0 on a goal of -131073 steps, whose bytes FF FF FD FF begin as a packet does.
# The protocol wants another FD behind such bytes ("byte stuffing").
#
# Seen with dynamixel-sdk 4.1.0: writeTxOnly reports success, and what is sent is
# FF FF FD 00 07 09 00 03 74 00 FF FF FD FF and a CRC: the length says 9, nothing is stuffed. A servo takes
# the inner FF FF FD for the beginning of another packet, and the goal is lost.
#
# Guess beforehand: txPacket stuffs, as its comment "byte stuffing for header" says, so that every goal can
# be sent.
# What seems to happen: addStuffing works the stuffed packet out in a list of its own and returns it, and
# txPacket goes on with the one that it had.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "dynamixel-sdk==4.1.0"
cat > send.py <<'PYTHON'
import io
import sys
from importlib.metadata import version
from types import SimpleNamespace

from dynamixel_sdk import COMM_SUCCESS, PacketHandler


def port(come=b""):
    """A port that keeps what is sent, and has these bytes."""
    wire = SimpleNamespace(is_using=False, sent=[], readPort=io.BytesIO(come).read)
    wire.clearPort = lambda: None
    wire.setPacketTimeout = lambda _: None
    wire.isPacketTimeout = lambda: True
    wire.writePort = lambda packet: wire.sent.extend(packet) or len(packet)
    return wire


wire, goal = port(), list((-131073).to_bytes(4, "little", signed=True))
result = PacketHandler(2.0).writeTxOnly(wire, 7, 116, 4, goal)
sent = bytes(wire.sent)
print(f"dynamixel-sdk {version('dynamixel-sdk')}: result {result}, sent {sent.hex(' ')}")
print(f"length {int.from_bytes(sent[5:7], 'little')}, stuffed: {bytes.fromhex('fffffdfd') in sent}")
sys.exit(
    result != COMM_SUCCESS
    or sent[:14] != bytes.fromhex("fffffd00070900037400") + bytes(goal)
    or len(sent) != 16
)
PYTHON
env/bin/python send.py
