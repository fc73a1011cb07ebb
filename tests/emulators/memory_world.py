"""Servos in memory: every joint follows its target as a critically damped second-order system,
faster than real time.

The body hangs in its frame, nothing is felt. It is armed like a robot, and it writes down every
command with its time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.robot_file import Servo, joint_names
from stancekit.planners.terrain import Patch
from stancekit.runner.safety.guard import Limits
from stancekit.runner.worlds.world import LatchedWorld, State, WorldCapabilities

FREQUENCY_RAD_S = 60.0
PATIENT = Limits(silent_s=5.0)
"""For hosts that are not tried for their haste: a loaded machine pauses for .25 s."""


class MemoryWorld(LatchedWorld):
    """An ``Actuator``. found_rad: where the joints are at first, shape (J,); the given angles where
    None.

    Faults: ``stuck`` joints do not move; ``fault`` is called before every command, and may raise,
    sleep or change the world; ``spoil`` changes what is measured. commands: (time.monotonic,
    targets) of everything that was sent.
    """

    name = "memory"

    def __init__(
        self, robot: Robot | None = None, *, found_rad: Array | None = None, rate_hz: float = 100.0
    ) -> None:
        super().__init__()
        self.robot, self.servo, self.rate_hz = robot or hexapod(), Servo(), rate_hz
        self.joints = joint_names(self.robot)
        limbs, count = len(self.robot.limbs), len(self.joints)
        self.capabilities = WorldCapabilities(
            joints=self.joints,
            rate_hz=rate_hz,
            lower_rad=np.tile(self.servo.lower_rad, limbs),
            upper_rad=np.tile(self.servo.upper_rad, limbs),
            velocity_rad_s=np.full(count, self.servo.velocity_rad_s),
            torque_nm=np.full(count, self.servo.torque_nm),
            has_body_pose=False,
            has_contact_forces=False,
        )
        self.found_rad = found_rad
        self.armed = False
        self.torque_on = False
        self.commands: list[tuple[float, Array]] = []
        self.stuck: list[int] = []
        self.fault: Callable[[MemoryWorld], None] = lambda world: None
        self.spoil: Callable[[State], State] = lambda state: state
        self.closed = 0

    def reset(
        self, terrain: Sequence[Patch], angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Measure; nothing moves."""
        self._angles = np.array(
            angles_rad if self.found_rad is None else self.found_rad, dtype=float
        )
        self._rates = np.zeros_like(self._angles)
        self._sent, self._time, self.armed = self._angles.copy(), 0.0, False
        self._pose = np.array(position_m, dtype=float), np.array(rotation, dtype=float)
        return self.measured()

    def torque(self, on: bool) -> None:
        """Arm, or let go."""
        if not on:
            self.relax()
            return
        with self.latch.sending():
            self.torque_on = True
        try:
            self.latch.check()
        except BaseException:
            self.relax()
            raise
        self.armed = True

    def hold(self) -> None:
        """Keep the last target."""
        self.armed = False

    def relax(self) -> None:
        """Torque off."""
        self.armed = self.torque_on = False

    def step(self, targets_rad: Array) -> State:
        """A control period, in millisecond steps of the second-order system."""
        self.fault(self)
        if not self.armed:
            raise InvalidInput("memory: expected torque(True) before step")
        with self.latch.sending():
            self.commands.append((time.monotonic(), np.array(targets_rad)))
        self._sent = np.array(targets_rad, dtype=float)
        free = np.ones(len(self.joints))
        free[self.stuck] = 0.0
        for _ in range(round(1000.0 / self.rate_hz)):
            pull = (
                FREQUENCY_RAD_S**2 * (self._sent - self._angles)
                - 2.0 * FREQUENCY_RAD_S * self._rates
            )
            self._rates = free * (self._rates + 1e-3 * pull)
            self._angles = self._angles + 1e-3 * self._rates
        self._time += 1.0 / self.rate_hz
        return self.spoil(self.measured())

    def measured(self) -> State:
        """The state now."""
        limbs = len(self.robot.limbs)
        return State(
            time_s=self._time,
            position_m=self._pose[0],
            rotation=self._pose[1],
            velocity=np.zeros(6),
            angles_rad=self._angles.copy(),
            rates_rad_s=self._rates.copy(),
            torques_nm=np.zeros(len(self.joints)),
            feet_m=np.zeros((limbs, 3)),
            forces_n=np.zeros((limbs, 3)),
            bump_n=0.0,
            sent_rad=self._sent.copy(),
        )

    def close(self) -> None:
        """Counted."""
        self.closed += 1


def silent(world: MemoryWorld) -> None:
    """A fault: the device does not answer."""
    raise HardwareFault("memory: LF_knee (id 4): no answer")
