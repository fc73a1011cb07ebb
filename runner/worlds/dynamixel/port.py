"""The serial port of ``dynamixel-sdk``, for one owner, on a clock that nobody sets. Imported where a bus is opened."""

from __future__ import annotations

import fcntl
import os
import time

from dynamixel_sdk import PortHandler

from ...safety.latch import StopLatch
from .control_table import LATENCY_MS

WAIT_S = 0.002
"""How long a read sleeps for bytes before the SDK looks at its own time limit."""
WRITE_S = 0.1
"""How long a packet may take to be handed to the kernel."""


class ServoPort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """As the SDK's, but locked, waiting in the kernel instead of spinning, and timed by the monotonic clock.

    ``latency_ms``: how long beyond the bytes' own time an answer may take. ``latch``: what is written passes it, or is
    refused with Stopped; None for what moves nothing.
    """

    latency_ms = LATENCY_MS
    latch: StopLatch | None = None

    def setupPort(self, cflag_baud: int) -> bool:
        """Open and lock. Raises OSError, BlockingIOError where somebody else has the port."""
        probe = os.open(self.port_name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(probe, fcntl.LOCK_EX | fcntl.LOCK_NB)  # before anything disturbs who has it
        finally:
            os.close(probe)
        super().setupPort(cflag_baud)
        self.ser.exclusive = True
        self.ser.timeout, self.ser.write_timeout = WAIT_S, WRITE_S
        return True

    def writePort(self, packet: list[int]) -> int:
        """Hand a packet to the kernel: the last moment at which it can be kept back."""
        if self.latch is None:
            return int(super().writePort(packet))
        with self.latch.sending():
            return int(super().writePort(packet))

    def getCurrentTime(self) -> float:
        """Milliseconds; the SDK takes the wall clock, which jumps."""
        return 1e3 * time.monotonic()

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start waiting for an answer of so many bytes."""
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = self.tx_time_per_byte * packet_length + 2.0 * self.latency_ms + 2.0

    def settle(self) -> None:
        """Wait until nothing comes any more: a late answer must not be taken for the next one."""
        quiet_ms, since = self.latency_ms, self.getCurrentTime()
        while self.getCurrentTime() - since < quiet_ms:
            if self.readPort(1024):
                since = self.getCurrentTime()
