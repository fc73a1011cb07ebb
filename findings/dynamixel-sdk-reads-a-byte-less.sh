#!/bin/sh
# dynamixel-sdk's Protocol 2.0 on an answer of six bytes, FF FF FD FF FD FD, which a servo sends with one FD
# more behind the first three, as the protocol wants ("byte stuffing"), and a CRC that is right.
#
# Seen with dynamixel-sdk 4.1.0: readRx reports success and no error, and gives FF FF FD FF FD and then a
# byte of the CRC in place of the last FD. Of FF FF FD FF 01 02, which is stuffed at the same place, all
# bytes come out right.
#
# Guess beforehand: what was stuffed comes out as it was, and a packet whose CRC is right is given whole or
# not at all.
# What seems to happen: removeStuffing looks for the pattern in the list that it writes into: bytes that it
# has moved by one look like the pattern again, and another FD is taken out.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "dynamixel-sdk==4.1.0"
cat > read.py <<'PYTHON'
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


def answered(data):
    handler = PacketHandler(2.0)
    body = bytes([0x55, 0]) + data.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = b"\xff\xff\xfd\0\7" + (len(body) + 2).to_bytes(2, "little") + body
    crc = handler.updateCRC(0, list(head), len(head)).to_bytes(2, "little")
    found, result, error = handler.readRx(port(head + crc), 7, len(data))
    return bytes(found), (result, error)


print(f"dynamixel-sdk {version('dynamixel-sdk')}")
seen = True
for text, right in (("fffffdff0102", True), ("fffffdfffdfd", False)):
    data = bytes.fromhex(text)
    found, result = answered(data)
    print(f"sent {data.hex(' ')}: read {found.hex(' ')}, result and error {result}")
    seen &= result == (COMM_SUCCESS, 0) and (found == data) is right and found[:5] == data[:5]
sys.exit(not seen)
PYTHON
env/bin/python read.py
