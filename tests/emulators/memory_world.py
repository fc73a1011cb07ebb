"""Servos in memory: every joint follows its target as a critically damped second-order system,
faster than real time.

The body hangs in its frame, nothing is felt. It is armed like a robot, and it writes down every
command with its time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.terrain import Patch
from stancekit.runner.safety.guard import Limits
from stancekit.runner.worlds.world import Drives, JointBus, State, WorldSettings

FREQUENCY_RAD_S = 60.0
PATIENT = Limits(silent_s=5.0)
"""For hosts that are not tried for their haste: a loaded machine pauses for .25 s."""


class MemoryWorld(JointBus):
    """found_rad: where the joints are at first, shape (J,); the given angles where
    None.

    Faults: ``stuck`` joints do not move; ``fault`` is called before every command, and may raise,
    sleep or change the world; ``spoil`` changes what is measured. commands: (time.monotonic,
    targets) of everything that was sent.
    """

    name = "memory"

    def __init__(
        self, robot: Robot | None = None, *, found_rad: Array | None = None, rate_hz: float = 100.0
    ) -> None:
        robot = robot or hexapod()
        drives = replace(Drives.of(robot.legs_with(Servo())), yields=False)
        super().__init__(robot, Servo(), drives, rate_hz, senses=False)
        self.found_rad = found_rad
        self.torque_on = False
        self.pending = ""
        self.commands: list[tuple[float, Array]] = []
        self.stuck: list[int] = []
        self.fault: Callable[[MemoryWorld], None] = lambda world: None
        self.spoil: Callable[[State], State] = lambda state: state
        self.closed = 0

    def connect(
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

    @classmethod
    def make(cls, settings: WorldSettings) -> MemoryWorld:
        """One of this robot."""
        return cls(settings.robot)

    def arm(self) -> None:
        """Torque on."""
        with self.latch.sending():
            self.torque_on = True
        try:
            self.latch.check()
        except BaseException:
            self.stop(torque_off=True)
            raise
        self.armed = True

    def stop(self, *, torque_off: bool = False) -> str:
        """Keep the last target, or torque off."""
        self.armed = False
        if torque_off:
            self.relax()
        return self.pending

    def relax(self) -> None:
        """Torque off."""
        self.torque_on = False

    def send(self, targets_rad: Array, loads_rad: Array | None = None) -> None:
        """Note a command."""
        self.fault(self)
        if not self.armed:
            raise InvalidInput("memory: expected arm before step")
        with self.latch.sending():
            self.commands.append((time.monotonic(), np.array(targets_rad)))
        self._sent = np.array(targets_rad, dtype=float)

    def read(self) -> State:
        """A control period, in millisecond steps of the second-order system."""
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
