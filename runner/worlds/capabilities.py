"""Capabilities of a world, for those who must know before they send anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from stancekit.planners.files.arrays import Array, checked, read_only
from stancekit.planners.robot import Robot
from stancekit.planners.robot.robot_file import Servo, joint_names

from .drives import Drives


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldCapabilities:
    """Limits and senses of a world; J joints.

    Arguments:
        joints: names, in the order of all arrays.
        rate_hz: of the targets.
        lower_rad, upper_rad, velocity_rad_s, torque_nm: limits of the joints, shape (J,).
        has_body_pose, has_contact_forces: whether it measures them; where it does not, a ``State``
            repeats the assumed pose and has zeros.
    """

    joints: tuple[str, ...]
    rate_hz: float
    lower_rad: Array
    upper_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    has_body_pose: bool
    has_contact_forces: bool

    @classmethod
    def of_servos(cls, robot: Robot, servo: Servo, rate_hz: float, *, senses: bool) -> Self:
        """Capabilities of such servos at every joint.

        Arguments:
            senses: the body's pose and contact forces are measured.
        """
        joints, limbs = joint_names(robot), len(robot.limbs)
        return cls(
            joints=joints,
            rate_hz=rate_hz,
            lower_rad=np.tile(servo.lower_rad, limbs),
            upper_rad=np.tile(servo.upper_rad, limbs),
            velocity_rad_s=np.full(len(joints), servo.velocity_rad_s),
            torque_nm=np.full(len(joints), servo.torque_nm),
            has_body_pose=senses,
            has_contact_forces=senses,
        )

    @classmethod
    def of_drives(cls, drives: Drives, rate_hz: float, *, senses: bool) -> Self:
        """Capabilities of such drives.

        Arguments:
            senses: the body's pose and contact forces are measured.
        """
        return cls(
            joints=drives.joints,
            rate_hz=rate_hz,
            lower_rad=drives.lower_rad,
            upper_rad=drives.upper_rad,
            velocity_rad_s=drives.velocity_rad_s,
            torque_nm=drives.torque_nm,
            has_body_pose=senses,
            has_contact_forces=senses,
        )

    def __post_init__(self) -> None:
        checked(self.rate_hz, "capabilities.rate_hz", above=0.0)
        for name in ("lower_rad", "upper_rad", "velocity_rad_s", "torque_nm"):
            object.__setattr__(
                self,
                name,
                read_only(getattr(self, name), (len(self.joints),), f"capabilities.{name}"),
            )
