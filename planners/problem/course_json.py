"""The JSON form ``stancekit/course/1`` of a course: explicit and complete, the same to the last bit when read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..files.validation import validated
from ..robot.drawn_keys import DrawnLegsKeys
from ..robot.model import Limb, Robot
from ..robot.model_json import ModelJson, model_from_json
from ..robot.reach import ReachRows, RelativeReach
from ..terrain.patch import Patch
from .posture_json import ReachRowsJson
from .problem import Foothold, Problem, StepLimits, Weights

FORMAT = "stancekit/course/1"

_PATCH = ("vertices_m", "normal", "shear_reference")
_ARRAYS = ("com_nominal_m", "com_radius_m", "goal_m", "force_min", "force_max")
_NUMBERS = ("tilt_limit_rad", "gravity_m_s2", "length_scale_m")

Made = TypeVar("Made")


def course_to_json(course: Problem) -> dict[str, Any]:
    """The course as JSON-ready values: robot, every patch of the terrain, every foothold with its candidates."""
    return {
        "format": FORMAT,
        "name": course.name,
        "robot": {
            "name": course.robot.name,
            "mass_kg": course.robot.mass_kg,
            "limbs": [_limb_to_json(limb) for limb in course.robot.limbs],
            **_relative_to_json(course.robot),
            **course.robot.source.to_json(),
        },
        "terrain": [_patch_to_json(patch) for patch in course.terrain],
        "placements": [
            {
                "limb": foothold.limb,
                "frame": foothold.frame,
                "toe_m": None if foothold.toe_m is None else foothold.toe_m.tolist(),
                "candidates": [_patch_to_json(patch) for patch in foothold.candidates],
                **({"yaws_rad": list(foothold.yaws_rad)} if foothold.yaws_rad else {}),
                **_bounds_to_json(foothold),
            }
            for foothold in course.footholds
        ],
        "lifts": [list(lifted) for lifted in course.lifts],
        "next_lift": list(course.next_lift),
        **{name: getattr(course, name).tolist() for name in _ARRAYS},
        **{name: getattr(course, name) for name in _NUMBERS},
        **({} if course.force_n == course.weight_n else {"force_scale_n": course.force_n}),
        "steps": {name: value for name, value in vars(course.steps).items() if value is not None},
        "weights": _weights_to_json(course),
        **({} if course.standing_m is None else {"standing_m": course.standing_m.tolist()}),
        **({"push_n": course.push_n} if course.push_n else {}),
        **({} if course.wrench is None else {"wrench": course.wrench.tolist()}),
        "modes": None if course.modes is None else list(course.modes),
    }


def course_from_json(data: Mapping[str, Any]) -> Problem:
    """Read what ``course_to_json`` wrote. Raises InvalidInput whose message lists every key that is wrong."""
    if not isinstance(data, Mapping):
        raise InvalidInput(f"expected a JSON object with format {FORMAT!r}, got {type(data).__name__}")
    raw = validated(_CourseJson, data)
    notes = _Notes()
    robot = notes.made("", partial(_robot, raw.robot))
    terrain = [notes.made(f"terrain[{i}].", partial(_patch, item)) for i, item in enumerate(raw.terrain)]
    footholds = [_foothold(item, f"placements[{i}].", notes) for i, item in enumerate(raw.placements)]
    steps = notes.made("", partial(StepLimits, **raw.steps.model_dump()))
    weights = notes.made("", partial(Weights, **raw.weights.model_dump()))
    if notes.wrong or robot is None or steps is None or weights is None:
        raise InvalidInput("; ".join(notes.wrong))
    return Problem(
        name=raw.name, robot=robot, steps=steps, weights=weights,
        terrain=tuple(patch for patch in terrain if patch),
        footholds=tuple(foothold for foothold in footholds if foothold),
        lifts=tuple(tuple(lifted) for lifted in raw.lifts), next_lift=tuple(raw.next_lift),
        modes=None if raw.modes is None else tuple(raw.modes), force_scale_n=raw.force_scale_n, push_n=raw.push_n,
        standing_m=None if raw.standing_m is None else _standing(raw.standing_m, len(raw.lifts), robot),
        wrench=None if raw.wrench is None else read_only(raw.wrench, (len(raw.lifts), 6), "wrench"),
        **{name: getattr(raw, name) for name in (*_ARRAYS, *_NUMBERS)},
    )  # fmt: skip


def _standing(raw: list[list[list[float]]], frames: int, robot: Robot) -> Array:
    return read_only(raw, (frames, len(robot.limbs), 3), "standing_m")


class _Notes:
    """Makes the parts of a file and keeps what is wrong with them, each with its place."""

    def __init__(self) -> None:
        self.wrong = list[str]()

    def made(self, place: str, make: Callable[[], Made]) -> Made | None:
        """What ``make`` returns; None where it refuses."""
        try:
            return make()
        except InvalidInput as error:
            self.wrong += [f"{place}{text}" for text in str(error).split("; ")]
            return None


def _robot(raw: _RobotJson) -> Robot:
    limbs = tuple(_limb(limb) for limb in raw.limbs)
    model = None
    if raw.model is not None:
        try:
            model = model_from_json(raw.model, raw.name)
        except InvalidInput as error:
            raise InvalidInput(f"robot {raw.name}: {error}") from None
    try:
        relative = tuple(
            RelativeReach(limb=each.limb, other=each.other, rows=ReachRows(**each.rows.model_dump()))
            for each in raw.relative_reach
        )
    except InvalidInput as error:
        raise InvalidInput(f"robot {raw.name}: relative_reach: {error}") from None
    drawn = None if raw.legs is None else raw.legs.servo()
    return Robot(
        name=raw.name, mass_kg=raw.mass_kg, limbs=limbs, model=model, identity=raw.identity, relative_reach=relative,
        drawn=drawn,
    )  # fmt: skip


def _relative_to_json(robot: Robot) -> dict[str, Any]:
    pairs = [{"limb": e.limb, "other": e.other, "rows": e.rows.to_json()} for e in robot.relative_reach]
    return {"relative_reach": pairs} if pairs else {}


def _limb(raw: _LimbJson) -> Limb:
    try:
        rows = None if raw.reach_rows is None else ReachRows(**raw.reach_rows.model_dump())
    except InvalidInput as error:
        raise InvalidInput(f"limb {raw.name}: {error}") from None
    sole = None if raw.sole_m is None else read_only(raw.sole_m, (None, 2), f"limb {raw.name}: sole_m")
    return Limb(
        name=raw.name, shoulder_m=np.array(raw.shoulder_m), reach_m=raw.reach_m, reach_rows=rows, sole_m=sole
    )  # fmt: skip


def _limb_to_json(limb: Limb) -> dict[str, Any]:
    return {
        "name": limb.name,
        "shoulder_m": limb.shoulder_m.tolist(),
        "reach_m": limb.reach_m,
        **({} if limb.reach_rows is None else {"reach_rows": limb.reach_rows.to_json()}),
        **({} if limb.sole_m is None else {"sole_m": limb.sole_m.tolist()}),
    }


def _foothold(raw: _FootholdJson, place: str, notes: _Notes) -> Foothold | None:
    found = [notes.made(f"{place}candidates[{i}].", partial(_patch, item)) for i, item in enumerate(raw.candidates)]
    candidates = tuple(patch for patch in found if patch)
    if len(candidates) < len(raw.candidates):
        return None
    toe_m = None if raw.toe_m is None else np.array(raw.toe_m)
    yaws = tuple(raw.yaws_rad)
    return notes.made(
        place,
        lambda: Foothold(
            limb=raw.limb, frame=raw.frame, candidates=candidates, toe_m=toe_m, yaws_rad=yaws,
            force_min=None if raw.force_min is None else np.array(raw.force_min),
            force_max=None if raw.force_max is None else np.array(raw.force_max),
        ),
    )


def _bounds_to_json(foothold: Foothold) -> dict[str, Any]:
    """A foothold's own bounds of the force, where it has any."""
    if foothold.force_min is None or foothold.force_max is None:
        return {}
    return {"force_min": foothold.force_min.tolist(), "force_max": foothold.force_max.tolist()}


def _weights_to_json(course: Problem) -> dict[str, float]:
    """The objective's weights, all zero of a problem without objective: any plan is as good as another."""
    weights = course.weights or Weights(goal=0.0, com_step=0.0, toe_step=0.0, tilt=0.0)
    return {
        name: value
        for name in _WeightsJson.model_fields
        if (value := getattr(weights, name)) or name not in ("com_path", "stance")
    }


def _patch(raw: _PatchJson) -> Patch:
    return Patch(**raw.model_dump())


def _patch_to_json(patch: Patch) -> dict[str, Any]:
    return {**{name: getattr(patch, name).tolist() for name in _PATCH}, "friction": patch.friction}


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)


class _LimbJson(_Keys):
    name: str
    shoulder_m: list[float]
    reach_m: float
    reach_rows: ReachRowsJson | None = None
    sole_m: list[list[float]] | None = None


class _RelativeReachJson(_Keys):
    limb: str
    other: str
    rows: ReachRowsJson


class _RobotJson(_Keys):
    name: str
    mass_kg: float
    limbs: list[_LimbJson]
    identity: str = ""
    model: ModelJson | None = None
    relative_reach: list[_RelativeReachJson] = []
    legs: DrawnLegsKeys | None = None


class _PatchJson(_Keys):
    vertices_m: list[list[float]]
    normal: list[float]
    shear_reference: list[float]
    friction: float


class _FootholdJson(_Keys):
    limb: str
    frame: int
    toe_m: list[float] | None
    candidates: list[_PatchJson]
    yaws_rad: list[float] = []
    force_min: list[float] | None = None  # of the foothold's own; most have none
    force_max: list[float] | None = None


class _StepsJson(_Keys):
    com_m: float
    toe_m: float
    rotation_rad: float
    progress_m: float
    yaw_rad: float | None = None  # older files have none


class _WeightsJson(_Keys):
    goal: float
    com_path: float = 0.0  # older files have none
    com_step: float
    toe_step: float
    tilt: float
    stance: float = 0.0


class _CourseJson(_Keys):
    format: Literal["stancekit/course/1"]
    name: str
    robot: _RobotJson
    terrain: list[_PatchJson]
    placements: list[_FootholdJson]
    lifts: list[list[str]]
    next_lift: list[str]
    com_nominal_m: list[list[float]]
    com_radius_m: list[float]
    goal_m: list[float]
    force_min: list[float]
    force_max: list[float]
    tilt_limit_rad: float
    gravity_m_s2: float
    length_scale_m: float
    force_scale_n: float | None = None  # the weight
    steps: _StepsJson
    weights: _WeightsJson
    modes: list[int] | None
    push_n: float = 0.0
    standing_m: list[list[list[float]]] | None = None
    wrench: list[list[float]] | None = None
