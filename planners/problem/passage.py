"""A passage: can a robot get from one place over a terrain to another, however it goes?

A course lays out key frames, a gait and candidates; a passage leaves all of that open, and is what a
person asks who gives a terrain, a start and a goal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..files.arrays import Array, checked, checked_members, read_only
from ..files.codec import fields_to_json, from_json
from ..robot.model import Robot
from ..terrain.patch import Patch

NEAR = 0.2
NEAREST_M = 0.06
"""Distance from start and goal at which a robot is there, in reaches of its feet from its centre of
mass, and the least one of a robot of size 1 [m]: a plan's last key frame may be so far from the
goal."""


def near_of(robot: Robot) -> float:
    """Horizontal distance from a place within which a robot's centre of mass is there [m]."""
    far = max(float(np.linalg.norm(limb.shoulder_m)) + limb.reach_m for limb in robot.limbs)
    return max(NEAR * far, NEAREST_M * robot.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage:
    """A robot, a terrain, and two places.

    Arguments:
        name: of the terrain.
        robot: who goes.
        terrain: every surface there is.
        footholds: surfaces on which feet may stand.
        start_m, goal_m: places of the centre of mass, shape (2,) [m].
        near_m: horizontal distance within which it is there [m].

    Raises:
        InvalidInput: for a wrong shape, and numbers out of range.
    """

    FORMAT: ClassVar = "stancekit/passage/1"

    name: str
    robot: Robot
    terrain: tuple[Patch, ...]
    footholds: tuple[Patch, ...]
    start_m: Array
    goal_m: Array
    near_m: float

    def __post_init__(self) -> None:
        for name in ("terrain", "footholds"):
            object.__setattr__(self, name, checked_members(getattr(self, name), Patch, name))
        for name in ("start_m", "goal_m"):
            object.__setattr__(self, name, read_only(getattr(self, name), (2,), name))
        object.__setattr__(self, "near_m", checked(self.near_m, "near_m", least=0.0))

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return fields_to_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Passage:
        """Read what ``to_json`` wrote.

        Raises InvalidInput.
        """
        return from_json(cls, data)
