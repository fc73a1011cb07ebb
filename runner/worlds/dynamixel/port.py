"""The serial port of ``dynamixel-sdk``, for one owner, on a clock that cannot be set. Imported
where a bus is opened.
"""

from __future__ import annotations

import fcntl
import os
import time

from dynamixel_sdk import PortHandler, Protocol2PacketHandler

from ...safety.estop import StopLatch
from .control_table import LATENCY_MS

_WAIT_S = 0.002
"""Time that a read sleeps for bytes before the SDK looks at its own time limit."""
WRITE_S = 0.1
"""Time that a packet may take to be handed to the kernel."""
_FLOOD_BYTES = 2048
"""So many bytes more than an answer has are no answer: somebody sends without end."""
_RESTLESS = 8
"""So many times as long as a bus has to be quiet, it may take to become so."""


_HEADER = b"\xff\xff\xfd"


class ServoPackets(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """Packets of Protocol 2.0. Those of the SDK 4.1.0 that hold a header in their parameters leave
    as they are, without the byte that has to follow it, and come in with a byte lost.
    """

    def addStuffing(self, packet: list[int]) -> list[int]:
        """Put 0xFD behind every header inside a packet, in place."""
        return self._replaced(packet, _HEADER, _HEADER + b"\xfd")

    def removeStuffing(self, packet: list[int]) -> list[int]:
        """Take it out again, in place."""
        return self._replaced(packet, _HEADER + b"\xfd", _HEADER)

    def _replaced(self, packet: list[int], old: bytes, new: bytes) -> list[int]:
        packet[7:-2] = bytes(packet[7:-2]).replace(old, new)
        packet[5:7] = (len(packet) - 7).to_bytes(2, "little")
        return packet


class ServoPort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """A port as the SDK's, but locked, waiting in the kernel instead of spinning, and timed by the
    monotonic clock.

    latency_ms: how long beyond the bytes' own time an answer may take.

    Arguments:
        latch: gate of every write, refused with Stopped after a stop; None for what moves nothing.
            echo: whether the adapter sends back what it is sent, which is swallowed.
    """

    latency_ms = LATENCY_MS
    latch: StopLatch | None = None
    echo = False
    _expected = _come = 0

    def setupPort(self, cflag_baud: int) -> bool:
        """Open and lock.

        Raises OSError, BlockingIOError where another process has it.
        """
        if self.is_open:  # another baud rate of a port that is ours
            self.closePort()
        probe = os.open(self.port_name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(probe, fcntl.LOCK_EX | fcntl.LOCK_NB)  # before anything disturbs who has it
        finally:
            os.close(probe)
        super().setupPort(cflag_baud)
        self.ser.exclusive = True
        self.ser.timeout, self.ser.write_timeout = _WAIT_S, WRITE_S
        return True

    def writePort(self, packet: list[int]) -> int:
        """Hand a packet to the kernel: the last moment at which it can be kept back."""
        if self.latch is None:
            written = int(super().writePort(packet))
        else:
            with self.latch.sending():
                written = int(super().writePort(packet))
        if self.echo:
            self.setPacketTimeout(len(packet))
            left = len(packet)
            while left > 0 and not self.isPacketTimeout():
                left -= len(self.readPort(left))
        return written

    def readPort(self, length: int) -> bytes:
        """Bytes that have come, up to so many; none of a flood, from which the SDK would read for
        ever.
        """
        if self._come > self._expected + _FLOOD_BYTES:
            return b""
        data = bytes(super().readPort(length))
        self._come += len(data)
        return data

    def getCurrentTime(self) -> float:
        """Milliseconds; the SDK takes the wall clock, which jumps."""
        return 1e3 * time.monotonic()

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start waiting for an answer of so many bytes."""
        self.setPacketTimeoutMillis(
            self.tx_time_per_byte * packet_length + 2.0 * self.latency_ms + 2.0
        )
        self._expected = packet_length

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for so long."""
        self.packet_start_time, self.packet_timeout = self.getCurrentTime(), msec
        self._expected = self._come = 0

    def isPacketTimeout(self) -> bool:
        """Tell whether the answer is late; one that has come while this process slept is not."""
        if self.getTimeSinceStart() <= self.packet_timeout:
            return False
        return self._come > self._expected + _FLOOD_BYTES or not self.ser.in_waiting

    def settle(self, quiet_ms: float | None = None) -> bool:
        """Wait until nothing has come for so long, or ``latency_ms``: a late answer must not be
        taken for the next.

        Returns whether the bus became quiet.
        """
        quiet_ms = self.latency_ms if quiet_ms is None else quiet_ms
        began = since = self.getCurrentTime()
        self._come = 0
        while (now := self.getCurrentTime()) - since < quiet_ms:
            if now - began > _RESTLESS * quiet_ms:
                return False
            if super().readPort(1024):
                since = self.getCurrentTime()
        return True
