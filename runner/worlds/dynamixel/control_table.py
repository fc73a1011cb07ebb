"""The control table of the DYNAMIXEL X series (XM430, XM540), Protocol 2.0: addresses, units,
models, errors.

Source: ROBOTIS e-Manual, XM430-W350 and XM540-W270, "Control Table".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stancekit.planners.robot.actuators import builtin_actuators


class Register(NamedTuple):
    """A field of the control table: what the manual calls it, where it is, and how many bytes it
    has.
    """

    name: str
    address: int
    size: int


FIRMWARE = Register("Firmware Version", 6, 1)
RETURN_DELAY = Register("Return Delay Time", 9, 1)
DRIVE_MODE = Register("Drive Mode", 10, 1)
OPERATING_MODE = Register("Operating Mode", 11, 1)
CURRENT_LIMIT = Register("Current Limit", 38, 2)
SHUTDOWN = Register("Shutdown", 63, 1)
TORQUE_ENABLE = Register("Torque Enable", 64, 1)
STATUS_RETURN = Register("Status Return Level", 68, 1)
HARDWARE_ERROR = Register("Hardware Error Status", 70, 1)
POSITION_P_GAIN = Register("Position P Gain", 84, 2)
BUS_WATCHDOG = Register("Bus Watchdog", 98, 1)
GOAL_CURRENT = Register("Goal Current", 102, 2)
PROFILE_ACCELERATION = Register("Profile Acceleration", 108, 4)
PROFILE_VELOCITY = Register("Profile Velocity", 112, 4)
GOAL_POSITION = Register("Goal Position", 116, 4)
REALTIME_TICK = Register("Realtime Tick", 120, 2)
PRESENT_CURRENT = Register("Present Current", 126, 2)
PRESENT_VELOCITY = Register("Present Velocity", 128, 4)
PRESENT_POSITION = Register("Present Position", 132, 4)
INDIRECT_ADDRESS = Register("Indirect Address 1", 168, 2)
INDIRECT_DATA = Register("Indirect Data 1", 224, 1)

WATCHED = (
    TORQUE_ENABLE,
    HARDWARE_ERROR,
    BUS_WATCHDOG,
    PRESENT_CURRENT,
    PRESENT_VELOCITY,
    PRESENT_POSITION,
    REALTIME_TICK,
)
"""Fields that are read in every control period, gathered in the indirect data: 15 bytes per servo
in one answer."""
WATCHED_BYTES = sum(register.size for register in WATCHED)

TICKS, CENTRE_TICK = 4096, 2048
RAD = 2.0 * np.pi / TICKS
"""One tick of a position."""
RAD_S = 0.229 * 2.0 * np.pi / 60.0
"""One unit of a velocity."""
AMPERE = 2.69e-3
"""One unit of a current."""
LATENCY_MS = 16.0
"""Latency of the usual USB adapter, between a byte and the host."""
WATCHDOG_S = 0.02
"""One unit of the bus watchdog."""
TRIPPED = 0xFF
"""Bus Watchdog reads −1: the servo heard nothing for too long, stopped, and takes no goals until
this is cleared."""
P_GAIN = 800
"""Position P Gain of the factory, for which ``builtin_actuators`` says how stiff a servo is."""
CURRENT_BASED_POSITION = 5
"""Operating mode: position control whose current is limited by Goal Current. In plain position
control it is not."""
REVERSE, TIME_PROFILE, TORQUE_BY_GOAL = 0x01, 0x04, 0x08
"""Bits of Drive Mode. None may be set: the calibration turns directions, and a goal must never
switch the torque on."""
SHUTDOWN_ON = 0x34
"""Bits of Shutdown that have to be set: overload, electrical shock, overheating."""
WATCHDOG_FIRMWARE, FAST_FIRMWARE = 38, 45
"""The first firmware with a bus watchdog, and with Fast Sync Read."""

ERRORS = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "motor encoder",
    0x10: "electrical shock",
    0x20: "overload",
}


@dataclass(frozen=True, kw_only=True)
class ServoModel:
    """One servo of the series, whose torques and speeds ``builtin_actuators`` has.

    Arguments:
        current_a: greatest Current Limit.
        stall_a: at stall torque, at 12 V.
    """

    name: str
    number: int
    current_a: float
    stall_a: float

    @property
    def nm_a(self) -> float:
        """Stall torque over stall current, to say what torque a current stands for; rough."""
        return builtin_actuators()[self.name].stall_nm / self.stall_a


MODELS = {
    model.name: model
    for model in (
        ServoModel(name="XM430-W350", number=1020, current_a=1193 * AMPERE, stall_a=2.3),
        ServoModel(name="XM540-W270", number=1120, current_a=2047 * AMPERE, stall_a=4.4),
    )
}


def hardware_errors(status: int) -> str:
    """Names of a Hardware Error Status, e.g. ``overload``."""
    named = [name for bit, name in ERRORS.items() if status & bit]
    return ", ".join(named) or f"unknown error 0x{status:02X}"
