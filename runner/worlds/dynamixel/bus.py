"""A bus of X-series servos through ``dynamixel-sdk`` (extra ``machines``), Protocol 2.0; faults
name servo and joint, and say what to do where a bus does not answer as it should.

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
from functools import partial
from typing import Any, NamedTuple, NoReturn, get_args

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput, not_installed

from ...safety.estop import StopLatch
from ..hardware import listed
from .control_table import (
    HARDWARE_ERROR,
    LATENCY_MS,
    RAD,
    RAD_S,
    SHUTDOWN,
    Baud,
    Register,
    hardware_errors,
)

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


_FASTER = 1.5
"""A joint may be pushed so many times as fast as its servo turns without load."""
_SLACK_RAD = 0.06
"""Position that the time between a measurement and its arrival may hide."""
_OLD_S = 0.06
"""A measurement may be older than the last one by so much before it is asked for again."""
_FROZEN = 5
"""A servo that reports speed and the same position for so many periods repeats old values."""
_FROZEN_TICKS = 2.0
_WRAP_MS = 32768
"""Realtime Tick begins anew here."""


class Doubt(NamedTuple):
    """Reason why a measurement cannot be true, empty where it is believed.

    Arguments:
        late: it may be an answer that came late.
    """

    why: str
    late: bool = False


_BELIEVED = Doubt("")


class MeasurementJudge:
    """Judge of consecutive measurements of all servos; S servos.

    Arguments:
        bus: whose servos they are, for messages.
        fastest_rad_s: speed without load, shape (S,).
    """

    def __init__(self, bus: ServoBus, fastest_rad_s: NDArray[np.float64]) -> None:
        self._bus, self._fastest = bus, _FASTER * fastest_rad_s
        self.begin()

    def begin(self) -> None:
        """Forget what was measured: nothing is known of the joints."""
        count = len(self._bus.ids)
        self._last: tuple[float, NDArray[np.int64], NDArray[np.int64]] | None = None
        self._ticking, self._same = np.zeros(count, bool), np.zeros(count, int)

    def clocks(self, before: NDArray[np.int64], after: NDArray[np.int64]) -> str:
        """Find whose Realtime Tick runs, from two readings [ms], shape (S,) each; why a servo is
        doubted, or "".

        Servos none of which has a running clock are not judged by it.
        """
        self._ticking = after != before
        if self._ticking.any() and not self._ticking.all():
            names = [self._bus.label(int(i)) for i in np.flatnonzero(~self._ticking)]
            return f"{names[0]}: its clock (Realtime Tick) stands still, those of others run: are its values old?"
        return ""

    def doubt(
        self,
        now_s: float,
        position: NDArray[np.int64],
        velocity: NDArray[np.int64],
        tick_ms: NDArray[np.int64],
        *,
        calm: bool = False,
    ) -> Doubt:
        """Doubt whether a measurement can be true and is young enough; one that is believed is kept
        to judge the next by.

        Arguments:
            now_s: when it arrived, monotonic. position [ticks], velocity, tick_ms: as the servos
                report them, shape (S,).
            calm: the bus was quiet before it was asked for, so that no late answer can have been
                taken for this one.
        """
        fastest = np.abs(velocity) * RAD_S > 2.0 * self._fastest + 1.0
        for index in np.flatnonzero(fastest):
            speed = velocity[index] * RAD_S
            return Doubt(
                f"{self._name(index)}: measured to turn at {speed:.1f} rad/s, which it cannot"
            )
        if self._last is None:
            self._last = now_s, position, tick_ms
            return _BELIEVED
        then_s, before, ticked = self._last
        passed_s = now_s - then_s
        moved = RAD * np.abs(position - before)
        for index in np.flatnonzero(moved > self._fastest * passed_s + _SLACK_RAD):
            return Doubt(
                f"{self._name(index)}: measured to jump {moved[index]:.2f} rad in "
                f"{1e3 * passed_s:.0f} ms, which it "
                f"cannot turn: do two servos have id {self._bus.ids[index]}, or is it disturbed?"
            )
        went_ms = (tick_ms - ticked) % _WRAP_MS
        for index in np.flatnonzero(self._ticking & ((went_ms == 0) | (went_ms > _WRAP_MS // 2))):
            if passed_s < 1e-3 * (_WRAP_MS // 4):
                what = (
                    "stands still"
                    if went_ms[index] == 0
                    else "went back: is it an old answer, or did it restart"
                )
                return Doubt(
                    f"{self._name(index)}: its values are old: its clock (Realtime Tick) {what}",
                    late=True,
                )
        late_s = passed_s - 1e-3 * went_ms
        for index in np.flatnonzero(self._ticking & (late_s > _OLD_S)):
            if not calm and passed_s < 1e-3 * (_WRAP_MS // 4):
                old = f"its values are {late_s[index]:.2f} s old: do answers come late?"
                return Doubt(f"{self._name(index)}: {old}", late=True)
        turning = np.abs(velocity) * RAD_S * passed_s > _FROZEN_TICKS * RAD
        self._same = np.where(turning & (position == before), self._same + 1, 0)
        for index in np.flatnonzero(self._same > _FROZEN):
            return Doubt(
                f"{self._name(index)}: measured to turn at {velocity[index] * RAD_S:.2f} rad/s and "
                "to stay at "
                f"{position[index]} ticks: are its values old?"
            )
        self._last = now_s, position, tick_ms
        return _BELIEVED

    def _name(self, index: np.intp) -> str:
        return self._bus.label(int(index))


_BLAMED = 3
"""So many silent servos are named before the search for more ends: each takes 34 ms."""
_LATE_MS = 125.0
"""Latency for which an answer is waited, twice over, when it is asked whether answers are late."""
_CALM_S = 0.15
"""So long nothing may come before a servo is asked how long it takes to answer."""
_BACK = "no answers came for a while, and now they do: did the adapter, or its cable, hang?"
BABBLE = "bytes come without end, though no servo was asked: is another program, or a faulty servo, on the bus?"


def blame(bus: ServoBus, address: int, size: int) -> NoReturn:
    """Raise HardwareFault that says why a reading of all servos came to nothing.

    Arguments:
        address, size: bytes that were read of every servo.
    """
    if not bus.calm(2e-3 * bus.latency_ms):
        raise HardwareFault(f"port {bus.port}: {BABBLE}")
    silent = list[int]()
    for index in range(len(bus.ids)):
        if _pinged(bus, index) != SOUND:
            silent.append(index)
        if len(silent) == _BLAMED:
            break
    if silent:
        if late(bus, silent[0]) is not None:
            raise HardwareFault(f"port {bus.port}: {_BACK}")
        names = ", ".join(bus.label(i) for i in silent)
        many = "maybe more of them; has the bus power?"
        why = (
            f"no answer, {many}"
            if len(silent) == _BLAMED
            else "no answer; is it connected and powered?"
        )
        raise HardwareFault(f"{names}: {why}")
    _one_by_one(bus, address, size)
    if bus.peek(address, size) is not None:
        raise HardwareFault(f"port {bus.port}: {_BACK}")
    raise HardwareFault(
        f"port {bus.port}: every servo answers alone, and not with the others by Sync Read: is the "
        "Return Delay Time "
        "of one too long, or the bus disturbed?"
    )


def unanswered(bus: ServoBus, silent: Sequence[int]) -> NoReturn:
    """Raise an error that says why these servos, by index, answer no ping before anything was set
    up.

    Without any answer, other baud rates are tried. Raises InvalidInput where the calibration file
    is to be changed, HardwareFault else.
    """
    for index in silent[:_BLAMED]:
        _pinged(bus, index)
    if len(silent) < len(bus.ids):
        raise HardwareFault(
            f"port {bus.port}: no answer from {listed([bus.label(i) for i in silent])}: is it "
            "connected and powered, "
            "and its id right?"
        )
    others = bus.ids_at(bus.baud)
    if others:
        raise InvalidInput(
            f"port {bus.port}: expected servos with the ids of the calibration file, "
            f"{_ids(bus.ids)}, found "
            f"{_ids(others)} at {bus.baud} baud"
        )
    for baud in get_args(Baud):
        if baud != bus.baud and (answering := bus.ids_at(baud)):
            raise InvalidInput(
                f"port {bus.port}: expected servos at {bus.baud} baud, found {_ids(answering)} at "
                f"{baud}: set baud to "
                f"{baud} in the calibration file, or the servos' Baud Rate to {bus.baud}"
            )
    raise HardwareFault(
        f"port {bus.port}: no answer from {listed([bus.label(i) for i in silent])}, at any baud "
        "rate: has the bus "
        "power, and is it this port?"
    )


def _asked(once: Callable[[], int]) -> int:
    """Result of asking a servo until it answers soundly, or patience ends."""
    result = CORRUPT
    for _ in range(1 + PATIENCE):
        if (result := once()) == SOUND:
            break
    return result


def _pinged(bus: ServoBus, index: int) -> int:
    """Result of pings of a servo; raises HardwareFault where answers come damaged."""
    if (result := _asked(lambda: bus.reach(index)[1])) == CORRUPT:
        raise HardwareFault(
            f"port {bus.port}: answers come damaged, e.g. that of {bus.label(index)}: are "
            "cables, supply and baud rate right, and no other program on the port?"
        )
    return result


def late(bus: ServoBus, index: int) -> int | None:
    """Model number of a servo that was silent and answers in time now; None where it does not.

    To be asked before many more pings wait for their answers. Raises HardwareFault where it answers
    later than the port waits.
    """
    bus.calm(_CALM_S)
    number, result, took_s = bus.reach(index, _LATE_MS)
    took_ms, allowed_ms = 1e3 * took_s, 2.0 * bus.latency_ms
    if result == SOUND and took_ms > allowed_ms:
        raise HardwareFault(
            f"port {bus.port}: {bus.label(index)} answers after {took_ms:.0f} ms, latency_ms "
            f"{bus.latency_ms:g} allows "
            f"{allowed_ms:.0f}: set the adapter's latency timer to 1 ms, or latency_ms to "
            f"{took_ms / 2.0 + 10.0:.0f}"
        )
    return number if result == SOUND else None


def _one_by_one(bus: ServoBus, address: int, size: int) -> None:
    """Raise HardwareFault where servos that answer pings answer no reads, or damaged."""
    deaf, damaged = list[int](), list[int]()
    for index in range(len(bus.ids)):
        result = _asked(partial(bus.read_one, index, address, size))
        if result != SOUND:
            (damaged if result == CORRUPT else deaf).append(index)
        if len(deaf) == _BLAMED:
            break
    if deaf:
        more = ", maybe more of them" if len(deaf) == _BLAMED else ""
        raise HardwareFault(
            f"{listed([bus.label(i) for i in deaf])}{more}: answers pings, but no reads: "
            "set its Status Return Level to 2 with the maker's tool"
        )
    if damaged:
        raise HardwareFault(
            f"{listed([bus.label(i) for i in damaged])}: its answers come damaged, but for pings: "
            "do two servos have "
            f"id {bus.ids[damaged[0]]}?"
        )


def _ids(ids: Sequence[int]) -> str:
    """Ids for a message, e.g. "1 to 24"."""
    whole = list(ids) == list(range(ids[0], ids[0] + len(ids)))
    return f"{ids[0]} to {ids[-1]}" if whole and len(ids) > 1 else listed([str(i) for i in ids])
