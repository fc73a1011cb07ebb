"""One limb of a robot: where it begins, how far it reaches, and what a leg that leaps can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_name, read_only
from ..files.codec import LATER, UNWRITTEN
from ..terrain.sole import checked_sole
from .reach import ReachRows


@dataclass(frozen=True, kw_only=True, eq=False)
class LegLimits:
    """Limits of a leg that moves fast, for leaps.

    Arguments:
        hip_m: p_BH, where the leg begins in the body frame, shape (3,) [m].
        speed_m_s: largest rate at which hip and toe move apart or together [m/s].
        power_w: largest power at the toe, either way [W].
        fold_m: least distance of hip and toe [m].

    Raises:
        InvalidInput: for numbers out of range.
    """

    hip_m: Array
    speed_m_s: float = field(default=math.inf, metadata=LATER)
    power_w: float = field(default=math.inf, metadata=LATER)
    fold_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "hip_m", read_only(self.hip_m, (3,), "leg: hip_m"))
        for name in ("speed_m_s", "power_w"):
            value = getattr(self, name)
            if value != math.inf:
                object.__setattr__(self, name, checked(value, f"leg: {name}", above=0.0))
        object.__setattr__(self, "fold_m", checked(self.fold_m, "leg: fold_m", least=0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Limb:
    """One limb: its shoulder in the body frame (Lin et al.'s v, E11) and the radius of its
    spherical workspace.

    Arguments:
        name: a word.
        shoulder_m: p_BS, position of the shoulder in the body frame, shape (3,) [m].
        reach_m: Δ_FK of E11, radius of the workspace about the shoulder [m].
        reach_rows: half-spaces that hold the toe, in addition to the ball; to have them alone, set
            reach_m to the radius of a ball that contains them.
        sole_m: points (forward, left) of a rigid flat foot about its centre, shape (K, 2) [m]; None
            for a point foot. Reach and steps refer to the centre.
        hip_m: place where the leg begins in the body frame, shape (3,) [m]; a surface must face it
            to be a foothold. None for the shoulder, which for a leg from a file is the centre of a
            ball and may be below the ground.
        leg: limits of its speed, power and length, which leaps need; None if they are not known.

    Raises:
        InvalidInput: for another name, a wrong shape, a reach that is not positive.
    Source:
        Lin et al. §II, E11.

    Example:
        >>> from stancekit import Limb
        >>> Limb(name="LF", shoulder_m=[0.2, 0.1, 0.0], reach_m=0.4).shoulder_m.shape
        (3,)
    """

    name: str
    shoulder_m: Array
    reach_m: float
    reach_rows: ReachRows | None = field(default=None, metadata=LATER)
    sole_m: Array | None = field(default=None, metadata=LATER)
    leg: LegLimits | None = field(default=None, metadata=LATER)
    hip_m: Array | None = field(default=None, metadata=UNWRITTEN)

    def __post_init__(self) -> None:
        checked_name(self.name, "limb name")
        object.__setattr__(
            self, "shoulder_m", read_only(self.shoulder_m, (3,), f"limb {self.name}: shoulder_m")
        )
        object.__setattr__(
            self, "reach_m", checked(self.reach_m, f"limb {self.name}: reach_m", above=0.0)
        )
        if self.sole_m is not None:
            object.__setattr__(
                self, "sole_m", checked_sole(self.sole_m, f"limb {self.name}: sole_m")
            )
        if self.hip_m is not None:
            object.__setattr__(
                self, "hip_m", read_only(self.hip_m, (3,), f"limb {self.name}: hip_m")
            )

    def hip_at(self, shoulder_m: Array) -> Array:
        """Place where the leg begins when its shoulder is here, shape (3,) [m]."""
        return (
            shoulder_m
            if self.hip_m is None
            else np.asarray(shoulder_m + self.hip_m - self.shoulder_m)
        )


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


_LARGEST_HALF_M = 5.0
"""Half a side of the largest trunk: its face is sampled, and what is longer is a mistake in units
[m]."""


def half_sides(value: Any, where: str) -> Array:
    """Half sides of a box, above 0 and up to what a robot may have, shape (3,) [m]."""
    sides = read_only(value, (3,), where)
    if not np.all((sides > 0.0) & (sides <= _LARGEST_HALF_M)):
        wanted = f"sides above 0 and up to {_LARGEST_HALF_M:g} m"
        raise InvalidInput(f"{where}: expected {wanted}, got {sides.tolist()}")
    return sides
