"""Interface of a world: joints under position control on a terrain, one control period a step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Protocol, Self, runtime_checkable

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Ground as Ground
from stancekit.planners.terrain.patch import Solid

from ..safety.latch import StopLatch


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """State of a world after a control period; J joints, N limbs.

    Arguments:
        time_s: since the reset.
        position_m, rotation: of the body's frame in the world, shape (3,), (3, 3).
        velocity: linear [m/s] and angular [rad/s], world frame, shape (6,).
        angles_rad, rates_rad_s, torques_nm: of the joints, shape (J,).
        feet_m: centres of the feet, shape (N, 3).
        forces_n: contact forces on the feet, world frame, mean over the period, shape (N, 3) [N].
        bump_n: mean force of the terrain on anything but feet, and of the robot's links on each
            other [N].
        sent_rad: the targets that were really sent, after limits, shape (J,).
    """

    time_s: float
    position_m: Array
    rotation: Array
    velocity: Array
    angles_rad: Array
    rates_rad_s: Array
    torques_nm: Array
    feet_m: Array
    forces_n: Array
    bump_n: float
    sent_rad: Array


Solids = Sequence[Solid | Ground]
"""Solids that have a ``distance``."""
Terrain = Sequence[Patch] | Ground
"""Flat patches, each a solid body behind its surface; or heights."""
WorldKind = Literal["simulation", "recording", "hardware"]
"""Whether a world computes what happens, repeats what happened, or moves something real."""


class World(Protocol):
    """Three methods, and what it can do.

    A context manager; ``reset`` may be called again. A world may have besides: ``capabilities``
    (``WorldCapabilities``), ``drives`` (``Drives``), ``preload(targets_rad)``, which says whether
    joints can begin loaded, ``carry(wrench)``, which a simulated body bears beside its weight,
    ``beat``, which it calls while it waits for a device, ``evidence`` of its e-stop, and
    ``pending``, which names what may still move the robot after ``hold``, in words.

    Arguments:
        kind: what is of "hardware" is an ``Actuator``, too, and moves only when armed.
        latch: what it sends to the robot goes through ``latch.sending()``; tripped, it sends
            nothing any more.
    """

    kind: WorldKind
    name: str
    latch: StopLatch
    robot: Robot
    servo: Servo
    joints: tuple[str, ...]
    rate_hz: float

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        ...

    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""
        ...

    def close(self) -> None:
        """Give everything back; once is enough."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@runtime_checkable
class Stoppable(Protocol):
    """A world that can be left in a state: standing as it is, or without torque."""

    def hold(self) -> None:
        """Send nothing any more; the joints keep what they were told last.

        Where an arming was interrupted, it makes sure that the torque is as it was before, or
        raises HardwareFault.
        """
        ...

    def relax(self) -> None:
        """Torque off everywhere."""
        ...


@runtime_checkable
class Actuator(Stoppable, Protocol):
    """A world that moves something real: it takes no step unless armed."""

    armed: bool

    def torque(self, on: bool) -> None:
        """Arm, at the measured pose; or let go.

        An arming that is interrupted, by whatever it raises, leaves no torque on that was off
        before.
        """
        ...


class LatchedWorld(ABC):
    """Base of the worlds here: a latch, and that they close at the end of a ``with`` block.

    Arguments:
        kind: "hardware" unless a world says that it is not.
    """

    kind: WorldKind = "hardware"

    def __init__(self) -> None:
        self.latch = StopLatch()

    @abstractmethod
    def close(self) -> None:
        """Give everything back; once is enough."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
