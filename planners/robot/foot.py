"""Feet of a robot that walks: where they stand, and the boxes that they reach (Pan et al. §III-A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked_name, read_only
from .limb import LegLimits, Limb
from .reach import ReachRows


@dataclass(frozen=True, kw_only=True, eq=False)
class Foot:
    """One foot: where it stands by default and the box R_i that it can reach (W4).

    All in the torso's frame, whose origin is the centre of mass, shape (3,) [m]: nominal_m inside
    the box from reach_min_m to reach_max_m.

    Arguments:
        hip_m: place where its leg begins.
    """

    name: str
    nominal_m: Array
    reach_min_m: Array
    reach_max_m: Array
    hip_m: Array

    def __post_init__(self) -> None:
        checked_name(self.name, "name")
        for name in ("nominal_m", "reach_min_m", "reach_max_m", "hip_m"):
            object.__setattr__(
                self, name, read_only(getattr(self, name), (3,), f"foot {self.name}: {name}")
            )
        if not np.all((self.reach_min_m < self.nominal_m) & (self.nominal_m < self.reach_max_m)):
            raise InvalidInput(
                f"foot {self.name}: expected reach_min_m < nominal_m < reach_max_m, got "
                f"{self.reach_min_m.tolist()}, "
                f"{self.nominal_m.tolist()}, {self.reach_max_m.tolist()}"
            )

    @property
    def limb(self) -> Limb:
        """The foot as a limb: its box as half-spaces, and the ball about the box."""
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        bounds = np.concatenate([self.reach_max_m, -self.reach_min_m])
        return Limb(
            name=self.name,
            shoulder_m=0.5 * (self.reach_max_m + self.reach_min_m),
            reach_m=float(np.linalg.norm(0.5 * (self.reach_max_m - self.reach_min_m))),
            reach_rows=ReachRows(normals=normals, bounds_m=bounds),
            leg=LegLimits(hip_m=self.hip_m),
        )


def half_sides(value: Any, where: str) -> Array:
    """Half sides of a box, all above 0, shape (3,) [m]."""
    sides = read_only(value, (3,), where)
    if not np.all(sides > 0.0):
        raise InvalidInput(f"{where}: expected sides above 0 m, got {sides.tolist()}")
    return sides
