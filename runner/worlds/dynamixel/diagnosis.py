"""Why a bus does not answer as it should: one line that names port, servo and setting, and says
what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn, get_args

from stancekit.planners.errors import HardwareFault, InvalidInput

from .bus import CORRUPT, PATIENCE, SOUND, ServoBus, listed
from .calibration import Baud

BLAMED = 3
"""So many silent servos are named before the search for more ends: each takes 34 ms."""
LATE_MS = 125.0
"""Latency for which an answer is waited, twice over, when it is asked whether answers are late."""
CALM_S = 0.15
"""So long nothing may come before a servo is asked how long it takes to answer."""
BACK = "no answers came for a while, and now they do: did the adapter, or its cable, hang?"
BABBLE = "bytes come without end, though nobody was asked: is another program, or a faulty servo, on the bus?"


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
        if len(silent) == BLAMED:
            break
    if silent:
        if late(bus, silent[0]) is not None:
            raise HardwareFault(f"port {bus.port}: {BACK}")
        names = ", ".join(bus.label(i) for i in silent)
        many = "maybe more of them; has the bus power?"
        why = (
            f"no answer, {many}"
            if len(silent) == BLAMED
            else "no answer; is it connected and powered?"
        )
        raise HardwareFault(f"{names}: {why}")
    _one_by_one(bus, address, size)
    if bus.peek(address, size) is not None:
        raise HardwareFault(f"port {bus.port}: {BACK}")
    raise HardwareFault(
        f"port {bus.port}: every servo answers alone, and not with the others by Sync Read: is the "
        "Return Delay Time "
        "of one too long, or the bus disturbed?"
    )


def unanswered(bus: ServoBus, silent: Sequence[int]) -> NoReturn:
    """Raise an error that says why these servos, by index, answer no ping before anything was set
    up.

    Where nobody answers, other baud rates are tried. Raises InvalidInput where the calibration file
    is to be changed, HardwareFault else.
    """
    damaged = next((index for index in silent[:BLAMED] if _pinged(bus, index) == CORRUPT), None)
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
    bus.calm(CALM_S)
    number, result, took_s = bus.reach(index, LATE_MS)
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
        if len(deaf) == BLAMED:
            break
    if deaf:
        more = ", maybe more of them" if len(deaf) == BLAMED else ""
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
