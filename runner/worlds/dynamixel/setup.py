"""Servos as the driver relies on them: checked before anything is sent, and set up while their
torque is off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput

from . import control_table as table
from .bus import ServoBus, listed, unsigned
from .diagnosis import BABBLE, late, unanswered

ROUNDS = 3
"""Number of times that a setting that did not arrive is written."""


def check_servos(bus: ServoBus, model: table.ServoModel) -> None:
    """All are there, of this model, with a bus watchdog; the bus reads fast if all can.

    Servos are told to answer reads and writes (Status Return Level 2), before anything is read.
    Raises HardwareFault for silent servos and a bus that cannot be talked to, InvalidInput for
    other models and old firmware.
    """
    if not bus.listen():
        raise HardwareFault(f"port {bus.port}: {BABBLE}")
    count = len(bus.ids)
    numbers = list[int | None]()
    for index in range(count):
        numbers.append(bus.ping(index))
        if numbers.count(None) == 1 and numbers[-1] is None:
            numbers[-1] = late(bus, index)
    silent = [i for i, number in enumerate(numbers) if number is None]
    if silent:
        unanswered(bus, silent)
    others = [
        f"{bus.label(i)} is model {number}"
        for i, number in enumerate(numbers)
        if number != model.number
    ]
    if others:
        raise InvalidInput(
            f"port {bus.port}: expected servos {model.name} (model {model.number}): "
            f"{listed(others)}"
        )
    bus.fast = False
    bus.write_all(table.STATUS_RETURN, np.full(count, 2))
    firmware = bus.read_all(table.FIRMWARE.address, 1)[:, 0]
    old = [
        f"{bus.label(int(i))} has {firmware[i]}"
        for i in np.flatnonzero(firmware < table.WATCHDOG_FIRMWARE)
    ]
    if old:
        raise InvalidInput(
            f"expected firmware {table.WATCHDOG_FIRMWARE} or newer, for its watchdog: {listed(old)}"
        )
    bus.fast = bool((firmware >= table.FAST_FIRMWARE).all())


def configure(bus: ServoBus, current: NDArray[np.int64]) -> None:
    """Bring what the driver relies on into every servo; the EEPROM is written only where it
    differs.

    Arguments:
        current: Current Limit, in its units, shape (S,).

    Raises:
        InvalidInput: for a setting that differs on a servo whose torque is on, HardwareFault for
            whatever a servo refuses.
    """
    count = len(bus.ids)
    free = bus.read_all(table.TORQUE_ENABLE.address, 1)[:, 0] == 0
    _settle(bus, table.OPERATING_MODE, np.full(count, table.CURRENT_BASED_POSITION), free)
    _settle(bus, table.RETURN_DELAY, np.zeros(count, np.int64), free)
    _settle(bus, table.CURRENT_LIMIT, current, free)
    _settle(bus, table.DRIVE_MODE, np.zeros(count, np.int64), free)
    _settle(bus, table.STATUS_RETURN, np.full(count, 2), free)
    shutdown = unsigned(bus.read_all(table.SHUTDOWN.address, 1))
    _settle(bus, table.SHUTDOWN, shutdown | table.SHUTDOWN_ON, free)
    places = [register.address + k for register in table.WATCHED for k in range(register.size)]
    rows = np.tile(np.array(places, dtype="<u2").view(np.uint8), (count, 1))
    if not np.array_equal(bus.read_all(table.INDIRECT_ADDRESS.address, rows.shape[1]), rows):
        bus.write_rows(table.INDIRECT_ADDRESS.address, rows)
        values = bus.read_all(table.INDIRECT_ADDRESS.address, rows.shape[1])
        bus.refuse((values != rows).any(axis=1), "did not take its indirect addresses")


def _settle(
    bus: ServoBus, register: table.Register, wanted: NDArray[np.int64], free: NDArray[np.bool_]
) -> None:
    """Write a field where it differs, and see that it was taken.

    Looked at by a reading of all servos, whose length says that it is no late answer to something
    else; the SDK takes any answer of a servo for that to its last question.
    """
    for _ in range(ROUNDS):
        values = unsigned(bus.read_all(register.address, register.size))
        wrong = np.flatnonzero(values != wanted).tolist()
        if not wrong:
            return
        for index in wrong:
            if not free[index] and register.address < table.TORQUE_ENABLE.address:
                raise InvalidInput(
                    f"{bus.label(index)}: expected {register.name} {wanted[index]}, got "
                    f"{values[index]}; it cannot be "
                    "written while the torque is on: relax the robot first"
                )
            bus.write(index, register, int(wanted[index]))
    bus.refuse(
        unsigned(bus.read_all(register.address, register.size)) != wanted,
        f"did not keep its {register.name}",
    )
