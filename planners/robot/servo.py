"""The drives of legs that are drawn up: limits of every joint, and its position loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..files.arrays import checked
from ..files.codec import Within, check_limits

JOINTS = ("yaw", "hip", "roll", "knee")
"""The joints of a limb from the shoulder outwards: about the body's z, the limb's y (down
positive), the thigh, and the limb's y again. A foot below its shoulder is on the axis of yaw: there
roll moves it sideways."""

FOOT_RADIUS_M = 0.012
"""Radius of a foot that is drawn up."""


Positive = Annotated[float, Within(above=0.0)]
TURN = Within(least=-10.0, most=10.0)
"""Range of a joint's limits [rad]."""
Angle = Annotated[float, TURN]


@dataclass(frozen=True, kw_only=True)
class Servo:
    """Limits of every joint, and the position loop τ = Kp (q* − q) − Kd q̇ inside the servo that
    drives it.

    Arguments:
        lower_rad, upper_rad: joint limits of yaw, hip, roll and knee [rad].
        rotor_kg_m2: inertia of the rotor, seen behind the gears.
        torque_nm, velocity_rad_s: limits of torque [Nm] and speed [rad/s].
        stiffness_nm_rad, damping_nms_rad: gains Kp and Kd.
    """

    lower_rad: tuple[Angle, Angle, Angle, Angle] = (-1.9, -1.8, -2.6, -0.05)
    upper_rad: tuple[Angle, Angle, Angle, Angle] = (1.9, 1.8, 2.6, 2.75)
    torque_nm: Positive = 40.0
    velocity_rad_s: Positive = 4.0
    stiffness_nm_rad: Positive = 400.0
    damping_nms_rad: Positive = 6.0
    rotor_kg_m2: Annotated[float, Within(least=0.0)] = 0.01

    def __post_init__(self) -> None:
        check_limits(self)
        for i in range(len(JOINTS)):
            TURN.check(self.upper_rad[i], f"upper_rad[{i}]")
            checked(self.lower_rad[i], f"lower_rad[{i}]", least=TURN.least, most=self.upper_rad[i])
