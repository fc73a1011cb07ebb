"""The keys of a leap's file, ``stancekit/leap/1``, in JSON and in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import LATER, fields_to_json, from_json, keys_of, to_json
from ..files.documents import shown, validated
from ..robot.leg_limits import leaping_robot
from ..robot.model import Robot
from ..terrain.patch import Patch
from .foothold import Foothold
from .leap import BodyState, Leap, LeapLimits, Phase
from .leap_classes import leap_class, nameless
from .leap_names import FORMAT


@dataclass(frozen=True, kw_only=True)
class _DrawKeys:
    """The keys of a leap that is drawn: distribution, a class of ``configs/leaps.yaml``, and a
    seed.
    """

    distribution: str
    seed: Annotated[int, Field(ge=0)] = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class _FootholdKeys:
    """The keys of a toe that is put down in a phase."""

    limb: str
    phase: int
    candidates: tuple[Patch, ...]
    toe_m: Array | None = field(default=None, metadata=LATER)


@dataclass(frozen=True, kw_only=True, eq=False)
class _LeapKeys:
    """The keys of a leap; see ``Leap``.

    Arguments:
        robot: a name, a file, or its numbers.
    """

    FORMAT: ClassVar = FORMAT

    name: str = "leap"
    robot: str | Robot
    phases: tuple[Phase, ...]
    timings_s: tuple[tuple[float, ...], ...]
    duration_s: float | None = None
    footholds: tuple[_FootholdKeys, ...]
    start: BodyState
    goal: BodyState
    goal_radius_m: float = 0.06
    limits: LeapLimits = field(default_factory=LeapLimits)


def leap_from_keys(data: Mapping[str, Any], where: str) -> Leap:
    """Read the keys of a leap; robot may be a name or a file, too.

    Arguments:
        where: the file, which messages begin with.

    Raises:
        InvalidInput: in one line.
    """
    if "distribution" in data:
        draw = from_json(_DrawKeys, data, whole=False, where=where)
        try:
            kind = leap_class(draw.distribution)
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error}") from None
        return kind.draw(np.random.default_rng(draw.seed), f"{draw.distribution}-{draw.seed}")
    if not isinstance(data.get("robot", ""), str | Mapping):
        raise InvalidInput(
            f"{where}: robot: expected a name, a file, or a robot's keys, got "
            f"{shown(data['robot'])}"
        )
    if isinstance(data.get("robot"), Mapping):  # or a message names what the union is of
        validated(keys_of(Robot, whole=False), data["robot"], where, key="robot.")
    try:
        keys = from_json(_LeapKeys, {"format": FORMAT, **data}, whole=False)
        robot = _named(keys.robot) if isinstance(keys.robot, str) else keys.robot
        footholds = tuple(
            _foothold(one, f"footholds[{j}]: ") for j, one in enumerate(keys.footholds)
        )
        return Leap(**{**vars(keys), "robot": robot, "footholds": footholds})
    except InvalidInput as error:
        if isinstance(data.get("robot"), Mapping):  # again: what a robot's parts say to each other
            from_json(Robot, data["robot"], whole=False, where=where)
        raise InvalidInput(f"{where}: {error}") from None


def leap_to_json(leap: Leap) -> dict[str, Any]:
    """A leap as JSON-ready values, which ``leap_from_keys`` reads back."""
    robot = {
        "name": leap.robot.name,
        "mass_kg": leap.robot.mass_kg,
        "inertia_kgm2": to_json(leap.robot.inertia),
        "identity": leap.robot.identity,
        "limbs": to_json(leap.robot.limbs),
    }
    if leap.robot.source.own:
        robot |= leap.robot.source.to_json()
    footholds = tuple(
        _FootholdKeys(limb=one.limb, phase=one.frame, candidates=one.candidates, toe_m=one.toe_m)
        for one in leap.footholds
    )
    same = {f.name: getattr(leap, f.name) for f in fields(_LeapKeys)}
    keys = _LeapKeys(**{**same, "footholds": footholds})
    return fields_to_json(keys) | {"robot": robot}


def _named(name: str) -> Robot:
    return (
        nameless()
        if name == "nameless"
        else leaping_robot(Path(name) if Path(name).suffix else name)
    )


def _foothold(keys: _FootholdKeys, where: str) -> Foothold:
    try:
        return Foothold(
            limb=keys.limb, frame=keys.phase, candidates=keys.candidates, toe_m=keys.toe_m
        )
    except InvalidInput as error:
        raise InvalidInput(f"{where}{error}") from None
