"""What simulated worlds have in common: one robot, driven as its servos drive it, physics in steps of a millisecond."""

from __future__ import annotations

from abc import abstractmethod
from typing import Self

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.posture import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.urdf import Servo, joint_names

from .settings import WorldSettings
from .world import LatchedWorld, State, Terrain, WorldKind

PHYSICS_S = 1e-3
RATE_HZ = 200.0
SPACING_M = 0.025
"""Of the grid that simulators get of heights."""


class SimulatedWorld(LatchedWorld):
    """One robot on one terrain, from nothing: needs no arming, measures everything, and takes no file."""

    kind: WorldKind = "simulation"
    name: str

    def __init__(
        self, robot: Robot, servo: Servo = Servo(), *, rate_hz: float = RATE_HZ, gravity_m_s2: float = GRAVITY_M_S2
    ) -> None:
        super().__init__()
        self.robot, self.servo, self.rate_hz, self.gravity_m_s2 = robot, servo, rate_hz, gravity_m_s2
        self.joints = joint_names(robot)
        self._substeps = max(1, round(1.0 / (rate_hz * PHYSICS_S)))

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """As ``WorldClass``."""
        if settings.setup is not None:
            raise InvalidInput(f"setup: expected none with world {cls.name}, got {settings.setup}")
        rate_hz = RATE_HZ if settings.rate_hz is None else settings.rate_hz
        return cls(settings.robot, settings.servo, rate_hz=rate_hz, gravity_m_s2=settings.gravity_m_s2)

    @abstractmethod
    def reset(self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array) -> State:
        """Put the robot, at rest, into this pose over this terrain."""

    @abstractmethod
    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""


def sendable(targets: Array, before: Array, servo: Servo, period_s: float) -> Array:
    """Targets as a servo takes them: within the joints' limits, and no farther from the last ones than it can turn."""
    step = servo.velocity_rad_s * period_s
    limbs = len(targets) // len(servo.lower_rad)
    kept = np.clip(targets, np.tile(servo.lower_rad, limbs), np.tile(servo.upper_rad, limbs))
    return np.asarray(np.clip(kept, before - step, before + step))
