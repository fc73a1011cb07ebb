"""Base of real robots: joints receive angles every period, and their angles are measured."""

from __future__ import annotations

import time

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import Servo, joint_names

from .capabilities import WorldCapabilities
from .world import LatchedWorld, State

RATE_HZ = 50.0


class HardwareWorld(LatchedWorld):
    """Joints under position control.

    The body is not measured: ``State`` repeats the pose given to ``reset``, the feet are where that
    pose and the measured angles have them, and forces are zero.

    late: how often more time was lost than is caught up. Raises InvalidInput without pinocchio.
    """

    name: str
    capabilities: WorldCapabilities
    catch_up: float = 1.0
    """So many late periods are made up for by shorter ones, so that a plan keeps its time."""

    def __init__(self, robot: Robot, servo: Servo, rate_hz: float) -> None:
        super().__init__()
        self.robot, self.servo, self.rate_hz = robot, servo, rate_hz
        self.joints = joint_names(robot)
        self._kinematics = Kinematics(robot, servo)
        self.armed, self.late, self._open = False, 0, False
        self._sent = np.zeros(len(self.joints))

    def sendable(self, targets_rad: Array) -> Array:
        """The targets as ``step`` would send them now: no farther than a joint turns in a period,
        and within limits.
        """
        can = self.capabilities
        most = can.velocity_rad_s / self.rate_hz
        near = np.clip(targets_rad, self._sent - most, self._sent + most)
        return np.asarray(np.clip(near, can.lower_rad, can.upper_rad))

    def _begin(self, position_m: Array, rotation: Array) -> None:
        """Begin to count time; where the body is taken to be."""
        self._pose = np.array(position_m, dtype=float), np.array(rotation, dtype=float)
        self._start_s = self._due_s = time.monotonic()

    def _checked(self, targets_rad: Array) -> Array:
        """Targets for ``step``.

        Raises InvalidInput where the world is not armed, or they are not finite.
        """
        if not self.armed:
            raise InvalidInput("world: expected torque(True) before step, got step first")
        targets = np.asarray(targets_rad, dtype=float)
        if targets.shape != self._sent.shape or not np.all(np.isfinite(targets)):
            raise InvalidInput(
                f"targets_rad: expected {len(self.joints)} finite numbers, got others"
            )
        return targets

    def _wait(self) -> None:
        """Until the period is over; where more is lost than is caught up the count starts anew."""
        self._due_s += 1.0 / self.rate_hz
        left = self._due_s - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        elif left < -self.catch_up / self.rate_hz:
            self.late += 1
            self._due_s = time.monotonic()

    def _state_of(self, angles_rad: Array, rates_rad_s: Array, torques_nm: Array) -> State:
        """State that was measured, shape (J,) each, on the pose that is assumed."""
        position, rotation = self._pose
        return State(
            time_s=time.monotonic() - self._start_s,
            position_m=position.copy(),
            rotation=rotation.copy(),
            velocity=np.zeros(6),
            angles_rad=angles_rad,
            rates_rad_s=rates_rad_s,
            torques_nm=torques_nm,
            feet_m=position + self._kinematics.feet(angles_rad) @ rotation.T,
            forces_n=np.zeros((len(self.robot.limbs), 3)),
            bump_n=0.0,
            sent_rad=self._sent.copy(),
        )
