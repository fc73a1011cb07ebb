"""A robot by what a person calls it: a built-in name, a URDF, or a YAML file that names one and corrects it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.documents import read_text, read_yaml
from ..files.refusals import shown, validated
from .legged import legged_model
from .model import hexapod
from .robot_model import RobotModel, model_of
from .urdf_reader import JointCorrection, Number

BUILT_IN = ("hexapod",)


class RobotKeys(BaseModel):
    """The keys of a robot's YAML file; paths are from its folder.

    urdf: the robot. srdf: pairs of links that may touch, and a posture to stand in. packages: folders where
    ``package://`` names lead. name: in place of the URDF's. feet: the links that are feet, by the names that their legs
    shall have, or a list. joints: corrections by name or pattern. posture_rad: to stand in, by name or pattern.
    root_rpy_rad: how the URDF's root lies in a frame whose z points up, where its own does not.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    urdf: str
    srdf: str = ""
    packages: list[str] = []
    name: str = ""
    feet: Annotated[dict[str, str] | list[str], Field(union_mode="left_to_right")] = {}
    joints: dict[str, JointCorrection] = {}
    posture_rad: dict[str, Number] = {}
    root_rpy_rad: tuple[Number, Number, Number] | None = None
    source: Any = None


def named_robot(name: str | Path, *, srdf: str | Path | None = None) -> RobotModel:
    """The robot of a built-in name, a ``.urdf`` file, or a ``.yaml`` file that names one.

    srdf: in place of the one that a YAML file names. Raises InvalidInput, in one line, for anything else.
    """
    path = Path(name)
    if path.suffix in (".yaml", ".yml"):
        return _from_yaml(path, srdf)
    if path.suffix == ".urdf":
        return model_of(
            read_text(path), where=str(path), folder=path.parent.resolve(), srdf="" if srdf is None else read_text(srdf)
        )
    if str(name) in BUILT_IN:
        return hexapod_model()
    raise InvalidInput(
        f"robot: expected {' or '.join(BUILT_IN)}, a .urdf file, or a .yaml file that names one, got {shown(str(name))}"
    )


def hexapod_model() -> RobotModel:
    """The default robot as one URDF among others: six limbs of four joints."""
    return legged_model(hexapod())


def _from_yaml(path: Path, srdf: str | Path | None) -> RobotModel:
    keys = validated(RobotKeys, read_yaml(path), str(path))
    folder = path.parent
    urdf = folder / keys.urdf
    semantics = Path(srdf) if srdf is not None else folder / keys.srdf if keys.srdf else None
    try:
        model = model_of(
            read_text(urdf), where=str(urdf), folder=urdf.parent.resolve(),
            packages=[(folder / each).resolve() for each in keys.packages],
            srdf="" if semantics is None else read_text(semantics), feet=keys.feet, joints=keys.joints,
            posture_rad=keys.posture_rad, name=keys.name,
            root_rpy_rad=keys.root_rpy_rad or (),
        )  # fmt: skip
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    return model
