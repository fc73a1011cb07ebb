"""Base of real robots: joints receive angles every period, and their angles are measured."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import Servo

from .world import Drives, JointBus, State, Terrain


def listed(names: Sequence[str]) -> str:
    """The first three of them, and how many more."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


RATE_HZ = 50.0
_SLACK_RAD = 0.05
"""A joint measured this far beyond its limits is at its stop; one that is farther beyond is
calibrated or mapped wrong."""
_Measured = tuple[Array, Array, Array]


class Turning:
    """Between joint angles [rad] and what a device says of them, direction · angle / unit + zero, for
    joints in one order; J joints.
    """

    def __init__(self, direction: ArrayLike, zero: ArrayLike, unit: float = 1.0) -> None:
        self.direction, self.zero = np.asarray(direction, float), np.asarray(zero, float)
        self.unit = unit

    def told(self, angles_rad: Array) -> Array:
        """Values of the device, shape (…, J)."""
        return np.asarray(self.zero + self.direction * angles_rad / self.unit)

    def angles(self, values: NDArray[Any]) -> Array:
        """Joint angles, shape (…, J)."""
        return np.asarray(self.direction * (values - self.zero) * self.unit)


class HardwareWorld(JointBus):
    """Joints of a device: the one life of servos on a bus and of a robot behind a rosbridge.

    The body is not measured: ``State`` repeats the pose given to ``connect``, the feet are where
    that pose and the measured angles have them, and forces are zero. Subclasses say how a device is
    found, armed, sent to, measured and left.

    Raises InvalidInput without pinocchio.
    """

    catch_up: float = 1.0
    """So many late periods are made up for by shorter ones, so that a plan keeps its time."""
    wrong = "is its calibration right"
    """What to ask about a joint that is measured beyond its limits."""

    def __init__(
        self, robot: Robot, servo: Servo | None, drives: Drives, rate_hz: float | None
    ) -> None:
        super().__init__(
            robot, servo, drives, RATE_HZ if rate_hz is None else rate_hz, senses=False
        )
        self._kinematics = Kinematics(robot, self.servo)
        own = self._kinematics.velocity_rad_s  # joints turn no faster than their file allows
        fastest = np.minimum(self.capabilities.velocity_rad_s, np.where(own > 0.0, own, np.inf))
        self.capabilities = replace(self.capabilities, velocity_rad_s=fastest)
        self._open = False
        self._driven = False  # goals may have been sent that joints are still on their way to
        self._sent = np.zeros(len(self.joints))

    def connect(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Connect, check everything, measure; nothing moves, and the torque stays as it was.

        Arguments:
            angles_rad: not used, the measured ones come back.
            position_m, rotation: where the body is taken to be.

        Raises:
            InvalidInput: for whatever is wrong, for nothing has moved.
        """
        self.armed = False
        try:
            measured = self._reached()
        except HardwareFault as fault:
            raise InvalidInput(str(fault)) from None
        self._check_angles(measured[0])
        self._sent = measured[0].copy()
        self._pose = np.array(position_m, dtype=float), np.array(rotation, dtype=float)
        self._start_s = self._due_s = time.monotonic()
        return self._state(*measured)

    def arm(self) -> None:
        """Arm: hold the measured pose.

        However an arming is interrupted, the torque is as it was before; ``stop`` makes sure of it.
        Raises InvalidInput for whatever is wrong before anything can move, HardwareFault after that.
        """
        if not self._open:
            raise InvalidInput("world: expected connect before arm, got no connect")
        try:
            self._switched_on()
        except BaseException as error:  # joints are held, then it is raised again
            driven = self._driven
            with suppress(HardwareFault):  # what goes wrong now is told by the ending's ``stop``
                self.stop()
            if isinstance(error, HardwareFault) and not driven:
                raise InvalidInput(str(error)) from None
            raise
        self.armed, self._due_s = True, time.monotonic()

    def send(self, targets_rad: Array, loads_rad: Array | None = None) -> None:
        """Send targets, clipped to limits and to what a joint can turn in a period.

        Raises InvalidInput for targets that are not finite, and where the world is not armed;
        HardwareFault for whatever the device does wrong, after which the world is not armed.
        """
        if not self.armed:
            raise InvalidInput("world: expected arm before step, got step first")
        targets = np.asarray(targets_rad, dtype=float)
        if targets.shape != self._sent.shape or not np.all(np.isfinite(targets)):
            raise InvalidInput(
                f"targets_rad: expected {len(self.joints)} finite numbers, got other values"
            )
        can = self.capabilities
        most = can.velocity_rad_s / self.rate_hz
        near = np.clip(targets, self._sent - most, self._sent + most)
        with self._disarming():
            self._sent = self._put(np.clip(near, can.lower_rad, can.upper_rad))

    def read(self) -> State:
        """Wait for the end of the control period, and measure; faults are as those of ``send``."""
        self._due_s += 1.0 / self.rate_hz
        left = self._due_s - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        elif left < -self.catch_up / self.rate_hz:  # more is lost than is caught up
            self._due_s = time.monotonic()
        with self._disarming():
            return self._state(*self._measured())

    @abstractmethod
    def _reached(self) -> _Measured:
        """Connect, check the device, measure.

        Raises InvalidInput, HardwareFault.
        """

    @abstractmethod
    def _switched_on(self) -> None:
        """Arm; ``stop`` is called where it does not come to its end."""

    @abstractmethod
    def _put(self, angles_rad: Array) -> Array:
        """Send these angles; return what was sent."""

    @abstractmethod
    def _measured(self) -> _Measured:
        """Angles, rates and torques, shape (J,) each."""

    def _label(self, index: int) -> str:
        """A joint as messages call it."""
        return self.joints[index]

    def _check_angles(self, angles: Array) -> None:
        can = self.capabilities
        beyond = (angles < can.lower_rad - _SLACK_RAD) | (angles > can.upper_rad + _SLACK_RAD)
        for index in np.flatnonzero(beyond):
            raise InvalidInput(
                f"{self._label(int(index))}: expected an angle in [{can.lower_rad[index]:.2f}, "
                f"{can.upper_rad[index]:.2f}] rad, measured {angles[index]:.2f}: {self.wrong}?"
            )

    @contextmanager
    def _disarming(self) -> Iterator[None]:
        """After a fault the world is not armed."""
        try:
            yield
        except HardwareFault:
            self.armed = False
            raise

    def _state(self, angles_rad: Array, rates_rad_s: Array, torques_nm: Array) -> State:
        """State that was measured, on the pose that is assumed."""
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
