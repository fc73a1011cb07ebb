"""Feet of a robot that walks: where they stand, and the boxes that they reach (Pan et al. §III-A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_name, collect_errors, read_only
from .limb import LegLimits, Limb
from .reach import ReachRows

if TYPE_CHECKING:
    from .model import Robot
    from .robot_model import RobotModel

SAME = 1e-6
"""A walking robot's numbers may differ by so much of them from those of its model: rounding."""
NEAR = 0.05
"""Share of a robot's height by which its feet may be elsewhere, on the mean."""
DEEPEST = 0.5
"""How deep a robot may crouch, as a share of its height."""


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
                f"foot {self.name}: expected reach_min_m < nominal_m < reach_max_m, got {self.reach_min_m.tolist()}, "
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


def check_feet(robot: Robot) -> None:
    """Raise InvalidInput for a robot whose feet, height and trunk are not those of one that walks."""
    where = f"robot {robot.name}"
    set_field = object.__setattr__
    if robot.inertia_kgm2 is None:
        raise InvalidInput(f"{where}: inertia_kgm2: expected that of a robot that walks, got none")
    inertia = robot.inertia_kgm2
    collect_errors(
        lambda: set_field(
            robot,
            "stand_height_m",
            checked(robot.stand_height_m, f"{where}: stand_height_m", above=0.0),
        ),
        lambda: set_field(
            robot, "trunk_half_m", half_sides(robot.trunk_half_m, f"{where}: trunk_half_m")
        ),
    )
    names = [foot.name for foot in robot.feet]
    if len(names) < 3 or len(set(names)) != len(names):
        raise InvalidInput(f"{where}: expected three or more feet of different names, got {names}")
    if robot.source.own:
        _check_model(robot, inertia, robot.source.own_model(), where)
    _check_numbers(robot, inertia, where)


def _check_model(robot: Robot, inertia: Array, model: RobotModel, where: str) -> None:
    """Raise InvalidInput for numbers that are not its model's.

    It may stand lower, crouched, and not higher.
    """
    mass_kg, expected = model.body.mass_kg, model.body.inertia_kgm2
    if abs(robot.mass_kg - mass_kg) > SAME * mass_kg:
        raise InvalidInput(
            f"{where}: expected the mass of its model, {mass_kg:.8g} kg, got {robot.mass_kg:.8g}"
        )
    if not float(np.abs(inertia - expected).max()) <= SAME * float(np.abs(expected).max()):
        raise InvalidInput(
            f"{where}: expected the inertia of its model as it stands, got another one"
        )
    low_m, high_m = (1.0 - DEEPEST) * model.stand_height_m, model.stand_height_m
    if not (1.0 - SAME) * low_m <= robot.stand_height_m <= (1.0 + SAME) * high_m:
        raise InvalidInput(
            f"{where}: expected to stand as high as its model, {high_m:.6g} m, or crouched down to {low_m:.6g} m, "
            f"got {robot.stand_height_m:.6g}"
        )


def _check_numbers(robot: Robot, inertia: Array, where: str) -> None:
    """Raise InvalidInput for a height at which its feet do not stand, and for an inertia that
    no mass within it has: tolerances of the verifier are in units of both.
    """
    stands_m = -float(np.mean([foot.nominal_m[2] for foot in robot.feet]))
    if not abs(robot.stand_height_m - stands_m) <= NEAR * abs(stands_m):
        raise InvalidInput(
            f"{where}: stand_height_m: expected {stands_m:.6g} m, which its feet are below its centre of mass, got "
            f"{robot.stand_height_m:.6g}"
        )
    corners = [
        np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m)) for foot in robot.feet
    ]
    most = robot.mass_kg * max(float(corner @ corner) for corner in (robot.trunk_half_m, *corners))
    if (moment := float(np.linalg.eigvalsh(inertia)[-1])) > most:
        raise InvalidInput(
            f"{where}: inertia_kgm2: expected moments up to {most:.3g} kg m², as far as its trunk and its feet go, "
            f"got {moment:.3g}"
        )


def half_sides(value: Any, where: str) -> Array:
    """Half sides of a box, all above 0, shape (3,) [m]."""
    sides = read_only(value, (3,), where)
    if not np.all(sides > 0.0):
        raise InvalidInput(f"{where}: expected sides above 0 m, got {sides.tolist()}")
    return sides
