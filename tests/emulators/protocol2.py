"""DYNAMIXEL Protocol 2.0 as servos speak it: packets, CRC and byte stuffing, written from the
public manual.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

HEADER = b"\xff\xff\xfd"
BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
RESULT_FAIL, BAD_INSTRUCTION, BAD_CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = range(1, 8)
ALERT = 0x80


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16 with the polynomial 0x8005, most significant bit first, from 0."""
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


TABLE = tuple(crc16(bytes([byte])) for byte in range(256))


def crc_of(data: bytes) -> int:
    """CRC by a table, for packets in a loop."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ TABLE[crc >> 8 ^ byte]
    return crc


def _stuffed(payload: bytes) -> bytes:
    """A header inside a packet gets another 0xFD behind it."""
    return payload.replace(HEADER, HEADER + b"\xfd")


def _unstuffed(payload: bytes) -> bytes:
    """The payload without what ``_stuffed`` put in."""
    return payload.replace(HEADER + b"\xfd", HEADER)


def packet(servo: int, instruction: int, parameters: bytes = b"") -> bytes:
    """A whole packet."""
    payload = _stuffed(bytes([instruction]) + parameters)
    body = HEADER + bytes([0, servo]) + (len(payload) + 2).to_bytes(2, "little") + payload
    return body + crc_of(body).to_bytes(2, "little")


def status(servo: int, error: int, parameters: bytes = b"") -> bytes:
    """Status packet with which a servo answers."""
    return packet(servo, STATUS, bytes([error]) + parameters)


def fast_status(parts: list[tuple[int, int, bytes]]) -> bytes:
    """One packet that many servos write one after the other: (id, error, data) each, without
    stuffing.

    Every servo ends its part with the CRC of all that came before it.
    """
    length = 3 + sum(len(data) + 4 for _, _, data in parts) - 2
    answer = HEADER + bytes([0, BROADCAST]) + length.to_bytes(2, "little") + bytes([STATUS])
    for servo, error, data in parts:
        answer += bytes([error, servo]) + data
        answer += crc_of(answer).to_bytes(2, "little")
    return answer


@dataclass(frozen=True)
class Request:
    """Request that came over the wire.

    Arguments:
        sound: its CRC is right.
        size: bytes on the wire.
    """

    servo: int
    instruction: int
    parameters: bytes
    sound: bool
    size: int


class Reader:
    """Cuts what comes in into packets; what is no packet is skipped."""

    def __init__(self) -> None:
        self._bytes = b""

    def feed(self, more: bytes) -> Iterator[Request]:
        """Packets that are whole with these bytes."""
        self._bytes += more
        while True:
            start = self._bytes.find(HEADER)
            if start < 0:
                self._bytes = self._bytes[-2:]
                return
            self._bytes = self._bytes[start:]
            if len(self._bytes) < 7:
                return
            size = 7 + int.from_bytes(self._bytes[5:7], "little")
            if self._bytes[3] != 0 or size > 1024 or size < 10:
                self._bytes = self._bytes[3:]
                continue
            if len(self._bytes) < size:
                return
            whole, payload = self._bytes[:size], self._bytes[7 : size - 2]
            if HEADER in payload.replace(
                HEADER + b"\xfd", b""
            ):  # a header that is not stuffed begins a new packet
                self._bytes = self._bytes[3:]
                continue
            self._bytes = self._bytes[size:]
            plain = _unstuffed(payload)
            sound = crc_of(whole[:-2]) == int.from_bytes(whole[-2:], "little")
            yield Request(whole[4], plain[0], plain[1:], sound, size)
