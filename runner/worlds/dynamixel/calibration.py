"""Calibration files ``stancekit/servos/1``: which servo on which port turns which joint, from
where, and how far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.robot_file import JOINTS, Servo

from ..world import SetupFile, own
from .control_table import (
    CENTRE_TICK,
    LATENCY_MS,
    MODELS,
    P_GAIN,
    RAD,
    TICKS,
    WATCHDOG_S,
    ServoModel,
)

FORMAT: Literal["stancekit/servos/1"] = "stancekit/servos/1"
Baud = Literal[57600, 115200, 1000000, 2000000, 3000000, 4000000]


@dataclass(frozen=True, kw_only=True)
class JointServo:
    """One servo. angle = direction · (tick − zero_tick) · 2π / 4096.

    Arguments:
        id: on the bus.
        zero_tick: what the servo reads where the joint's angle is 0.
        direction: 1 or −1, whether both turn the same way.
        lower_rad, upper_rad: of the joint, where the frame or its cables end.
        current_a: most that the servo may draw, which limits its torque.
        rest_rad: the joint's angle where the robot rests without torque, None where that is not
            known; a robot found elsewhere is calibrated wrong.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    id: Annotated[int, Field(ge=0, le=252, strict=True)]
    zero_tick: Annotated[int, Field(ge=0, lt=TICKS, strict=True)] = CENTRE_TICK
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
        port, baud: where they are.
        model: all of one, a name in ``control_table.MODELS``.
        watchdog_s: a servo that hears nothing for so long stops by itself, in steps of 20 ms.
        latency_ms: of the adapter; an answer that takes longer is asked for again.
        p_gain: Position P Gain, how stiff the servos are.
        desk: the servos lie on a desk or the robot hangs, so that they carry nothing, and plans for
            all of its torques may be run: they are sent where joints are to be, and no loads.
        joints: by their names.
    """

    format: Literal["stancekit/servos/1"] = FORMAT
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
        return int(self.watchdog_s / WATCHDOG_S + 1e-9)

    def ordered(self, joints: Sequence[str]) -> list[JointServo]:
        """The servos of these joints."""
        return [self.joints[name] for name in joints]

    def shafts(self, joints: Sequence[str], angles_rad: Array) -> Array:
        """Angles of the servos' shafts from their tick 2048 [rad] for joint angles, shape (J,)
        both.
        """
        servos = self.ordered(joints)
        zero = np.array([servo.zero_tick - CENTRE_TICK for servo in servos])
        return np.array([servo.direction for servo in servos]) * angles_rad + RAD * zero


def nominal(
    joints: Sequence[str], servo: Servo = Servo(), *, port: str, **settings: Any
) -> Calibration:
    """A calibration to start from: ids from 1 in the joints' order, zero at the servo's centre, the
    robot's limits.
    """
    current_a = MODELS[settings.get("model", "XM540-W270")].current_a / 2.0
    limits = list(zip(servo.lower_rad, servo.upper_rad, strict=True))
    return Calibration(
        port=port,
        joints={
            name: JointServo(
                id=1 + i,
                lower_rad=limits[i % len(JOINTS)][0],
                upper_rad=limits[i % len(JOINTS)][1],
                current_a=round(current_a, 3),
            )
            for i, name in enumerate(joints)
        },
        **settings,
    )


class ServoTicks:
    """Between joint angles [rad] and ticks, for joints in one order; J joints."""

    def __init__(self, servos: Sequence[JointServo]) -> None:
        self.zero = np.array([servo.zero_tick for servo in servos])
        self.direction = np.array([servo.direction for servo in servos])

    def ticks(self, angles_rad: Array) -> np.ndarray[Any, np.dtype[np.int64]]:
        """The nearest ticks, shape (J,)."""
        return np.asarray(np.rint(self.zero + self.direction * angles_rad / RAD), dtype=np.int64)

    def angles(self, ticks: np.ndarray[Any, Any]) -> Array:
        """Joint angles, shape (J,)."""
        return np.asarray(self.direction * (ticks - self.zero) * RAD, dtype=np.float64)
