"""A bus of X-series servos through ``dynamixel-sdk`` (extra ``machines``), Protocol 2.0; faults
name servo and joint.

The SDK's group readers drop the error byte of every answer, so its packet handler is called
directly.
"""

from __future__ import annotations

import errno
import logging
import os
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput, not_installed

from ...safety.estop import StopLatch
from .control_table import HARDWARE_ERROR, LATENCY_MS, SHUTDOWN, Register, hardware_errors

_Bytes = NDArray[np.uint8]
_ALERT = 0x80
SOUND, _SILENT, CORRUPT = 0, -3001, -3002
"""Results of the SDK: an answer that is whole, none at all, and one that is damaged."""
PATIENCE = 2
_Blame = Callable[["ServoBus", int, int], NoReturn]
"""A diagnosis that raises HardwareFault: what to do when bytes (address, size) of all servos did
not come."""
log = logging.getLogger(__name__)


class ServoBus:
    """One port and the servos on it, in one order; S servos.

    Not for use by several threads at once.

    Arguments:
        ids, names: of the servos and of their joints.
        retries: how often a damaged or late answer is asked for again.
        latency_ms: how long beyond its bytes' own time an answer may take.
        latch: every write passes it, or is refused with Stopped, but for reading and for what says
            that it stops the robot.
        blame: raises HardwareFault with the servo and the setting that are the reason where servos
            do not answer. ``retried`` counts damaged and late answers; ``fast``: all servos are
            read by Fast Sync Read.

    Raises:
        InvalidInput: where the SDK is not installed.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        ids: Sequence[int],
        names: Sequence[str],
        *,
        retries: int = 2,
        latency_ms: float = LATENCY_MS,
        latch: StopLatch | None = None,
        blame: _Blame | None = None,
    ) -> None:
        try:
            from .port import ServoPackets
        except ImportError:
            raise not_installed("world", "dynamixel-sdk", "a bus of servos", "machines") from None
        self.port, self.baud, self.ids, self.names = port, baud, list(ids), list(names)
        self.fast, self.retried = False, 0
        self._retries, self._packets, self.latency_ms = retries, ServoPackets(), latency_ms
        self._latch = StopLatch() if latch is None else latch
        self._blame = blame
        self._handler: Any = None

    def open(self) -> None:
        """Open and lock the port.

        Raises InvalidInput where it is absent, busy or no serial port.
        """
        from .port import ServoPort

        handler = ServoPort(self.port)
        handler.latency_ms = self.latency_ms
        try:
            handler.setBaudRate(self.baud)
        except (OSError, termios.error) as error:
            if handler.is_open:
                handler.closePort()
            raise InvalidInput(f"port {self.port}: {_why(error)}") from None
        self._handler = handler

    def close(self) -> None:
        """Give the port back; what the servos do is theirs."""
        if self._handler is not None and self._handler.is_open:
            self._handler.closePort()

    def label(self, index: int) -> str:
        """A servo as messages call it."""
        return f"servo {self.ids[index]} ({self.names[index]})"

    def ping(self, index: int) -> int | None:
        """The model number of a servo; None where it is silent."""
        for _ in range(2):
            number, result, _ = self.reach(index)
            if result == SOUND:
                return number
            self.retried += 1
        return None

    def reach(self, index: int, latency_ms: float | None = None) -> tuple[int, int, float]:
        """Ping a servo once: its model number, the SDK's result, and how long that took [s].

        Arguments:
            latency_ms: in place of the port's, for an answer that may be late. The bus is quiet
                afterwards.
        """
        with self._talking():
            before, began = self._handler.latency_ms, time.monotonic()
            self._handler.latency_ms = before if latency_ms is None else latency_ms
            try:
                number, result, _ = self._packets.ping(self._handler, self.ids[index])
                took_s = time.monotonic() - began
                if result != SOUND:
                    self._handler.settle()
            finally:
                self._handler.latency_ms = before
        return int(number), int(result), took_s

    def read_one(self, index: int, address: int, size: int) -> int:
        """Read bytes of one servo once: the SDK's result."""
        with self._talking():
            data, result, _ = self._packets.readTxRx(self._handler, self.ids[index], address, size)
            if result != SOUND:
                self._handler.settle()
        return CORRUPT if result == SOUND and len(data) != size else int(result)

    def ids_at(self, baud: int) -> list[int]:
        """Ids of all servos that answer at this baud rate, at which the port stays."""
        with self._talking():
            try:
                self._handler.setBaudRate(baud)
            except (ValueError, termios.error):  # a baud rate that the adapter does not have
                return []
            ids, _ = self._packets.broadcastPing(self._handler)
            self._handler.settle()
        return sorted(map(int, ids))

    def listen(self) -> bool:
        """Tell whether the bus is quiet; an adapter that echoes what it is sent is noticed."""
        ping = bytes(self._packet_of_ping())
        with self._talking():
            handler = self._handler
            handler.echo = False
            if not handler.settle():
                return False
            handler.writePort(list(ping))
            handler.setPacketTimeout(2 * len(ping))
            came = bytearray()
            while len(came) < len(ping) and not handler.isPacketTimeout():
                came += handler.readPort(len(ping) - len(came))
            handler.echo = bytes(came) == ping
            return bool(handler.settle())

    def calm(self, quiet_s: float) -> bool:
        """Wait until nothing has come for so long; whether the bus became quiet."""
        with self._talking():
            return bool(self._handler.settle(1e3 * quiet_s))

    @contextmanager
    def patient(self) -> Iterator[None]:
        """While nothing moves, damaged and late answers are asked for more often."""
        before, self._retries = self._retries, self._retries + PATIENCE
        try:
            yield
        finally:
            self._retries = before

    def write(self, index: int, register: Register, value: int) -> None:
        """One field of one servo, and its consent.

        Raises HardwareFault, Stopped.
        """
        data = list((value & ((1 << 8 * register.size) - 1)).to_bytes(register.size, "little"))
        for _ in range(1 + self._retries):
            with self._talking(self._latch):
                result, error = self._packets.writeTxRx(
                    self._handler, self.ids[index], register.address, register.size, data
                )
            if result == 0:
                break
            self._again()
        else:
            raise HardwareFault(f"{self.label(index)}: no answer to a write of {register.name}")
        if error & ~_ALERT:
            raise HardwareFault(
                f"{self.label(index)}: refused {value} for {register.name} (error {error & ~_ALERT})"
            )

    def write_all(
        self, register: Register, values: NDArray[Any] | Sequence[int], *, stopping: bool = False
    ) -> None:
        """Write one field of all servos at once, without answers.

        Raises HardwareFault where the port is gone, Stopped.

        Arguments:
            stopping: it stops the robot, and is sent after a stop, too.
        """
        table = np.asarray(values, dtype=np.int64)
        rows = (
            np.ascontiguousarray(table.astype("<i8"))
            .view(np.uint8)
            .reshape(len(table), 8)[:, : register.size]
        )
        self.write_rows(register.address, rows, stopping=stopping)

    def write_rows(self, address: int, rows: _Bytes, *, stopping: bool = False) -> None:
        """Write rows to one address of all servos, shape (S, any), in as many packets as their
        length asks for.
        """
        from dynamixel_sdk import GroupSyncWrite

        most = (1024 - 14) // (1 + rows.shape[1])
        for first in range(0, len(rows), most):
            with self._talking(None if stopping else self._latch):
                group = GroupSyncWrite(self._handler, self._packets, address, rows.shape[1])
                for index in range(first, min(first + most, len(rows))):
                    group.addParam(self.ids[index], rows[index].tolist())
                result = group.txPacket()
            if result != 0:
                raise HardwareFault(
                    f"port {self.port}: a packet could not be sent (result {result})"
                )

    def read_all(self, address: int, size: int, *, alerts: bool = True) -> _Bytes:
        """Read one address of all servos, shape (S, size).

        Raises HardwareFault that names who is silent or in error.

        Arguments:
            alerts: whether a servo in error is one; False to read on in spite of it.
        """
        table, raised = self._read_some(address, size, 1 + self._retries)
        if table is None and self.fast:
            self.fast = False
            table, raised = self._read_some(address, size, 1 + self._retries)
            if table is not None:
                log.warning(
                    "port %s: Fast Sync Read is not answered; Sync Read is used instead", self.port
                )
        if table is None:
            if self._blame is not None:
                self._blame(self, address, size)
            raise HardwareFault(f"port {self.port}: servos do not answer, or not as they should")
        if alerts and raised.any():
            self._raise_alert(raised)
        return table

    def peek(self, address: int, size: int) -> _Bytes | None:
        """Read as ``read_all`` does, but with two attempts at most; None if an answer is missing or
        damaged.
        """
        return self._read_some(address, size, 2)[0]

    def refuse(self, wrong: NDArray[np.bool_], why: str) -> None:
        """Raise HardwareFault that names the servos where ``wrong``, shape (S,)."""
        names = [self.label(int(index)) for index in np.flatnonzero(wrong)]
        if names:
            raise HardwareFault(f"{listed(names)}: {why}")

    def _read_some(
        self, address: int, size: int, times: int
    ) -> tuple[_Bytes | None, NDArray[np.bool_]]:
        """Read as ``_read_once`` does, with a limited number of attempts."""
        for _ in range(times):
            table, raised = self._read_once(address, size)
            if table is not None:
                break
            self._again()
        return table, raised

    def _read_once(self, address: int, size: int) -> tuple[_Bytes | None, NDArray[np.bool_]]:
        """The bytes, None where an answer is missing or damaged; and who raised the alert bit."""
        count, handler, packets = len(self.ids), self._handler, self._packets
        table, alerts = np.zeros((count, size), np.uint8), np.zeros(count, bool)
        with self._talking():
            if packets.syncReadTx(handler, address, size, self.ids, count, self.fast) != 0:
                return None, alerts
            if self.fast:
                data, result, _ = packets.fastSyncReadRx(handler, 0xFE, (size + 4) * count)
                if result != 0 or len(data) != (size + 4) * count:
                    return None, alerts
                parts = np.array(data, np.uint8).reshape(count, size + 4)  # error, id, data, CRC
                if parts[:, 1].tolist() != self.ids:
                    return None, alerts
                return parts[:, 2:-2].copy(), (parts[:, 0] & _ALERT) > 0
            for index, servo in enumerate(self.ids):
                data, result, error = packets.readRx(handler, servo, size)
                if result != 0 or len(data) != size:
                    return None, alerts
                table[index], alerts[index] = data, bool(error & _ALERT)
        return table, alerts

    def _raise_alert(self, alerts: NDArray[np.bool_]) -> None:
        """Say what is wrong with the servos that raised the alert bit, and what to do."""
        errors = self.read_all(HARDWARE_ERROR.address, 1, alerts=False)[:, 0]
        off = errors & self.read_all(SHUTDOWN.address, 1, alerts=False)[:, 0]
        hit = np.flatnonzero(alerts).tolist()
        result = [f"{self.label(i)}: {hardware_errors(int(errors[i]))}" for i in hit]
        shut = off[hit].any()
        what = "off until it is rebooted" if shut else "still on: see to that, then reboot it"
        raise HardwareFault(f"{listed(result)}; its torque is {what}")

    def _again(self) -> None:
        """An answer was damaged or late: whatever is still on its way must not be taken for the
        next one.
        """
        self.retried += 1
        with self._talking():
            self._handler.settle()

    def _packet_of_ping(self) -> list[int]:
        """An instruction packet that asks the first servo who it is."""
        head = [0xFF, 0xFF, 0xFD, 0x00, self.ids[0], 3, 0, 1]
        crc = self._packets.updateCRC(0, head, len(head))
        return [*head, crc & 0xFF, crc >> 8]

    @contextmanager
    def _talking(self, latch: StopLatch | None = None) -> Iterator[None]:
        """Whatever a port can raise becomes a HardwareFault; a conversation that was cut off leaves
        no mark.

        Arguments:
            latch: what is written passes it.
        """
        if self._handler is None or not self._handler.is_open:
            raise HardwareFault(f"port {self.port}: not open")
        self._handler.is_using, self._handler.latch = False, latch
        try:
            yield
        except (
            OSError,
            termios.error,
            TypeError,
        ) as error:  # TypeError: pyserial on a port closed meanwhile
            raise HardwareFault(f"port {self.port}: {_why(error)}; is the cable in?") from None


def listed(names: Sequence[str]) -> str:
    """The first three of them, and how many more."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def unsigned(rows: _Bytes) -> NDArray[np.int64]:
    """Little-endian numbers, one a row."""
    return np.asarray(rows.astype(np.int64) @ (256 ** np.arange(rows.shape[1])), dtype=np.int64)


def signed(rows: _Bytes) -> NDArray[np.int64]:
    """Little-endian numbers in two's complement, one a row."""
    values, span = unsigned(rows), 256 ** rows.shape[1]
    return np.where(values >= span // 2, values - span, values)


def _why(error: BaseException) -> str:
    """Message of the system, in one line."""
    number = error.errno if isinstance(error, OSError) else error.args[0] if error.args else None
    if number is None and error.__context__ is not None:  # pyserial hides what the terminal said
        return _why(error.__context__)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "expected a free port, another program has it open"
    if "multiple access" in str(
        error
    ):  # pyserial read nothing where there should have been something
        return "the device is gone, or another program reads the port, too"
    if number == errno.ENOTTY:
        return "expected a serial port, got something else"
    if number == errno.ENOENT:
        return "expected a serial port, found nothing there"
    return os.strerror(number) if isinstance(number, int) and number else str(error)
