"""Base of all terrains of courses in a file: friction, and the answer to a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from ..terrain.sole import checked_sole
from ..terrain.terrain import Terrain

if TYPE_CHECKING:
    from ..robot.model import Robot

MOST_PATCHES = 5000
ROOM_M = 0.002
"""Between a foot and what rises beside its surface [m]."""
Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0.0, le=LARGEST)]
Friction = Annotated[float, Field(ge=0.0, le=10.0)]
Point = tuple[Length, Length, Length]


def _sole(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    try:
        checked_sole(np.array(points).reshape(-1, 2), "")
    except InvalidInput as error:
        raise InvalidInput(str(error).removeprefix(": ")) from None
    return points


SolePoints = Annotated[list[tuple[Length, Length]], AfterValidator(_sole)]
"""Corners of a sole about its toe [m], see ``sole.checked_sole``."""


class TerrainSpec(BaseModel, ABC):
    """Base of all kinds of terrain: friction μ, and the answer to a path."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    friction: Friction = 1.0

    def for_robot(self, robot: Robot) -> Self:
        """The terrain with what follows the robot's feet."""
        return self

    @abstractmethod
    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The terrain along a path, shape (L, 3) [m].

        Arguments:
            folder: folder from which relative paths start.
        """
