"""Robots that walk, as the gait optimiser sees them: one rigid body, and a box that each foot can
reach (Pan et al. §III-A).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import LATER, from_json
from ..files.documents import read_text, read_yaml
from .limb import Foot
from .model import Robot, hexapod
from .model_json import model_from_json

if TYPE_CHECKING:
    from .robot_model import RobotModel


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkerKeys:
    """The keys of a robot that walks, by its feet, see ``Robot``.

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

    def value(self) -> Robot:
        """The robot.

        Raises InvalidInput.
        """
        model = model_from_json(self.model, self.name)
        numbers = {each.name: getattr(self, each.name) for each in fields(self)[:6]}
        return Robot(**numbers, model=model)


def walker_from_json(data: Any, where: str = "") -> Robot:
    """The robot that walks which ``Robot.to_json`` wrote, or a person, as in
    ``configs/robots/anymal.yaml``.

    Arguments:
        where: the file, which the message begins with.

    Raises:
        InvalidInput: in one line, with all that is wrong.
    """
    keys = from_json(WalkerKeys, data, where=where)
    try:
        return keys.value()
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}" if where else str(error)) from None


def read_walker(path: str | Path) -> Robot:
    """Read a file of the numbers of a robot that walks, as ``configs/robots/anymal.yaml`` is.

    Raises InvalidInput.
    """
    return walker_from_json(read_yaml(path), str(path))


def anymal() -> Robot:
    """ANYmal, the robot of Pan et al. §V, by its boxes alone; the file says where its numbers come
    from.
    """
    from stancekit.configs import config_path

    return read_walker(config_path("robots/anymal.yaml"))


def legged_anymal() -> Robot:
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


def hexapod_walker() -> Robot:
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
    return Robot(
        name=robot.name,
        mass_kg=robot.mass_kg,
        inertia_kgm2=np.diag([across, across, 0.5 * robot.mass_kg * radius_m**2]),
        feet=tuple(feet),
        stand_height_m=0.2,
        trunk_half_m=np.array([0.127, 0.127, 0.04]),
    )
