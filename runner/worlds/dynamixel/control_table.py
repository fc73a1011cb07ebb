"""The control table of the DYNAMIXEL X series (XM430, XM540), Protocol 2.0: addresses, units,
models, errors.

Source: ROBOTIS e-Manual, XM430-W350 and XM540-W270, "Control Table".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import Strict
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import builtin_actuators

from ..hardware import Turning
from ..world import SetupFile, own


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
_REALTIME_TICK = Register("Realtime Tick", 120, 2)
_PRESENT_CURRENT = Register("Present Current", 126, 2)
_PRESENT_VELOCITY = Register("Present Velocity", 128, 4)
_PRESENT_POSITION = Register("Present Position", 132, 4)
INDIRECT_ADDRESS = Register("Indirect Address 1", 168, 2)
INDIRECT_DATA = Register("Indirect Data 1", 224, 1)

WATCHED = (
    TORQUE_ENABLE,
    HARDWARE_ERROR,
    BUS_WATCHDOG,
    _PRESENT_CURRENT,
    _PRESENT_VELOCITY,
    _PRESENT_POSITION,
    _REALTIME_TICK,
)
"""Fields that are read in every control period, gathered in the indirect data: 15 bytes per servo
in one answer."""
WATCHED_BYTES = sum(register.size for register in WATCHED)

TICKS, _CENTRE_TICK = 4096, 2048
RAD = 2.0 * np.pi / TICKS
"""One tick of a position."""
RAD_S = 0.229 * 2.0 * np.pi / 60.0
"""One unit of a velocity."""
AMPERE = 2.69e-3
"""One unit of a current."""
LATENCY_MS = 16.0
"""Latency of the usual USB adapter, between a byte and the host."""
_WATCHDOG_S = 0.02
"""One unit of the bus watchdog."""
TRIPPED = 0xFF
"""Bus Watchdog reads −1: the servo heard nothing for too long, stopped, and takes no goals until
this is cleared."""
P_GAIN = 800
"""Position P Gain of the factory, for which ``builtin_actuators`` says how stiff a servo is."""
CURRENT_BASED_POSITION = 5
"""Operating mode: position control whose current is limited by Goal Current. In plain position
control it is not."""
SHUTDOWN_ON = 0x34
"""Bits of Shutdown that have to be set: overload, electrical shock, overheating."""
WATCHDOG_FIRMWARE, FAST_FIRMWARE = 38, 45
"""The first firmware with a bus watchdog, and with Fast Sync Read."""

_ERRORS = {
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


MODELS = MappingProxyType(
    {
        model.name: model
        for model in (
            ServoModel(name="XM430-W350", number=1020, current_a=1193 * AMPERE, stall_a=2.3),
            ServoModel(name="XM540-W270", number=1120, current_a=2047 * AMPERE, stall_a=4.4),
        )
    }
)


def hardware_errors(status: int) -> str:
    """Names of a Hardware Error Status, e.g. ``overload``."""
    named = [name for bit, name in _ERRORS.items() if status & bit]
    return ", ".join(named) or f"unknown error 0x{status:02X}"


Baud = Literal[57600, 115200, 1000000, 2000000, 3000000, 4000000]


@dataclass(frozen=True, kw_only=True)
class JointServo(Strict):
    """One servo. angle = direction · (tick − zero_tick) · 2π / 4096.

    Arguments:
        id: number of the servo on the bus.
        zero_tick: its reading at joint angle 0.
        direction: −1 if servo and joint turn opposite ways.
        lower_rad, upper_rad: limits of the joint, by its frame and cables.
        current_a: largest current, which limits the torque.
        rest_rad: joint angle at which the robot rests without torque, if known; a robot found
            elsewhere is calibrated wrong.
    """

    id: Annotated[int, Field(ge=0, le=252, strict=True)]
    zero_tick: Annotated[int, Field(ge=0, lt=TICKS, strict=True)] = _CENTRE_TICK
    direction: Literal[-1, 1] = 1
    lower_rad: Annotated[float, Field(ge=-6.3, le=6.3)]
    upper_rad: Annotated[float, Field(ge=-6.3, le=6.3)]
    current_a: Annotated[float, Field(gt=0.0, le=6.0)]
    rest_rad: Annotated[float | None, Field(ge=-6.3, le=6.3)] = None

    def __post_init__(self) -> None:
        if not self.lower_rad < self.upper_rad:
            raise InvalidInput(
                f"upper_rad: expected a number above {self.lower_rad:g}, got {self.upper_rad:g}"
            )
        for name in ("lower_rad", "upper_rad"):
            tick = self.zero_tick + self.direction * getattr(self, name) / RAD
            if not 0 <= tick < TICKS:
                raise InvalidInput(
                    f"{name}: expected an angle within the servo's one turn, 0 to {TICKS - 1}, got "
                    f"{getattr(self, name):g} at tick {tick:.0f}"
                )


@dataclass(frozen=True, kw_only=True)
class Calibration(SetupFile):
    """All servos of a robot.

    Arguments:
        port: serial port of the bus.
        baud: its rate [bit/s].
        model: model of all servos.
        watchdog_s: silence on the bus after which a servo stops by itself, in steps of 20 ms.
        latency_ms: latency of the adapter; a servo that answers later is asked again.
        p_gain: Position P Gain, the servos' stiffness.
        desk: true if the servos lie on a desk or the robot hangs: without load, plans of any torque
            may be run, and the servos are sent positions alone.
        joints: servos by the joints' names.
    """

    format: Literal["stancekit/servos/1"] = "stancekit/servos/1"
    port: Annotated[str, Field(min_length=1)]
    baud: Baud = 1000000
    model: Literal["XM430-W350", "XM540-W270"] = "XM540-W270"
    watchdog_s: Annotated[float, Field(ge=0.06, le=1.0)] = 0.2
    latency_ms: Annotated[float, Field(ge=1.0, le=200.0)] = LATENCY_MS
    p_gain: Annotated[int, Field(gt=0, lt=16384, strict=True)] = P_GAIN
    desk: bool = False
    joints: Annotated[dict[str, JointServo], Field(min_length=1)]

    def __post_init__(self) -> None:
        wrong = own({joint: servo.id for joint, servo in self.joints.items()}, "id", "its own id")
        wrong += [
            f"joints.{joint}.current_a: expected up to {self.kind.current_a:.3g}, the most of an "
            f"{self.model}, "
            f"got {servo.current_a:g}"
            for joint, servo in self.joints.items()
            if servo.current_a > self.kind.current_a
        ]
        if wrong:
            raise InvalidInput("; ".join(wrong))

    @property
    def kind(self) -> ServoModel:
        """The servos' model."""
        return MODELS[self.model]

    @property
    def watchdog_units(self) -> int:
        """Value for Bus Watchdog; never longer than asked for."""
        return int(self.watchdog_s / _WATCHDOG_S + 1e-9)

    def ordered(self, joints: Sequence[str]) -> list[JointServo]:
        """The servos of these joints."""
        return [self.joints[name] for name in joints]

    def turning(self, joints: Sequence[str]) -> Turning:
        """Between angles of these joints and ticks of their servos."""
        servos = self.ordered(joints)
        return Turning(
            [each.direction for each in servos], [each.zero_tick for each in servos], RAD
        )


def nominal(robot: Robot, /, *, port: str, **settings: Any) -> Calibration:
    """A calibration to start from: ids from 1 in the joints' order, and the limits of the robot's
    joints as far as a servo turns. Its centre is a joint's 0, or the middle of limits that are
    beyond a servo's turn about 0.
    """
    current_a = round(MODELS[settings.get("model", "XM540-W270")].current_a / 2.0, 3)
    joints = dict[str, JointServo]()
    for leg in robot.legs.legs:
        for joint in leg.joints:
            low, high = joint.lower_rad, joint.upper_rad
            far = 0 if max(-low, high) <= np.pi else round(0.5 * (low + high) / RAD)
            zero = min(max(_CENTRE_TICK - far, 0), TICKS - 1)
            joints[joint.name] = JointServo(
                id=1 + len(joints),
                zero_tick=zero,
                lower_rad=max(low, (1 - zero) * RAD),
                upper_rad=min(high, (TICKS - 1 - zero) * RAD),
                current_a=current_a,
            )
    return Calibration(port=port, joints=joints, **settings)
