"""The worlds that a plan can be run on, by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol, get_args

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot import Robot
from stancekit.planners.robot.urdf import Servo, joint_names

from . import WORLDS, make_world
from .world import World

RunWorldName = Literal["bullet", "mujoco", "replay", "dynamixel", "ros"]
RUN_WORLDS: tuple[RunWorldName, ...] = get_args(RunWorldName)
RATE_HZ = {"bullet": 200.0, "mujoco": 200.0, "dynamixel": 50.0, "ros": 50.0}
"""Targets a second, where nothing else is asked for."""


class MadeFor(Protocol):
    """What a course and a gait have in common."""

    @property
    def robot(self) -> Robot:
        """Who moves."""
        ...

    @property
    def gravity_m_s2(self) -> float:
        """What the world pulls with."""
        ...


def make_run_world(
    name: str, course: MadeFor, *, setup: Path | None = None, servo: Servo = Servo(), rate_hz: float | None = None
) -> World:
    """A world by name for a course's, or a gait's, robot.

    setup: the log of ``replay``, the calibration file of ``dynamixel``, the set-up file of ``ros``; others have none.
    Raises InvalidInput for an unknown name, a file that is missing or wrong, and a package that is not installed.
    """
    if name in WORLDS:
        if setup is not None:
            raise InvalidInput(f"setup: expected none with world {name}, got {setup}")
        rate = RATE_HZ[name] if rate_hz is None else rate_hz
        return make_world(name, course.robot, servo, rate_hz=rate, gravity_m_s2=course.gravity_m_s2)
    makers: dict[str, tuple[str, Callable[[Robot, Path, Servo, float | None], World]]] = {
        "replay": ("a log", _replay),
        "dynamixel": ("a calibration file", _dynamixel),
        "ros": ("a set-up file", _ros),
    }
    if name not in makers:
        raise InvalidInput(f"world: expected one of {', '.join(RUN_WORLDS)}, got {name!r}")
    told, make = makers[name]
    if setup is None:
        raise InvalidInput(f"setup: expected {told} with world {name}, got none")
    return make(course.robot, setup, servo, rate_hz)


def _replay(robot: Robot, path: Path, servo: Servo, rate_hz: float | None) -> World:
    from .replay import ReplayWorld

    if rate_hz is not None:
        raise InvalidInput("rate_hz: expected none with world replay: the log has its own")
    return ReplayWorld(path, robot, servo)


def _dynamixel(robot: Robot, path: Path, servo: Servo, rate_hz: float | None) -> World:
    from .dynamixel.calibration import Calibration
    from .dynamixel.driver import DynamixelWorld

    rate = RATE_HZ["dynamixel"] if rate_hz is None else rate_hz
    calibration = Calibration.from_yaml(path, joint_names(robot))
    _check_name(path, calibration.robot, robot)
    return DynamixelWorld(robot, calibration, servo, rate_hz=rate)


def _ros(robot: Robot, path: Path, servo: Servo, rate_hz: float | None) -> World:
    from .ros.driver import RosWorld
    from .ros.setup import RosSetup

    rate = RATE_HZ["ros"] if rate_hz is None else rate_hz
    setup = RosSetup.from_yaml(path, joint_names(robot))
    _check_name(path, setup.robot, robot)
    return RosWorld(robot, setup, servo, rate_hz=rate)


def _check_name(path: Path, name: str | None, robot: Robot) -> None:
    """Raise InvalidInput for a file of another robot."""
    if name not in (None, robot.name):
        raise InvalidInput(f"{path}: robot: expected {robot.name}, whom the plan is for, got {name}")
