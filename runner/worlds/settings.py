"""Settings and parts of a world."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from stancekit.planners.errors import InvalidInput
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.actuators import Actuators
from stancekit.planners.robot.robot_file import Servo

from .contact import SoftContact
from .drives import Imperfections

EstopCheck = Literal["heard", "try", "without"]
"""Way in which an e-stop is known to work before a robot is armed: it, or its publisher, is there;
it is pressed and released; or it is not asked for."""


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Settings that every back end takes.

    Arguments:
        robot: who moves.
        servo: of its drawn-up legs; the robot's own where None is given.
        gravity_m_s2: what pulls.
        rate_hz: targets a second, None for what is usual in that world.
        setup: the file that a world is made from, None where none was given.
        imperfections: of a simulated robot.
        contact: ground of a simulation that yields, None for hard ground.
        actuators: what turns its joints, None for what the robot's file, or the device's, says.
        estop: how an e-stop that the set-up file names is known to work before the robot is armed.
    """

    robot: Robot
    servo: Servo | None = None
    gravity_m_s2: float = GRAVITY_M_S2
    rate_hz: float | None = None
    setup: Path | None = None
    imperfections: Imperfections = field(default_factory=Imperfections)
    contact: SoftContact | None = None
    actuators: Actuators | None = None
    estop: EstopCheck = "heard"

    def __post_init__(self) -> None:
        object.__setattr__(self, "servo", self.servo or self.robot.servo)

    def file(self, content: str, world: str) -> Path:
        """The set-up file.

        Raises InvalidInput, which says what should be in it, where there is none.
        """
        if self.setup is None:
            raise InvalidInput(f"setup: expected {content} with world {world}, got none")
        return self.setup

    def check_name(self, robot: str | None) -> None:
        """Raise InvalidInput for a set-up file of another robot; None says nothing."""
        if robot not in (None, self.robot.name):
            raise InvalidInput(
                f"{self.setup}: robot: expected {self.robot.name}, whom the plan is for, got "
                f"{robot}"
            )
