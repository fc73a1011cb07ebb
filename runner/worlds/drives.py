"""What drives the joints of a robot in simulation, and what of it is not as it should be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked, collect_errors, read_only
from stancekit.planners.problem.posture import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.urdf import Servo

STIFFNESS, DAMPING_S, ROTOR_S2 = 1.0, 0.04, 2e-4
"""Of drives that a robot's file says nothing of: Kp [Nm/rad], Kd / Kp [s], and a rotor's inertia behind its gears
[kg m²], the first and the last in units of what holds the robot's weight at a leg's length [Nm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drives:
    """The position loops τ = Kp (q* − q) − Kd q̇ at J joints, and their limits, shape (J,) each.

    joints: names, in the order of all arrays. lower_rad, upper_rad, velocity_rad_s, torque_nm: limits.
    stiffness_nm_rad, damping_nms_rad: Kp, Kd. rotor_kg_m2: inertia of the rotors, seen behind the gears.
    """

    joints: tuple[str, ...]
    lower_rad: Array
    upper_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    stiffness_nm_rad: Array
    damping_nms_rad: Array
    rotor_kg_m2: Array

    def __post_init__(self) -> None:
        for name in self.__annotations__:
            if name != "joints":
                object.__setattr__(self, name, read_only(getattr(self, name), (len(self.joints),), f"drives.{name}"))

    @classmethod
    def of(cls, robot: Robot, servo: Servo, model: RobotModel) -> Self:
        """The servo's at every joint that is drawn up; of a robot with a model of its own, its file's limits, and a
        loop as stiff as such a weight needs. Raises InvalidInput for a joint without a limit of torque or velocity."""
        joints = [joint for leg in model.legs for joint in leg.joints]
        if robot.model is None:
            gains = servo.stiffness_nm_rad, servo.damping_nms_rad, servo.rotor_kg_m2
        else:
            model.check_torques()
            for joint in joints:
                if joint.velocity_rad_s <= 0.0:
                    raise InvalidInput(
                        f"joint {joint.name}: expected a velocity limit above 0 rad/s, its file has none"
                    )
            length_m = float(np.mean([leg.chain.length_m for leg in model.legs]))
            weight = model.body.mass_kg * GRAVITY_M_S2 * length_m
            gains = STIFFNESS * weight, DAMPING_S * STIFFNESS * weight, ROTOR_S2 * weight
        return cls(
            joints=tuple(joint.name for joint in joints),
            lower_rad=np.array([joint.lower_rad for joint in joints]),
            upper_rad=np.array([joint.upper_rad for joint in joints]),
            velocity_rad_s=np.array([joint.velocity_rad_s for joint in joints]),
            torque_nm=np.array([joint.torque_nm for joint in joints]),
            **{name: np.full(len(joints), gain)
               for name, gain in zip(("stiffness_nm_rad", "damping_nms_rad", "rotor_kg_m2"), gains, strict=True)},
        )  # fmt: skip

    def sendable(self, targets: Array, before: Array, period_s: float) -> Array:
        """Targets as a drive takes them: within the joints' limits, no farther from the last than it can turn."""
        step = self.velocity_rad_s * period_s
        kept = np.clip(targets, self.lower_rad, self.upper_rad)
        return np.asarray(np.clip(kept, before - step, before + step))


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """What of a simulated robot is not as its file says; drawn once, from the seed.

    offset_rad: joints are mounted off by up to so much, either way, and measure themselves wrong by that. noise_rad:
    standard deviation of what they measure. delay_s: from a command to its effect, in whole control periods.
    stiffness_share, mass_share: of the loops' Kp, and of all masses.
    """

    offset_rad: float = 0.0
    noise_rad: float = 0.0
    delay_s: float = 0.0
    stiffness_share: float = 1.0
    mass_share: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        collect_errors(
            *(lambda n=n: checked(getattr(self, n), f"imperfections.{n}", least=0.0)
              for n in ("offset_rad", "noise_rad", "delay_s")),
            *(lambda n=n: checked(getattr(self, n), f"imperfections.{n}", above=0.0)
              for n in ("stiffness_share", "mass_share")),
        )  # fmt: skip
