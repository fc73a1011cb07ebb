"""Why a bus does not answer as it should: one line that names port, servo and setting, and says
what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, NoReturn, get_args

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput

from .bus import CORRUPT, PATIENCE, SOUND, ServoBus, listed
from .control_table import RAD, RAD_S, Baud

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
        result = _pinged(bus, index)
        if result == CORRUPT:
            raise HardwareFault(
                f"port {bus.port}: answers come damaged, e.g. that of {bus.label(index)}: are "
                "cables, supply and "
                "baud rate right, and no other program on the port?"
            )
        if result != SOUND:
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
    damaged = next((index for index in silent[:_BLAMED] if _pinged(bus, index) == CORRUPT), None)
    if damaged is not None:
        raise HardwareFault(
            f"port {bus.port}: answers come damaged, e.g. that of {bus.label(damaged)}: are "
            "cables, supply and baud "
            "rate right, and no other program on the port?"
        )
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


def _pinged(bus: ServoBus, index: int) -> int:
    """Result of pings of a servo, asked until one is sound."""
    result = CORRUPT
    for _ in range(1 + PATIENCE):
        _, result, _ = bus.reach(index)
        if result == SOUND:
            break
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
        result = _read(bus, index, address, size)
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


def _read(bus: ServoBus, index: int, address: int, size: int) -> int:
    """Result of reads of a servo, asked until one is sound."""
    result = CORRUPT
    for _ in range(1 + PATIENCE):
        result = bus.read_one(index, address, size)
        if result == SOUND:
            break
    return result


def _ids(ids: Sequence[int]) -> str:
    """Ids for a message, e.g. "1 to 24"."""
    whole = list(ids) == list(range(ids[0], ids[0] + len(ids)))
    return f"{ids[0]} to {ids[-1]}" if whole and len(ids) > 1 else listed([str(i) for i in ids])
