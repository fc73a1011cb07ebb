"""A robot's own model inside other files: the corrected URDF's text, and what makes legs of it.

Nothing but this is needed to have the robot again: the text goes through ``model_of`` as the file
did, and hulls stand for its meshes, which nobody looks for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.codec import KEYS, to_json
from ..files.documents import validated
from .hulls import hulls_of_text, hulls_to_text
from .leg import FootContact
from .urdf_reader import Number, turned

if TYPE_CHECKING:
    from .robot_model import RobotModel

MOST_LETTERS = 2_000_000
"""Most letters of a URDF inside another file."""
_MOST_LEGS, _MOST_JOINTS, _MOST_PAIRS = 64, 64, 20_000
_Word = Annotated[str, Field(min_length=1, max_length=1000)]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class LegJson(_Keys):
    """One leg: the link that is its foot, the angles in which it stands, joint by joint, and, where
    a person says it, what it touches with.
    """

    name: _Word
    foot: _Word
    stance_rad: Annotated[dict[_Word, Number], Field(min_length=1, max_length=_MOST_JOINTS)]
    contact: Annotated[FootContact, KEYS] | None = None


class ModelJson(_Keys):
    """A ``RobotModel``: its URDF, legs, pairs of links that may touch, hulls of its meshes, its
    digest.
    """

    urdf: Annotated[str, Field(max_length=MOST_LETTERS)]
    legs: Annotated[list[LegJson], Field(min_length=1, max_length=_MOST_LEGS)]
    disabled_pairs: Annotated[
        list[Annotated[list[_Word], Field(min_length=1, max_length=2)]],
        Field(max_length=_MOST_PAIRS),
    ]
    hulls: str
    digest: str


def model_to_json(model: RobotModel) -> dict[str, Any]:
    """JSON-ready values of a robot's model.

    Raises InvalidInput for a URDF that is too long to be kept.
    """
    if len(model.urdf) > MOST_LETTERS:
        raise InvalidInput(
            f"robot {model.name}: expected a URDF of {MOST_LETTERS} letters or fewer, got "
            f"{len(model.urdf)}"
        )
    return {
        "urdf": model.urdf,
        "legs": [
            {
                "name": leg.name,
                "foot": leg.foot,
                "stance_rad": dict(zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)),
                **({} if leg.contact is None else {"contact": to_json(leg.contact)}),
            }
            for leg in model.legs
        ],
        "disabled_pairs": sorted(sorted(pair) for pair in model.disabled_pairs),
        "hulls": hulls_to_text(model.shapes),
        "digest": model.digest,
    }


def robot_numbers(robot: Mapping[str, Any]) -> dict[str, Any]:
    """JSON-ready values of a robot with, of its model, what makes it this robot: digest, and links
    that may touch.
    """
    record = dict(robot)
    if "model" in record:
        record["model"] = {name: record["model"][name] for name in ("digest", "disabled_pairs")}
    return record


def model_from_json(data: Mapping[str, Any] | None, name: str) -> RobotModel | None:
    """The model that ``model_to_json`` wrote, of a robot of this name; None where a file has none.

    Raises InvalidInput, in one line, for keys that are wrong, a URDF that is none, legs that it
    does not have, and a digest of another one.
    """
    if data is None:
        return None
    raw = validated(ModelJson, data, key="model.")
    model = _model(raw, name)
    elsewhere = any(
        leg.foot != leg_record.foot for leg, leg_record in zip(model.legs, raw.legs, strict=True)
    )
    if model.digest != raw.digest or elsewhere:
        raise InvalidInput(
            "model: digest mismatch: the URDF or its legs are not those that were written"
        )
    return model


def turned_model(model: RobotModel, yaw_rad: float) -> RobotModel:
    """The robot below a root in which its own is turned by an angle about the vertical [rad]."""
    text = turned(model.urdf, (0.0, 0.0, yaw_rad), model.name)
    return _model(validated(ModelJson, {**model_to_json(model), "urdf": text}), model.name)


def _model(raw: ModelJson, name: str) -> RobotModel:
    """The model of keys.

    Raises InvalidInput.
    """
    from .robot_model import model_of  # what a file without a model does without

    feet = {leg.name: leg.foot for leg in raw.legs}
    stances = {joint: angle for leg in raw.legs for joint, angle in leg.stance_rad.items()}
    if len(feet) != len(raw.legs):
        raise InvalidInput(
            f"model: legs: expected different names, got {', '.join(leg.name for leg in raw.legs)}"
        )
    model = model_of(
        raw.urdf,
        where="model: urdf",
        folder=None,
        hulls=hulls_of_text(raw.hulls),
        feet=feet,
        posture_rad=stances,
        name=name,
        contacts={leg.name: leg.contact for leg in raw.legs if leg.contact is not None},
    )
    for leg, leg_record in zip(model.legs, raw.legs, strict=True):
        if leg.joint_names != tuple(leg_record.stance_rad):
            raise InvalidInput(
                f"model: leg {leg.name}: expected the joints {', '.join(leg.joint_names)}, "
                f"got {', '.join(leg_record.stance_rad)}"
            )
    return model.changed(disabled_pairs=frozenset(map(frozenset, raw.disabled_pairs)))
