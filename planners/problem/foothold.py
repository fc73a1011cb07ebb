"""Footholds and stances: toes put down, and limbs that carry the robot alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..files.codec import LATER
from ..terrain.patch import Patch


@dataclass(frozen=True, kw_only=True, eq=False)
class Foothold:
    """One toe put down: by ``limb``, at key frame ``frame``, on one of the candidates.

    Arguments:
        toe_m: position of a toe that stands already, shape (3,) [m]; None if the planner chooses.
        candidates: patches to choose from, at least one; a toe that already stands has exactly one,
            the surface under it.
        yaws_rad: yaw angle of a sole on each candidate [rad]; () for 0. The same patch with several
            yaws is several candidates. toe_m of a sole is its centre.
        force_min, force_max: bounds on (f_n, f_y, f_z) there, in units of the problem's force
            scale, shape (3,); None for those of the problem.
    """

    limb: str
    frame: int
    toe_m: Array | None = None
    candidates: tuple[Patch, ...]
    yaws_rad: tuple[float, ...] = field(default=(), metadata=LATER)
    force_min: Array | None = field(default=None, metadata=LATER)
    force_max: Array | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        where = f"frame {self.frame}, limb {self.limb}"
        if len(self.yaws_rad):
            yaws = read_only(self.yaws_rad, (None,), f"{where}: yaws_rad")
            if len(yaws) != len(self.candidates):
                raise InvalidInput(
                    f"{where}: yaws_rad: expected {len(self.candidates)}, one a candidate, got "
                    f"{len(yaws)}"
                )
            object.__setattr__(self, "yaws_rad", tuple(yaws.tolist()))
        if not self.candidates:
            raise InvalidInput(
                f"{where}: expected one or more candidate patches, got none within reach"
            )
        object.__setattr__(self, "candidates", tuple(self.candidates))
        if self.toe_m is not None:
            object.__setattr__(self, "toe_m", read_only(self.toe_m, (3,), f"{where}: toe_m"))
            if len(self.candidates) != 1:
                raise InvalidInput(
                    f"{where}: expected one patch under a toe that stands, got "
                    f"{len(self.candidates)}"
                )
        if self.force_min is None and self.force_max is None:
            return
        if self.force_min is None or self.force_max is None:
            raise InvalidInput(
                f"{where}: force_min, force_max: expected both or none, got one of them"
            )
        low, high = (
            read_only(getattr(self, each), (3,), f"{where}: {each}")
            for each in ("force_min", "force_max")
        )
        if np.any(low > high):
            raise InvalidInput(
                f"{where}: force_min: expected at most force_max {high.tolist()}, got "
                f"{low.tolist()}"
            )
        object.__setattr__(self, "force_min", low)
        object.__setattr__(self, "force_max", high)


@dataclass(frozen=True)
class Stance:
    """Limbs that carry the robot alone at a key frame, by index, in the robot's order."""

    frame: int
    limbs: tuple[int, ...]
