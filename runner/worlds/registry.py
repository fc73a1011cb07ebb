"""Worlds by name: each is one file, and its line in the table of ``WORLDS``.

Other packages register theirs as entry points of the group ``stancekit.worlds``; a file of one's
own needs no registration: its world is called ``FILE.py:NAME``. See ``WorldClass`` for what it must
have.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol, get_args

from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.plugins import Registry
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo

from .contact import SoftContact
from .drives import Imperfections
from .settings import WorldSettings
from .world import State, World, WorldKind

__all__ = [
    "WORLDS",
    "Imperfections",
    "SoftContact",
    "State",
    "World",
    "WorldClass",
    "WorldSettings",
    "make_world",
]


class WorldClass(Protocol):
    """The class of a world, as it is registered.

    Subclasses of ``SimulatedWorld`` have all that but physics.

    Arguments:
        kind: what is of "hardware" has the methods torque, hold and relax, too (``world.Actuator``):
            nothing real moves unless it was armed.
    """

    kind: WorldKind

    def make(self, settings: WorldSettings) -> World:
        """A world.

        Raises InvalidInput for a rate or a file that it does not take, and for a package that is
        not installed; nothing is sent to anything.
        """
        ...


def _is_world_class(thing: Any) -> bool:
    kind = getattr(thing, "kind", None)
    methods = (
        "make",
        "reset",
        "step",
        "close",
        *(("torque", "hold", "relax") if kind == "hardware" else ()),
    )
    return kind in get_args(WorldKind) and all(
        callable(getattr(thing, method, None)) for method in methods
    )


WORLDS: Registry[WorldClass] = Registry(
    "world",
    "stancekit.worlds",
    {
        "bullet": "stancekit.runner.worlds.bullet:BulletWorld",
        "mujoco": "stancekit.runner.worlds.mujoco:MujocoWorld",
        "replay": "stancekit.runner.worlds.replay:ReplayWorld",
        "dynamixel": "stancekit.runner.worlds.dynamixel.driver:DynamixelWorld",
        "ros": "stancekit.runner.worlds.ros.driver:RosWorld",
    },
    expected="a world (kind, make, reset, step, close; of hardware torque, hold and relax, too)",
    accepts=_is_world_class,
)


def make_world(
    name: str,
    robot: Robot,
    servo: Servo | None = None,
    *,
    rate_hz: float | None = None,
    gravity_m_s2: float = GRAVITY_M_S2,
    setup: str | Path | None = None,
    imperfections: Imperfections = Imperfections(),
    actuators: Actuators | None = None,
    contact: SoftContact | None = None,
) -> World:
    """Make a world, with one robot in it.

    Arguments:
        name: of ``WORLDS``, or FILE.py:NAME.
        servo: of drawn-up legs, in place of the robot's own.
        rate_hz: targets a second, the world's own where None.
        setup: the log of ``replay``, the calibration file of ``dynamixel``, the set-up file of
            ``ros``, ground that yields in simulations.
        imperfections: of a simulated robot.
        actuators: what turns its joints, None for what its file, or the device's, says.
        contact: ground of a simulation that yields, None for hard ground, unless the set-up file
            says otherwise.

    Raises:
        InvalidInput: for an unknown name, a file that is missing or wrong, and a package that is
            not installed.
    """
    settings = WorldSettings(
        robot=robot,
        servo=servo,
        rate_hz=rate_hz,
        gravity_m_s2=gravity_m_s2,
        setup=None if setup is None else Path(setup),
        imperfections=imperfections,
        actuators=actuators,
        contact=contact,
    )
    return WORLDS.get(name).make(settings)
