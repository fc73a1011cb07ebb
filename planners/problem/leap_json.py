"""The keys of a leap's file, ``stancekit/leap/1``, in JSON and in YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import LARGEST
from ..files.validation import shown, validated
from ..robot.leg_limits import leaping_robot
from ..robot.model import LegLimits, Limb, Robot
from ..robot.reach import ReachRows
from ..terrain.patch import Patch
from .foothold import Foothold
from .leap import BodyState, Leap, LeapLimits, Phase
from .leap_classes import leap_class, nameless
from .posture_json import ReachRowsJson

FORMAT: Literal["stancekit/leap/1"] = "stancekit/leap/1"
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Vector = tuple[Number, Number, Number]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class _LeapLegKeys(_Keys):
    hip_m: Vector
    speed_m_s: Number | None = None
    power_w: Number | None = None
    fold_m: Number = 0.0


class _LimbKeys(_Keys):
    name: str
    shoulder_m: Vector
    reach_m: Number
    reach_rows: ReachRowsJson | None = None
    leg: _LeapLegKeys | None = None


class _LeapRobotKeys(_Keys):
    name: str
    mass_kg: Number
    limbs: list[_LimbKeys]
    inertia_kgm2: tuple[Vector, Vector, Vector] | None = None
    identity: str = ""


class _PhaseKeys(_Keys):
    limbs: list[str]
    intervals: int = 1


class _StateKeys(_Keys):
    com_m: Vector
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    momentum_m2_s: Vector = (0.0, 0.0, 0.0)
    rotation_rad: Vector = (0.0, 0.0, 0.0)


class _LimitKeys(_Keys):
    momentum_m2_s: Number = LeapLimits.momentum_m2_s
    tilt_rad: Number = LeapLimits.tilt_rad
    goal_tilt_rad: Number = LeapLimits.goal_tilt_rad
    height_m: Number = LeapLimits.height_m
    force_share: Number = LeapLimits.force_share
    ramp: Number = LeapLimits.ramp


class _PatchKeys(_Keys):
    vertices_m: list[Vector]
    normal: Vector
    shear_reference: Vector
    friction: Number


class _LeapFootholdKeys(_Keys):
    limb: str
    phase: int
    candidates: list[_PatchKeys]
    toe_m: Vector | None = None


class LeapKeys(_Keys):
    """The keys of a leap; see ``Leap``. robot: a name, a file, or its numbers."""

    format: Literal["stancekit/leap/1"] = FORMAT
    name: str = "leap"
    robot: str | _LeapRobotKeys
    phases: list[_PhaseKeys]
    timings_s: list[list[Number]]
    duration_s: Number | None = None
    footholds: list[_LeapFootholdKeys]
    start: _StateKeys
    goal: _StateKeys
    goal_radius_m: Number = 0.06
    limits: _LimitKeys = _LimitKeys()


class DrawnKeys(_Keys):
    """The keys of a leap that is drawn: distribution, a class of ``configs/leaps.yaml``, and a seed."""

    distribution: str
    seed: Annotated[int, Field(ge=0)] = 0


def leap_from_keys(data: Mapping[str, Any], where: str) -> Leap:
    """Read the keys of a leap. where: the file, which messages begin with. Raises InvalidInput, in one line."""
    if "distribution" in data:
        drawn = validated(DrawnKeys, dict(data), where)
        try:
            kind = leap_class(drawn.distribution)
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error}") from None
        return kind.draw(np.random.default_rng(drawn.seed), f"{drawn.distribution}-{drawn.seed}")
    if isinstance(data.get("robot"), Mapping):  # or a message names what the union is of
        validated(_LeapRobotKeys, dict(data["robot"]), where, key="robot.")
    elif "robot" in data and not isinstance(data["robot"], str):
        raise InvalidInput(f"{where}: robot: expected a name, a file, or a robot's keys, got {shown(data['robot'])}")
    keys = validated(LeapKeys, dict(data), where)
    try:
        return Leap(
            name=keys.name,
            robot=_robot(keys.robot),
            phases=tuple(Phase(limbs=tuple(one.limbs), intervals=one.intervals) for one in keys.phases),
            timings_s=tuple(tuple(timing) for timing in keys.timings_s),
            duration_s=keys.duration_s,
            footholds=tuple(_foothold(one, f"footholds[{j}]: ") for j, one in enumerate(keys.footholds)),
            start=_state(keys.start),
            goal=_state(keys.goal),
            goal_radius_m=keys.goal_radius_m,
            limits=LeapLimits(**keys.limits.model_dump()),
        )
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None


def leap_to_json(leap: Leap) -> dict[str, Any]:
    """A leap as JSON-ready values, which ``leap_from_keys`` reads back."""
    return {
        "format": FORMAT,
        "name": leap.name,
        "robot": _robot_to_json(leap.robot),
        "phases": [{"limbs": list(phase.limbs), "intervals": phase.intervals} for phase in leap.phases],
        "timings_s": [list(timing) for timing in leap.timings_s],
        "duration_s": leap.duration_s,
        "footholds": [_foothold_to_json(foothold) for foothold in leap.footholds],
        "start": _state_to_json(leap.start),
        "goal": _state_to_json(leap.goal),
        "goal_radius_m": leap.goal_radius_m,
        "limits": dict(vars(leap.limits)),
    }


def _robot(keys: str | _LeapRobotKeys) -> Robot:
    if isinstance(keys, str):
        return nameless() if keys == "nameless" else leaping_robot(Path(keys) if Path(keys).suffix else keys)
    limbs = []
    for raw in keys.limbs:
        given = {} if raw.leg is None else {k: v for k, v in raw.leg.model_dump().items() if v is not None}
        leg = None if raw.leg is None else LegLimits(**given)
        rows = None if raw.reach_rows is None else ReachRows(**raw.reach_rows.model_dump())
        shoulder = np.array(raw.shoulder_m)
        limbs.append(Limb(name=raw.name, shoulder_m=shoulder, reach_m=raw.reach_m, reach_rows=rows, leg=leg))
    return Robot(
        name=keys.name,
        mass_kg=keys.mass_kg,
        limbs=tuple(limbs),
        inertia_kgm2=None if keys.inertia_kgm2 is None else np.array(keys.inertia_kgm2),
        identity=keys.identity,
    )


def _robot_to_json(robot: Robot) -> dict[str, Any]:
    inertia = robot.inertia
    return {
        "name": robot.name,
        "mass_kg": robot.mass_kg,
        "inertia_kgm2": None if inertia is None else inertia.tolist(),
        "identity": robot.identity,
        "limbs": [_limb_to_json(limb) for limb in robot.limbs],
    }


def _limb_to_json(limb: Limb) -> dict[str, Any]:
    found = {"name": limb.name, "shoulder_m": limb.shoulder_m.tolist(), "reach_m": limb.reach_m}
    if limb.reach_rows is not None:
        found["reach_rows"] = limb.reach_rows.to_json()
    if limb.leg is not None:
        limits = {name: getattr(limb.leg, name) for name in ("speed_m_s", "power_w", "fold_m")}
        numbers = {name: value for name, value in limits.items() if math.isfinite(value)}
        found["leg"] = {"hip_m": limb.leg.hip_m.tolist(), **numbers}
    return found


def _state(keys: _StateKeys) -> BodyState:
    return BodyState(**{name: np.array(value) for name, value in keys.model_dump().items()})


def _state_to_json(state: BodyState) -> dict[str, Any]:
    return {name: value.tolist() for name, value in vars(state).items()}


def _foothold(keys: _LeapFootholdKeys, where: str) -> Foothold:
    try:
        patches = tuple(Patch(**patch.model_dump()) for patch in keys.candidates)
        toe = None if keys.toe_m is None else np.array(keys.toe_m)
        if not patches:
            raise InvalidInput(f"expected one or more candidates for the toe of {keys.limb}, got none")
        return Foothold(limb=keys.limb, frame=keys.phase, candidates=patches, toe_m=toe)
    except InvalidInput as error:
        raise InvalidInput(f"{where}{error}") from None


def _foothold_to_json(foothold: Foothold) -> dict[str, Any]:
    patches = [
        {
            "vertices_m": patch.vertices_m.tolist(),
            "normal": patch.normal.tolist(),
            "shear_reference": patch.shear_reference.tolist(),
            "friction": patch.friction,
        }
        for patch in foothold.candidates
    ]
    toe = {} if foothold.toe_m is None else {"toe_m": foothold.toe_m.tolist()}
    return {"limb": foothold.limb, "phase": foothold.frame, "candidates": patches, **toe}
