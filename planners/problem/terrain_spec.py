"""What all terrains of courses share: patches, where toes may stand on them, and the answer to a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from ..terrain.patch import Patch
from ..terrain.sole import checked_sole

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


@dataclass(frozen=True)
class Terrain:
    """Every patch there is, in order, and which of them a toe may stand on (risers, for one, are only in the way).

    footholds: where toes may stand instead, pieces of the patches that keep ``inset_m`` from their borders [m].
    """

    patches: tuple[Patch, ...]
    footing: tuple[bool, ...]
    footholds: tuple[Patch, ...] | None = None
    inset_m: float = 0.0

    @property
    def standing(self) -> tuple[tuple[str, Patch], ...]:
        """What toes may stand on, each with what it is called."""
        if self.footholds is not None:
            return tuple((f"foothold {i}", patch) for i, patch in enumerate(self.footholds))
        return tuple((f"terrain patch {i}", self.patches[i]) for i, footing in enumerate(self.footing) if footing)


class TerrainSpec(BaseModel, ABC):
    """What all kinds of terrain share: friction μ, and the answer to a path."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    friction: Friction = 1.0

    @abstractmethod
    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The terrain along a path, shape (L, 3) [m]; folder: where relative paths of files begin."""
