"""A legged robot as the gait optimiser sees it: one rigid body, and a box that each foot can reach
(Pan et al. §III-A).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_name, collect_errors, read_only
from ..files.codec import LATER, UNWRITTEN, fields_to_json, from_json
from ..files.documents import read_text, read_yaml
from ..physics import GRAVITY_M_S2
from .leg_sources import LegSource, NoLegs, OwnLegs
from .model import checked_inertia, hexapod
from .model_json import model_from_json

if TYPE_CHECKING:
    from .robot_model import RobotModel


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


SAME = 1e-6
"""Of a walker's numbers against its model's: what rounding makes of them."""
NEAR = 0.05
"""Share of a walker's height by which its feet may be elsewhere, on the mean."""
DEEPEST = 0.5
"""How deep a robot may crouch, as a share of its height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _WalkerKeys:
    """The keys of a walker, see ``GaitRobot``.

    Arguments:
        model: the model from the robot's own file.
        legs: limits of the legs in leaps, by name or pattern.
        source: origin of the numbers, for readers.
    """

    name: str
    mass_kg: float
    inertia_kgm2: Array
    feet: tuple[Foot, ...]
    stand_height_m: float
    trunk_half_m: Array
    model: Mapping[str, Any] | None = field(default=None, metadata=LATER)
    source: Any = field(default=None, metadata=LATER)
    legs: Any = field(default=None, metadata=LATER)

    def value(self) -> GaitRobot:
        """The robot.

        Raises InvalidInput.
        """
        model = None if self.model is None else model_from_json(self.model, self.name)
        numbers = {each.name: getattr(self, each.name) for each in fields(self)[:6]}
        return GaitRobot(**numbers, model=model)


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitRobot:
    """A torso with mass and inertia, and its feet; the legs weigh nothing apart from it (Pan et al.
    §III-A).

    Arguments:
        inertia_kgm2: inertia about the centre of mass in the torso's frame, shape (3, 3) [kg m²].
        stand_height_m: height of the centre of mass over level ground in the nominal stance [m].
        trunk_half_m: half sides of the trunk's box, which has to stay clear of the terrain, shape
            (3,) [m].
        model: the robot of a URDF, which has joints; None for a robot without one.
    """

    KEYS: ClassVar = _WalkerKeys

    name: str
    mass_kg: float
    inertia_kgm2: Array
    feet: tuple[Foot, ...]
    stand_height_m: float
    trunk_half_m: Array
    model: RobotModel | None = field(default=None, repr=False, metadata=UNWRITTEN)

    def __post_init__(self) -> None:
        where = f"robot {checked_name(self.name, 'name')}"
        collect_errors(
            lambda: object.__setattr__(
                self, "mass_kg", checked(self.mass_kg, f"{where}: mass_kg", above=0.0)
            ),
            lambda: object.__setattr__(
                self, "inertia_kgm2", checked_inertia(self.inertia_kgm2, f"{where}: inertia_kgm2")
            ),
            lambda: object.__setattr__(
                self,
                "stand_height_m",
                checked(self.stand_height_m, f"{where}: stand_height_m", above=0.0),
            ),
            lambda: object.__setattr__(
                self, "trunk_half_m", half_sides(self.trunk_half_m, f"{where}: trunk_half_m")
            ),
        )
        names = [foot.name for foot in self.feet]
        if len(names) < 3 or len(set(names)) != len(names):
            raise InvalidInput(
                f"{where}: expected three or more feet of different names, got {names}"
            )
        if self.model is not None:
            self._check_model(self.model, where)
        self._check_numbers(where)

    def _check_model(self, model: RobotModel, where: str) -> None:
        """Raise InvalidInput for feet and numbers that are not its model's.

        It may stand lower, crouched, and not higher.
        """
        if model.leg_names != self.foot_names:
            legs, feet = ", ".join(model.leg_names), ", ".join(self.foot_names)
            raise InvalidInput(f"{where}: expected feet as its model has legs, {legs}, got {feet}")
        mass_kg, inertia = model.body.mass_kg, model.body.inertia_kgm2
        if abs(self.mass_kg - mass_kg) > SAME * mass_kg:
            raise InvalidInput(
                f"{where}: expected the mass of its model, {mass_kg:.8g} kg, got {self.mass_kg:.8g}"
            )
        if not float(np.abs(self.inertia_kgm2 - inertia).max()) <= SAME * float(
            np.abs(inertia).max()
        ):
            raise InvalidInput(
                f"{where}: expected the inertia of its model as it stands, got another one"
            )
        low_m, high_m = (1.0 - DEEPEST) * model.stand_height_m, model.stand_height_m
        if not (1.0 - SAME) * low_m <= self.stand_height_m <= (1.0 + SAME) * high_m:
            raise InvalidInput(
                f"{where}: expected to stand as high as its model, {high_m:.6g} m, or crouched down to {low_m:.6g} m, "
                f"got {self.stand_height_m:.6g}"
            )

    def _check_numbers(self, where: str) -> None:
        """Raise InvalidInput for a height at which its feet do not stand, and for an inertia that
        no mass within it has: tolerances of the verifier are in units of both.
        """
        stands_m = -float(np.mean([foot.nominal_m[2] for foot in self.feet]))
        if not abs(self.stand_height_m - stands_m) <= NEAR * abs(stands_m):
            raise InvalidInput(
                f"{where}: stand_height_m: expected {stands_m:.6g} m, which its feet are below its centre of mass, got "
                f"{self.stand_height_m:.6g}"
            )
        corners = [
            np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m)) for foot in self.feet
        ]
        most = self.mass_kg * max(
            float(corner @ corner) for corner in (self.trunk_half_m, *corners)
        )
        if (moment := float(np.linalg.eigvalsh(self.inertia_kgm2)[-1])) > most:
            raise InvalidInput(
                f"{where}: inertia_kgm2: expected moments up to {most:.3g} kg m², as far as its trunk and its feet go, "
                f"got {moment:.3g}"
            )

    @property
    def source(self) -> LegSource:
        """Source of its legs: its own file, or nowhere.

        Feet without legs are points.
        """
        if self.model is not None:
            return OwnLegs(self.model)
        return NoLegs(self.name, len(self.feet), point=True)

    @property
    def foot_names(self) -> tuple[str, ...]:
        """Names of the feet, in the robot's order."""
        return tuple(foot.name for foot in self.feet)

    @property
    def weight_n(self) -> float:
        """m·g, the unit of forces in the optimiser [N]."""
        return self.mass_kg * GRAVITY_M_S2

    @classmethod
    def from_yaml(cls, path: str | Path) -> GaitRobot:
        """Read a file of a robot's numbers, as ``configs/robots/anymal.yaml`` is.

        Raises InvalidInput, in one line, with all that is wrong.
        """
        return from_json(cls, read_yaml(path), where=str(path))

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values of its numbers, and of what makes its legs."""
        return fields_to_json(self) | self.source.to_json()


def anymal() -> GaitRobot:
    """ANYmal, the robot of Pan et al. §V, by its boxes alone; the file says where its numbers come
    from.
    """
    from stancekit.configs import config_path

    return GaitRobot.from_yaml(config_path("robots/anymal.yaml"))


def legged_anymal() -> GaitRobot:
    """ANYmal with the same boxes and with legs, those of ``configs/robots/anymal.urdf``.

    Without pinocchio no legs can be read, and it is its boxes.
    """
    return anymal() if find_spec("pinocchio") is None else replace(anymal(), model=_anymal_legs())


@lru_cache(maxsize=1)
def _anymal_legs() -> RobotModel:
    from stancekit.configs import config_path

    from .robot_model import model_of  # slow to import

    urdf, srdf = (read_text(config_path(f"robots/anymal.{kind}")) for kind in ("urdf", "srdf"))
    feet = {name: f"{name}_FOOT" for name in ("LF", "RF", "LH", "RH")}
    return model_of(urdf, where="anymal.urdf", srdf=srdf, feet=feet, name="anymal")


def hexapod_walker() -> GaitRobot:
    """The default hexapod of Lin et al. (``robot.model.hexapod``) as a walker: a uniform disc with
    six feet.

    The feet stand .15 m outward of the shoulders and .2 m below them, as in Lin et al.'s ground
    problems; their boxes are .2 × .2 × .12 m, whose corners are within the limbs' reach of .35 m.
    """
    robot = hexapod()
    radius_m = float(np.linalg.norm(robot.limbs[0].shoulder_m))
    feet = []
    for limb in robot.limbs:
        nominal = limb.shoulder_m * (1.0 + 0.15 / radius_m) - np.array([0.0, 0.0, 0.2])
        half = np.array([0.1, 0.1, 0.06])
        feet.append(
            Foot(
                name=limb.name,
                nominal_m=nominal,
                reach_min_m=nominal - half,
                reach_max_m=nominal + half,
                hip_m=limb.shoulder_m,
            )
        )
    thick_m = 0.08
    across = robot.mass_kg * (3.0 * radius_m**2 + thick_m**2) / 12.0
    return GaitRobot(
        name=robot.name,
        mass_kg=robot.mass_kg,
        inertia_kgm2=np.diag([across, across, 0.5 * robot.mass_kg * radius_m**2]),
        feet=tuple(feet),
        stand_height_m=0.2,
        trunk_half_m=np.array([0.127, 0.127, 0.04]),
    )


def half_sides(value: Any, where: str) -> Array:
    """Half sides of a box, all above 0, shape (3,) [m]."""
    sides = read_only(value, (3,), where)
    if not np.all(sides > 0.0):
        raise InvalidInput(f"{where}: expected sides above 0 m, got {sides.tolist()}")
    return sides
