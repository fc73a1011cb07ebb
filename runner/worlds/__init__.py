"""Worlds: where a plan is executed."""

from __future__ import annotations

from typing import Literal, get_args

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.posture import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.urdf import Servo

from .world import State, World

__all__ = ["WORLDS", "State", "World", "WorldName", "make_world"]

WorldName = Literal["bullet", "mujoco"]
WORLDS: tuple[WorldName, ...] = get_args(WorldName)


def make_world(
    name: str,
    robot: Robot,
    servo: Servo = Servo(),
    *,
    rate_hz: float = 200.0,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> World:
    """A world by name, with one robot in it.

    rate_hz: how often targets are sent. Raises InvalidInput for an unknown name, or where its simulator is not
    installed.
    """
    if name == "bullet":
        from .bullet import BulletWorld

        return BulletWorld(robot, servo, rate_hz=rate_hz, gravity_m_s2=gravity_m_s2)
    if name == "mujoco":
        from .mujoco import MujocoWorld

        return MujocoWorld(robot, servo, rate_hz=rate_hz, gravity_m_s2=gravity_m_s2)
    raise InvalidInput(f"world: expected one of {', '.join(WORLDS)}, got {name!r}")
