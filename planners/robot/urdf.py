"""The robot as a URDF, made from the numbers that planners know: planned, checked and simulated is
one robot.
"""

from __future__ import annotations

from ..errors import InvalidInput
from .drawn_legs import drawn_urdf
from .model import Robot
from .servo import FOOT_RADIUS_M, JOINTS, Servo

__all__ = ["FOOT_RADIUS_M", "JOINTS", "Servo", "hexapod_urdf", "joint_names"]


def joint_names(robot: Robot) -> tuple[str, ...]:
    """Names of all joints, limb by limb in the robot's order, from the base outward, e.g.
    ``LF_yaw``; none where no legs are known.
    """
    return robot.source.joint_names


def hexapod_urdf(robot: Robot, servo: Servo | None = None, *, rotors_in_links: bool = False) -> str:
    """The URDF of a robot with any number of limbs, see ``drawn_urdf``.

    Arguments:
        servo: drive of every joint, in place of the robot's own.

    Raises:
        InvalidInput: also for a robot with its own legs.
    """
    if robot.source.own:
        raise InvalidInput(
            f"robot {robot.name}: expected a robot whose legs are to be drawn up, got one with "
            "legs of its file"
        )
    return drawn_urdf(
        robot.name,
        robot.mass_kg,
        robot.limbs,
        servo or robot.servo,
        rotors_in_links=rotors_in_links,
    )
