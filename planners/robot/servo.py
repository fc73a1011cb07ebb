"""The drives of legs that are drawn up: limits of every joint, and its position loop."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..files.arrays import check_numbers, checked, collect_errors

JOINTS = ("yaw", "hip", "roll", "knee")
"""The joints of a limb from the shoulder outwards: about the body's z, the limb's y (down positive), the thigh, and the
limb's y again. A foot below its shoulder is on the axis of yaw: there roll moves it sideways."""

FOOT_RADIUS_M = 0.012
"""Radius of a foot that is drawn up."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """Limits of every joint, and the position loop τ = Kp (q* − q) − Kd q̇ inside the servo that drives it.

    lower_rad, upper_rad: of yaw, hip, roll and knee. rotor_kg_m2: inertia of the rotor, seen behind the gears.
    torque_nm, velocity_rad_s: limits. stiffness_nm_rad, damping_nms_rad: Kp and Kd.
    """

    lower_rad: tuple[float, float, float, float] = (-1.9, -1.8, -2.6, -0.05)
    upper_rad: tuple[float, float, float, float] = (1.9, 1.8, 2.6, 2.75)
    torque_nm: float = 40.0
    velocity_rad_s: float = 4.0
    stiffness_nm_rad: float = 400.0
    damping_nms_rad: float = 6.0
    rotor_kg_m2: float = 0.01

    def __post_init__(self) -> None:
        positive = ("torque_nm", "velocity_rad_s", "stiffness_nm_rad", "damping_nms_rad")
        collect_errors(
            lambda: check_numbers(self, "servo.", above=positive, least=("rotor_kg_m2",)),
            *(
                lambda i=i: checked(
                    self.lower_rad[i], f"servo.lower_rad[{i}]", most=self.upper_rad[i]
                )
                for i in range(len(JOINTS))
            ),
        )


def servo_to_json(servo: Servo) -> dict[str, Any]:
    """JSON-ready values of a servo; ``DrawnLegsKeys`` reads them."""
    numbers = asdict(servo)
    return {name: list(each) if isinstance(each, tuple) else each for name, each in numbers.items()}
