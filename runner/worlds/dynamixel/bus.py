"""A bus of X-series servos through ``dynamixel-sdk`` (extra ``dynamixel``), Protocol 2.0; faults name servo and joint.

The SDK's group readers drop the error byte of every answer, so its packet handler is called directly.
"""

from __future__ import annotations

import errno
import os
import termios
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput

from ...safety.latch import StopLatch
from .control_table import HARDWARE_ERROR, LATENCY_MS, Register, hardware_errors

Bytes = NDArray[np.uint8]
ALERT, CORRUPT = 0x80, -3002
PATIENCE = 2
BLAMED = 3
"""So many silent servos are named before the search for more ends: each takes 34 ms."""


class ServoBus:
    """One port and the servos on it, in one order; S servos. Not for use by several threads at once.

    ids, names: of the servos and of their joints. retries: how often a damaged or late answer is asked for again.
    latency_ms: how long beyond its bytes' own time an answer may take. latch: every write passes it, or is refused with
    Stopped, but for reading and for what says that it stops the robot.
    ``retried`` counts damaged and late answers. Raises InvalidInput where the SDK is not installed.
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
    ) -> None:
        try:
            from dynamixel_sdk import PacketHandler
        except ImportError:
            raise InvalidInput(
                "world: expected dynamixel-sdk, it is not installed: pip install 'stancekit[dynamixel]'"
            ) from None
        self.port, self.baud, self.ids, self.names = port, baud, list(ids), list(names)
        self.fast, self.retried = False, 0
        self._retries, self._packets, self._latency_ms = retries, PacketHandler(2.0), latency_ms
        self._latch = StopLatch() if latch is None else latch
        self._handler: Any = None

    def open(self) -> None:
        """Open and lock the port. Raises InvalidInput where it is absent, busy or no serial port."""
        from .port import ServoPort

        handler = ServoPort(self.port)
        handler.latency_ms = self._latency_ms
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
            with self._talking():
                number, result, _ = self._packets.ping(self._handler, self.ids[index])
            if result == 0:
                return int(number)
            self._again()
        return None

    @contextmanager
    def patient(self) -> Iterator[None]:
        """While nothing moves, damaged and late answers are asked for more often."""
        before, self._retries = self._retries, self._retries + PATIENCE
        try:
            yield
        finally:
            self._retries = before

    def write(self, index: int, register: Register, value: int) -> None:
        """One field of one servo, and its consent. Raises HardwareFault, Stopped."""
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
        if error & ~ALERT:
            raise HardwareFault(f"{self.label(index)}: refused {value} for {register.name} (error {error & ~ALERT})")

    def write_all(self, register: Register, values: NDArray[Any] | Sequence[int], *, stopping: bool = False) -> None:
        """One field of all servos at once; nobody answers. Raises HardwareFault where the port is gone, Stopped.

        stopping: it stops the robot, and is sent after a stop, too.
        """
        table = np.asarray(values, dtype=np.int64)
        rows = np.ascontiguousarray(table.astype("<i8")).view(np.uint8).reshape(len(table), 8)[:, : register.size]
        self.write_rows(register.address, rows, stopping=stopping)

    def write_rows(self, address: int, rows: Bytes, *, stopping: bool = False) -> None:
        """The same bytes' place in all servos, shape (S, any), in as many packets as their length asks for."""
        from dynamixel_sdk import GroupSyncWrite

        most = (1024 - 14) // (1 + rows.shape[1])
        for first in range(0, len(rows), most):
            with self._talking(None if stopping else self._latch):
                group = GroupSyncWrite(self._handler, self._packets, address, rows.shape[1])
                for index in range(first, min(first + most, len(rows))):
                    group.addParam(self.ids[index], rows[index].tolist())
                result = group.txPacket()
            if result != 0:
                raise HardwareFault(f"port {self.port}: a packet could not be sent (result {result})")

    def read_all(self, address: int, size: int, *, alerts: bool = True) -> Bytes:
        """The same bytes of all servos, shape (S, size). Raises HardwareFault that names who is silent or in error.

        alerts: whether a servo in error is one; False to read on in spite of it.
        """
        for _ in range(1 + self._retries):
            table, raised = self._read_once(address, size)
            if table is not None:
                if alerts and raised.any():
                    self._raise_alert(raised)
                return table
            self._again()
        return self._blame()

    def reboot(self, index: int) -> None:
        """Start a servo anew, torque off: the only way out of a shutdown."""
        with self._talking(self._latch):
            self._packets.reboot(self._handler, self.ids[index])

    def refuse(self, wrong: NDArray[np.bool_], why: str) -> None:
        """Raise HardwareFault that names the servos where ``wrong``, shape (S,)."""
        found = [self.label(int(index)) for index in np.flatnonzero(wrong)]
        if found:
            raise HardwareFault(f"{listed(found)}: {why}")

    def _read_once(self, address: int, size: int) -> tuple[Bytes | None, NDArray[np.bool_]]:
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
                return parts[:, 2:-2].copy(), (parts[:, 0] & ALERT) > 0
            for index, servo in enumerate(self.ids):
                data, result, error = packets.readRx(handler, servo, size)
                if result != 0 or len(data) != size:
                    return None, alerts
                table[index], alerts[index] = data, bool(error & ALERT)
        return table, alerts

    def _raise_alert(self, alerts: NDArray[np.bool_]) -> None:
        """Say what is wrong with the servos that raised the alert bit."""
        errors = self.read_all(HARDWARE_ERROR.address, 1, alerts=False)[:, 0]
        found = [f"{self.label(i)}: {hardware_errors(int(errors[i]))}" for i in np.flatnonzero(alerts).tolist()]
        raise HardwareFault(f"{listed(found)}; its torque is off until it is rebooted")

    def _again(self) -> None:
        """An answer was damaged or late: whatever is still on its way must not be taken for the next one."""
        self.retried += 1
        with self._talking():
            self._handler.settle()

    def _blame(self) -> NoReturn:
        """Raise HardwareFault that names the servos that answer no ping, not all of them if there are many."""
        silent = list[str]()
        for index in range(len(self.ids)):
            for _ in range(1 + PATIENCE):
                with self._talking():
                    _, result, _ = self._packets.ping(self._handler, self.ids[index])
                    if result != 0:
                        self._handler.settle()
                if result == 0:
                    break
            else:
                if result == CORRUPT:
                    raise HardwareFault(f"port {self.port}: answers come damaged, e.g. that of {self.label(index)}")
                silent.append(self.label(index))
            if len(silent) == BLAMED:
                raise HardwareFault(f"{', '.join(silent)}: no answer, maybe more of them; has the bus power?")
        if silent:
            raise HardwareFault(f"{', '.join(silent)}: no answer; is it connected and powered?")
        raise HardwareFault(f"port {self.port}: answers come damaged or too late")

    @contextmanager
    def _talking(self, latch: StopLatch | None = None) -> Iterator[None]:
        """Whatever a port can raise becomes a HardwareFault; a conversation that was cut off leaves no mark.

        latch: what is written passes it.
        """
        if self._handler is None or not self._handler.is_open:
            raise HardwareFault(f"port {self.port}: not open")
        self._handler.is_using, self._handler.latch = False, latch
        try:
            yield
        except (OSError, termios.error, TypeError) as error:  # TypeError: pyserial on a port closed meanwhile
            raise HardwareFault(f"port {self.port}: {_why(error)}; is the cable in?") from None


def listed(names: Sequence[str]) -> str:
    """The first three of them, and how many more."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def unsigned(rows: Bytes) -> NDArray[np.int64]:
    """Little-endian numbers, one a row."""
    return np.asarray(rows.astype(np.int64) @ (256 ** np.arange(rows.shape[1])), dtype=np.int64)


def signed(rows: Bytes) -> NDArray[np.int64]:
    """Little-endian numbers in two's complement, one a row."""
    values, span = unsigned(rows), 256 ** rows.shape[1]
    return np.where(values >= span // 2, values - span, values)


def _why(error: BaseException) -> str:
    """What the system says, in one line."""
    number = error.errno if isinstance(error, OSError) else error.args[0] if error.args else None
    if number is None and error.__context__ is not None:  # pyserial hides what the terminal said
        return _why(error.__context__)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "expected a free port, somebody else has it open"
    if number == errno.ENOTTY:
        return "expected a serial port, got something else"
    if number == errno.ENOENT:
        return "expected a serial port, found nothing there"
    return os.strerror(number) if isinstance(number, int) and number else str(error)
