"""Base of real robots: joints receive angles every period, and their angles are measured."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.robot_file import Servo, joint_names

from .drives import Drives
from .settings import WorldSettings
from .world import LatchedWorld, State, Terrain, World, WorldCapabilities, WorldKind


class NullWorld(LatchedWorld):
    """In place of a world that was reset: no command goes through.

    Its joints are where they would have been sent.

    Arguments:
        first: what the world measured. The body is where it was, and its feet feel nothing. The
            latch is the world's.
    """

    def __init__(self, world: World, first: State) -> None:
        self.latch, self.name, self.robot, self.servo = (
            world.latch,
            world.name,
            world.robot,
            world.servo,
        )
        self.joints, self.rate_hz = world.joints, world.rate_hz
        self._state = replace(first, sent_rad=np.array(first.angles_rad))
        self.steps = 0

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Return the measured state; nothing is asked again."""
        return self._state

    def step(self, targets_rad: Array) -> State:
        """Send nothing; the joints are at the targets, shape (J,) [rad]."""
        with self.latch.sending():
            self.steps += 1
        before, period_s = self._state, 1.0 / self.rate_hz
        self._state = replace(
            before,
            time_s=before.time_s + period_s,
            angles_rad=np.array(targets_rad, dtype=float),
            rates_rad_s=(np.asarray(targets_rad, dtype=float) - before.angles_rad) / period_s,
            sent_rad=np.array(targets_rad, dtype=float),
        )
        return self._state

    def close(self) -> None:
        """Nothing is held."""


class ReplayWorld(LatchedWorld):
    """The measurements of a log, one a step.

    Nothing moves; commands are compared with those of the log.

    worst_rad: largest difference between a command and what was sent at that step of the log.
    Raises InvalidInput for a log of another robot.
    """

    kind: WorldKind = "recording"
    name = "replay"

    def __init__(self, path: str | Path, robot: Robot, servo: Servo | None = None) -> None:
        from ..log import LOADED, read_log, state_from_json, table

        super().__init__()
        servo = servo or robot.servo
        recorded = read_log(path)
        plan: dict[str, Any] = recorded.of("plan")[0]
        self.robot, self.servo, self.rate_hz = robot, servo, _rate(plan["rate_hz"], path)
        self.joints = joint_names(robot)
        if tuple(plan["joints"]) != self.joints:
            raise InvalidInput(
                f"{path}: expected a log of a robot with joints {self.joints[0]} …, got another's"
            )
        self.digest, self.whole = str(plan["digest"]), recorded.whole
        self._states = [
            state_from_json(each, f"{path}: measurement") for each in recorded.of("measurement")
        ]
        count = len(self.joints)
        self._sent = [
            table(each["sent_rad"], (count,), f"{path}: sent_rad")
            for each in recorded.of("command")
        ]
        for state in self._states:
            shapes = (
                state.angles_rad.shape,
                state.torques_nm.shape,
                state.forces_n.shape,
                state.position_m.shape,
            )
            if shapes != ((count,), (count,), (len(robot.limbs), 3), (3,)):
                names = ("angles_rad", "torques_nm", "forces_n", "position_m")
                came = ", ".join(
                    f"{name} {shape}" for name, shape in zip(names, shapes, strict=True)
                )
                raise InvalidInput(
                    f"{path}: measurement: expected arrays for {count} joints and "
                    f"{len(robot.limbs)} "
                    f"limbs, got the shapes {came}"
                )
        if not self._states:
            raise InvalidInput(
                f"{path}: expected measurements, got none: the run ended before it began"
            )
        self.drives = _loops(plan, Drives.of(robot.source.legs(servo)), path)
        self._sees = bool(plan.get("sees", True))
        self._preloaded = any(each["what"] == LOADED for each in recorded.of("decision"))
        self._row = 0
        self.worst_rad = 0.0
        self.capabilities = WorldCapabilities.of_drives(
            self.drives, self.rate_hz, senses=self._sees
        )

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``WorldClass``."""
        path = settings.file("a log", cls.name)
        if settings.rate_hz is not None:
            raise InvalidInput("rate_hz: expected none with world replay: the log has its own")
        return cls(path, settings.robot, settings.servo)

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """The first measurement of the log."""
        self._row, self.worst_rad = 0, 0.0
        return self._states[0]

    def preload(self, targets_rad: Array) -> bool:
        """Tell whether the world of the log was loaded at once."""
        return self._preloaded

    def step(self, targets_rad: Array) -> State:
        """The next measurement.

        Raises HardwareFault where the log ends.
        """
        self._row += 1
        if self._row >= len(self._states) or self._row > len(self._sent):
            raise HardwareFault(f"replay: the log ends after {self._row - 1} commands")
        away = float(np.abs(np.asarray(targets_rad) - self._sent[self._row - 1]).max())
        with self.latch.sending():
            self.worst_rad = max(self.worst_rad, away)
        return self._states[self._row]

    def close(self) -> None:
        """Nothing is held."""


def _loops(plan: Mapping[str, Any], drives: Drives, path: str | Path) -> Drives:
    """The loops that the log was sent to.

    Raises InvalidInput for a log that does not say.
    """
    from ..log import table

    names = ("stiffness_nm_rad", "damping_nms_rad", "rotor_kg_m2")
    stiffness, damping, rotor = (
        table(plan.get(name), (len(drives.joints),), f"{path}: {name}") for name in names
    )
    if not (stiffness > 0.0).all():
        raise InvalidInput(f"{path}: stiffness_nm_rad: expected numbers above 0, got others")
    return replace(
        drives,
        stiffness_nm_rad=stiffness,
        damping_nms_rad=damping,
        rotor_kg_m2=rotor,
        yields=bool(plan.get("yields", True)),
    )


def _rate(value: float, path: str | Path) -> float:
    if not 1.0 <= value <= 1000.0:
        raise InvalidInput(f"{path}: rate_hz: expected 1 to 1000, got {value:g}")
    return float(value)


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

    def _limits(self, drives: Drives) -> WorldCapabilities:
        """Limits of these drives, at joints that turn no faster than the robot's file allows."""
        can = WorldCapabilities.of_drives(drives, self.rate_hz, senses=False)
        own = self._kinematics.velocity_rad_s
        slower = np.where(own > 0.0, own, np.inf)
        return replace(can, velocity_rad_s=np.minimum(can.velocity_rad_s, slower))

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
