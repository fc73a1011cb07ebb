"""What is asked of a walk: every chart's solution answers it, in the world frame and dense, and says
nothing of how it was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput, located
from ..files.arrays import Array
from ..files.writing import first_difference
from .motion import Motion, held, left_unchecked

if TYPE_CHECKING:
    from ..robot.model import Robot
    from ..terrain.heightfield import HeightField

OFF_M = 0.015
"""Distance from its place at which a foot may come down, and should hold all the same [m]."""
STEP_S = 0.005
"""Spacing of the samples that charts give: ten times finer than the optimiser's default grid."""
WALK_BODY = ("joints", "joint_speed", "torque", "legs_moment", "bodies")
"""The groups of a walk that ask for a model of the robot's legs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkQuestion:
    """What is asked of a walk, whatever planner it is for.

    Arguments:
        robot, terrain: what walks, and where.
        friction: ν of W5.
        adhesive: feet without a friction cone, shape (E,), bool.
        start, goal: where the torso has to begin and to end, shape (2,) [m].
        heading_rad: required heading at the start, from x towards y [rad]; None where nothing is
            asked.
        heading_end_rad: the same at the end.
        still: whether it has to be at rest at the start, and at the end.
        suction_n: what an adhesive foot may pull with [N]: its cone begins at that pull; None for
            no bound.

    Raises:
        InvalidInput: for values that are no arrays of numbers.
    Source:
        Pan et al. §III, W2-W7.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> walk = stancekit.Walk.over(level, (0.2, 0.0))
        >>> asked = stancekit.WalkQuestion(robot=walk.robot, terrain=level, friction=0.7, adhesive=walk.adhesive,
        ...                                start=walk.start, goal=walk.goal)
        >>> asked.goal.tolist(), asked.still
        ([0.2, 0.0], (False, False))
    """

    FORMAT: ClassVar[str] = "stancekit/walk/1"
    word: ClassVar[str] = "gait"
    counts: ClassVar[str] = "s"
    robot: Robot
    terrain: HeightField
    friction: float
    adhesive: NDArray[np.bool_]
    start: Array
    goal: Array
    heading_rad: float | None = None
    heading_end_rad: float | None = None
    still: tuple[bool, bool] = (False, False)
    suction_n: float | None = None

    def __post_init__(self) -> None:
        held(self, np.float64, "start", "goal")
        held(self, np.bool_, "adhesive")
        for name in ("friction", "heading_rad", "heading_end_rad", "suction_n"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else float(value))
        start, end = self.still
        object.__setattr__(self, "still", (bool(start), bool(end)))

    @property
    def name(self) -> str:
        """Name of the terrain."""
        return self.terrain.name or "gait"

    def to_json(self) -> dict[str, Any]:
        """The walk as JSON-ready values; the heights of its terrain are among the arrays."""
        told = {each.name: getattr(self, each.name) for each in fields(self)}
        told |= {name: told[name].tolist() for name in ("adhesive", "start", "goal")}
        told |= {"robot": self.robot.to_json(), "terrain": self.terrain.name}
        told |= {"doubts": list(self.terrain.doubts)} if self.terrain.doubts else {}
        return {"format": self.FORMAT, **told, "still": list(self.still)}

    def columns(self, rows: int = 0) -> dict[str, tuple[int, ...]]:
        """The shape of each array of a walk of so many samples, by name."""
        feet = len(self.robot.feet)
        return {
            "times_s": (rows,),
            "torso_m": (rows, 3),
            "rotation": (rows, 3, 3),
            "feet_m": (rows, feet, 3),
            "forces_n": (rows, feet, 3),
            "contact": (rows, feet),
        }

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no world can execute a walk; empty if some can.

        For a robot without a model the groups of ``WALK_BODY`` do not matter: the runner takes the
        servos of the world.
        """
        from ..robot.model import walking_robot  # slow to import

        left = [name for name in unchecked if self.robot.own or name not in WALK_BODY]
        if left:
            return left_unchecked(left)
        if self.adhesive.any():
            names = np.array(self.robot.limb_names)[self.adhesive]
            return f"no world has feet that stick, as {', '.join(names)} do"
        try:
            walking_robot(self.robot)
        except InvalidInput as error:
            return str(error)
        return ""


Trajectory = Motion[WalkQuestion]


def robot_from_json(data: Any) -> Robot:
    """Read the robot of a walk.

    Raises InvalidInput, also for one that is called as a built-in one and is another.
    """
    from ..robot.walker import BUILT_IN, walker_from_json

    with located("robot"):
        robot = walker_from_json(data)
        if robot.own or robot.name not in BUILT_IN:
            return robot
        expected = replace(BUILT_IN[robot.name](), model=None).to_json()
        if other := first_difference(robot.to_json(), expected):
            raise InvalidInput(
                f"expected the numbers of the built-in {robot.name}, got other values: {other}"
            )
    return robot
