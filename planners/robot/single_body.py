"""A legged robot as the gait optimiser sees it: one rigid body, and a box that each foot can reach (paper W §III-A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_name, frozen, gathered
from ..files.documents import read_yaml
from ..files.refusals import shown
from .leg_boxes import Foot, Workspace, measure_legs
from .model import hexapod

GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitRobot:
    """A torso with mass and inertia, and its feet; the legs weigh nothing apart from it (paper W §III-A).

    inertia_kgm2: about the centre of mass in the torso's frame, shape (3, 3) [kg m²]; stand_height_m: of the centre of
    mass over level ground in the nominal stance [m]; trunk_half_m: half sides of the trunk's box, shape (3,) [m],
    which has to stay clear of the terrain.
    """

    name: str
    mass_kg: float
    inertia_kgm2: Array
    feet: tuple[Foot, ...]
    stand_height_m: float
    trunk_half_m: Array

    def __post_init__(self) -> None:
        where = f"robot {checked_name(self.name, 'name')}"
        gathered(
            lambda: object.__setattr__(self, "mass_kg", checked(self.mass_kg, f"{where}: mass_kg", above=0.0)),
            lambda: object.__setattr__(self, "inertia_kgm2", _inertia(self.inertia_kgm2, f"{where}: inertia_kgm2")),
            lambda: object.__setattr__(
                self, "stand_height_m", checked(self.stand_height_m, f"{where}: stand_height_m", above=0.0)
            ),
            lambda: object.__setattr__(self, "trunk_half_m", _sides(self.trunk_half_m, f"{where}: trunk_half_m")),
        )
        names = [foot.name for foot in self.feet]
        if len(names) < 3 or len(set(names)) != len(names):
            raise InvalidInput(f"{where}: expected three or more feet of different names, got {names}")

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
        """Read a robot's file, as ``configs/robots/anymal.yaml`` is, or one that names a URDF to measure.

        Such a file has the keys urdf (a path from the file's folder), feet (names of frames), posture_rad and
        trunk_half_m, and may have a name and the options of ``Workspace``. Raises InvalidInput with all that is wrong.
        """
        data = read_yaml(path)
        try:
            return _measured(data, Path(path).parent) if "urdf" in data else _robot_of(data)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        feet: Sequence[str],
        posture: Sequence[float],
        *,
        trunk_half_m: Sequence[float],
        name: str = "",
        workspace: Workspace = Workspace(),
    ) -> GaitRobot:
        """Measure a URDF: mass, inertia and reach boxes (W4); needs the extra ``kin``.

        feet: names of their frames; posture: angles of all joints in pinocchio's order in which the robot stands [rad];
        trunk_half_m: half sides of the trunk's box, shape (3,) [m]; name: the URDF's own if missing; workspace: how the
        legs are sampled. Raises InvalidInput for a file that is no URDF, has no inertia, or lacks a frame.
        """
        legs = measure_legs(path, feet, posture, workspace)
        return cls(
            name=name or legs.name,
            mass_kg=legs.mass_kg,
            inertia_kgm2=legs.inertia_kgm2,
            feet=legs.feet,
            stand_height_m=-float(np.mean([foot.nominal_m[2] for foot in legs.feet])),
            trunk_half_m=np.asarray(trunk_half_m, dtype=np.float64),
        )


def anymal() -> GaitRobot:
    """ANYmal, the robot of paper W §V; the file says where its numbers come from."""
    from stancekit.configs import config_path

    return GaitRobot.from_yaml(config_path("robots/anymal.yaml"))


def hexapod_walker() -> GaitRobot:
    """The default hexapod of paper E (``robot.model.hexapod``) as a walker: a uniform disc with six feet.

    The feet stand .15 m outward of the shoulders and .2 m below them, as in paper E's ground problems; their boxes are
    .2 × .2 × .12 m, whose corners are within the limbs' reach of .35 m.
    """
    robot = hexapod()
    radius_m = float(np.linalg.norm(robot.limbs[0].shoulder_m))
    feet = []
    for limb in robot.limbs:
        nominal = limb.shoulder_m * (1.0 + 0.15 / radius_m) - np.array([0.0, 0.0, 0.2])
        half = np.array([0.1, 0.1, 0.06])
        feet.append(
            Foot(name=limb.name, nominal_m=nominal, reach_min_m=nominal - half, reach_max_m=nominal + half,
                 hip_m=limb.shoulder_m)
        )  # fmt: skip
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


MEASURED = ("urdf", "feet", "posture_rad", "trunk_half_m")
OPTIONS = ("name", *(option.name for option in fields(Workspace)))
KEYS = ("name", "mass_kg", "inertia_kgm2", "stand_height_m", "trunk_half_m", "feet")


def _robot_of(data: Any) -> GaitRobot:
    if not isinstance(data, dict):
        raise InvalidInput(f"expected keys and values, got {type(data).__name__}")
    wrong = _wrong_keys(data, KEYS)
    feet = data.get("feet")
    if "feet" in data and not (isinstance(feet, list) and all(isinstance(foot, dict) for foot in feet)):
        wrong.append(f"feet: expected a list of feet, got {type(feet).__name__}")
    if wrong:
        raise InvalidInput("; ".join(wrong))
    built = []
    for index, foot in enumerate(data["feet"]):
        try:
            built.append(Foot(**foot))
        except TypeError as error:
            raise InvalidInput(f"feet[{index}]: {str(error).split('__init__() ')[-1]}") from None
        except InvalidInput as error:
            raise InvalidInput(f"feet[{index}]: {error}") from None
    return GaitRobot(**{key: data[key] for key in KEYS if key != "feet"}, feet=tuple(built))


def _measured(data: dict[str, Any], folder: Path) -> GaitRobot:
    """A robot of a file that names its URDF."""
    if wrong := _wrong_keys(data, MEASURED, OPTIONS):
        raise InvalidInput("; ".join(wrong))
    feet, name, steps = data["feet"], data.get("name", ""), data.get("steps", 70)
    if not isinstance(feet, list) or not feet or not all(isinstance(foot, str) for foot in feet):
        raise InvalidInput(f"feet: expected names of frames, got {shown(feet, 80)}")
    for key in ("urdf", "name"):
        if not isinstance(data.get(key, ""), str):
            raise InvalidInput(f"{key}: expected a text, got {shown(data[key], 80)}")
    if not isinstance(steps, int) or not 2 <= steps <= 200:
        raise InvalidInput(f"steps: expected a whole number in [2, 200], got {shown(steps, 80)}")
    options: dict[str, Any] = {key: checked(data[key], key) for key in ("ceiling_m", "inner_m") if key in data}
    if "voxel_m" in data:
        options["voxel_m"] = checked(data["voxel_m"], "voxel_m", above=0.0)
    if "ranges_rad" in data:
        options["ranges_rad"] = frozen(data["ranges_rad"], (None, 2), "ranges_rad").tolist()
    return GaitRobot.from_urdf(
        folder / data["urdf"], feet, frozen(data["posture_rad"], (None,), "posture_rad").tolist(),
        trunk_half_m=_sides(data["trunk_half_m"], "trunk_half_m").tolist(), name=name,
        workspace=Workspace(steps=steps, **options),
    )  # fmt: skip


def _wrong_keys(data: dict[str, Any], needed: Sequence[str], others: Sequence[str] = ()) -> list[str]:
    wrong = [f"{key}: expected this key, got nothing" for key in needed if key not in data]
    return wrong + [f"{key}: unknown key" for key in data if key not in (*needed, *others, "source")]


def _sides(value: Any, where: str) -> Array:
    """Half sides of a box, all above 0, shape (3,) [m]."""
    sides = frozen(value, (3,), where)
    if not np.all(sides > 0.0):
        raise InvalidInput(f"{where}: expected sides above 0 m, got {sides.tolist()}")
    return sides


def _inertia(value: Any, where: str) -> Array:
    """A symmetric positive definite matrix whose principal moments a body can have, shape (3, 3) [kg m²]."""
    matrix = frozen(value, (3, 3), where)
    if not np.allclose(matrix, matrix.T, atol=1e-9 + 1e-6 * float(np.abs(matrix).max())):
        raise InvalidInput(f"{where}: expected a symmetric matrix, got {matrix.tolist()}")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0 or moments[0] + moments[1] < (1.0 - 1e-6) * moments[2]:
        raise InvalidInput(f"{where}: expected moments that a body can have, got {moments.round(6).tolist()}")
    return matrix
