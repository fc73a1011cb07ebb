"""A robot's own model inside other files: the corrected URDF's text, and what makes legs of it.

Nothing but this text is needed to have the robot again: it goes through ``model_of`` as the file did, and where
meshes are is kept for pictures alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from .urdf_reader import Number

if TYPE_CHECKING:
    from .robot_model import RobotModel

MOST_LETTERS = 2_000_000
"""Of a URDF inside another file."""
MOST_LEGS, MOST_JOINTS, MOST_PAIRS, MOST_FOLDERS = 64, 64, 20_000, 64
Word = Annotated[str, Field(min_length=1, max_length=1000)]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class LegJson(_Keys):
    """One leg: the link that is its foot, and the angles in which it stands, joint by joint."""

    name: Word
    foot: Word
    stance_rad: Annotated[dict[Word, Number], Field(min_length=1, max_length=MOST_JOINTS)]


class ModelJson(_Keys):
    """A ``RobotModel``: its URDF, legs, pairs of links that may touch, folders where its meshes are, its digest."""

    urdf: Annotated[str, Field(max_length=MOST_LETTERS)]
    legs: Annotated[list[LegJson], Field(min_length=1, max_length=MOST_LEGS)]
    disabled_pairs: Annotated[
        list[Annotated[list[Word], Field(min_length=1, max_length=2)]], Field(max_length=MOST_PAIRS)
    ]
    mesh_folders: Annotated[list[Word], Field(max_length=MOST_FOLDERS)]
    digest: str


def model_to_json(model: RobotModel) -> dict[str, Any]:
    """JSON-ready values of a robot's model. Raises InvalidInput for a URDF that is too long to be kept."""
    if len(model.urdf) > MOST_LETTERS:
        raise InvalidInput(
            f"robot {model.name}: expected a URDF of {MOST_LETTERS} letters or fewer, got {len(model.urdf)}"
        )
    return {
        "urdf": model.urdf,
        "legs": [
            {
                "name": leg.name, "foot": leg.foot,
                "stance_rad": dict(zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)),
            }
            for leg in model.legs
        ],
        "disabled_pairs": sorted(sorted(pair) for pair in model.disabled_pairs),
        "mesh_folders": [str(folder) for folder in model.mesh_folders],
        "digest": model.digest,
    }  # fmt: skip


def without_folders(robot: Mapping[str, Any]) -> dict[str, Any]:
    """JSON-ready values of a robot with, of its model, what makes it this robot on every machine: legs and links that
    may touch, not where its meshes are."""
    model = robot.get("model")
    own = {} if model is None else {"model": {name: model[name] for name in ("digest", "disabled_pairs")}}
    return {**robot, **own}


def model_from_json(raw: ModelJson, name: str) -> RobotModel:
    """The model that ``model_to_json`` wrote, of a robot of this name.

    Raises InvalidInput, in one line, for a URDF that is none, legs that it does not have, and a digest of another one.
    """
    from .robot_model import model_of  # what a file without a model does without

    folders = [Path(folder) for folder in raw.mesh_folders]
    feet = {leg.name: leg.foot for leg in raw.legs}
    stances = {joint: angle for leg in raw.legs for joint, angle in leg.stance_rad.items()}
    if len(feet) != len(raw.legs):
        raise InvalidInput(f"model: legs: expected different names, got {', '.join(leg.name for leg in raw.legs)}")
    found = model_of(
        raw.urdf, where="model: urdf", folder=folders[0] if folders else Path(), packages=folders[1:], feet=feet,
        posture_rad=stances, name=name,
    )  # fmt: skip
    for leg, said in zip(found.legs, raw.legs, strict=True):
        if leg.joint_names != tuple(said.stance_rad):
            raise InvalidInput(
                f"model: leg {leg.name}: expected the joints {', '.join(leg.joint_names)}, "
                f"got {', '.join(said.stance_rad)}"
            )
    if found.digest != raw.digest:
        raise InvalidInput("model: digest mismatch: the URDF or its legs are not those that were written")
    return replace(found, disabled_pairs=frozenset(map(frozenset, raw.disabled_pairs)), mesh_folders=tuple(folders))
