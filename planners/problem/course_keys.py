"""The keys of a course's file, and the alternative layouts that are tried of it: wider, lower or
higher stances, more candidates, another order of the limbs.

Keys are what a person writes, typed, and refused where they make no sense.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    field_validator,
    model_validator,
)

from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array
from ..files.codec import KEYS
from ..robot.leg import Servo
from ..robot.model import Limb, ReachRows, Robot, hexapod
from .course_terrain import ROOM_M, AnyTerrain, Length, Point, Positive, SolePoints
from .posture import TILT_LIMIT_RAD
from .problem import MOST_FRAMES, StepLimits

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets
    from ..robot.robot_model import RobotModel


AS_IT_STANDS = 0.3
"""Weight of toes near where they are as a robot of a file stands, so that it does not walk them in
to a line."""
_UPRIGHT = 0.1
"""Weight of the nominal path for a robot of a file: lower, its shanks lie across the edges of
steps."""
_BODY_ROOM = 0.2
"""Distance that the body of a robot of a file may have from its nominal path, in units of its
height, where that is more."""
LEVEL_RAD = 0.1
"""Tilt limit of plans over inner sets: at 15° these lose as much to the tilt as a quadruped's legs
have to spare."""
_ROLLS_RAD = 0.6
"""A leg that stands turns by as much to either side, and its foot, which is round, rolls as far
times its radius."""
_MOST_EVERYWHERE = 32
"""Surfaces that a limb may reach in a scene of a family; elsewhere views may need another size."""
_Least = Annotated[float, Field(ge=0.0, le=LARGEST)]


PLAIN, MADE_UP = "(plain)", "(made up)"
"""Tags of values that a file may either name, or give as a list or as keys of its own; no part of
any key."""


def _shape(value: Any) -> str:
    return MADE_UP if isinstance(value, Mapping | list | BaseModel) else PLAIN


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class LimbSpec(_Keys):
    """One limb of a robot that the file brings with it."""

    shoulder_m: Point
    reach_m: Positive
    reach_rows: Annotated[ReachRows, KEYS] | None = None
    sole_m: SolePoints | None = None

    def make(self, name: str) -> Limb:
        """The limb of this name."""
        sole = None if self.sole_m is None else np.array(self.sole_m)
        shoulder = np.array(self.shoulder_m)
        return Limb(
            name=name,
            shoulder_m=shoulder,
            reach_m=self.reach_m,
            reach_rows=self.reach_rows,
            sole_m=sole,
        )


class RobotSpec(_Keys):
    """A robot that the file brings with it: its mass and its limbs by name, and legs where they
    shall be drawn up.

    Without legs the plan is judged as far as contacts, forces and reach go.
    """

    name: str = "robot"
    mass_kg: Positive
    limbs: Annotated[dict[str, LimbSpec], Field(min_length=1)]
    legs: Annotated[Servo, KEYS] | None = None

    @field_validator("legs", mode="before")
    @classmethod
    def _are_asked_for(cls, legs: Any) -> Any:
        """The key alone, which YAML reads as null, asks for legs as they usually are."""
        return {} if legs is None else legs

    @model_validator(mode="after")
    def _agree(self) -> RobotSpec:
        if self.legs is not None:
            for name, limb in self.limbs.items():
                more = [key for key in ("sole_m", "reach_rows") if getattr(limb, key) is not None]
                if more:
                    raise InvalidInput(
                        f"legs: expected limbs of a ball of reach and a point foot, got {more[0]} "
                        f"of limb {name}"
                    )
        return self

    def make(self) -> Robot:
        """The robot."""
        limbs = tuple(limb.make(name) for name, limb in self.limbs.items())
        return Robot(name=self.name, mass_kg=self.mass_kg, limbs=limbs, drawn=self.legs)


class StanceSpec(_Keys):
    """Place that a limb likes for its toe: this far outward from the shoulder, away from the body's
    axis, and below it [m].

    Arguments:
        limbs: other offsets (x, y, z) from the shoulder, in the body frame, of single limbs.
    """

    outward_m: Length = 0.15
    down_m: Length = 0.20
    limbs: dict[str, Point] = {}


class ViaSpec(_Keys):
    """A point that the nominal path goes through.

    Arguments:
        stance: how to stand from there on.
    """

    at_m: Point
    stance: StanceSpec | None = None


def _point_or_more(value: Any) -> str:
    return MADE_UP if isinstance(value, Mapping | BaseModel) else PLAIN


def _flat_or_not(value: Any) -> str:
    return MADE_UP if isinstance(value, list | tuple) and len(value) == 2 else PLAIN


_RobotKey = Annotated[
    Annotated[str, Tag(PLAIN)] | Annotated[RobotSpec, Tag(MADE_UP)], Discriminator(_shape)
]
_StartKey = Annotated[
    Annotated[Point, Tag(PLAIN)] | Annotated[tuple[Length, Length], Tag(MADE_UP)],
    Discriminator(_flat_or_not),
]
_GaitKey = Annotated[
    Annotated[Literal["all", "tripod", "wave"], Tag(PLAIN)]
    | Annotated[list[list[str]], Field(min_length=1), Tag(MADE_UP)],
    Discriminator(_shape),
]
_ViaKey = Annotated[
    Annotated[Point, Tag(PLAIN)] | Annotated[ViaSpec, Tag(MADE_UP)], Discriminator(_point_or_more)
]


class BodySpec(_Keys):
    """Bounds of the COM about its nominal path, and at the first and last frame; and the largest
    body rotation. Of a robot of a file the former is a fifth of its height where that is more, and
    the latter 0.1 rad for plans.
    """

    com_radius_m: _Least = 0.06
    first_radius_m: _Least = 0.02
    last_radius_m: _Least | None = None
    tilt_limit_rad: Annotated[float, Field(ge=0.0, le=0.5)] = TILT_LIMIT_RAD


class CandidateSpec(_Keys):
    """Pieces of terrain that a toe is offered: the ``count`` nearest surfaces, clipped to a square
    window about its nominal place, ``margin_m`` away from every border of the surface, by default
    ``ROOM_M`` beyond the radius of a foot and how far it rolls, where a robot's file says what that
    is. A sole is offered each of them with every one of ``yaws_rad`` for which there is room; its
    window is larger by the sole.

    Arguments:
        everywhere: offer all that a limb could reach wherever the body may be, in place of
            ``count`` and ``window_m``, so that a proof that there is no plan holds for the whole
            terrain.
    """

    count: Annotated[int, Field(ge=1, le=16)] = 1
    window_m: Annotated[float, Field(ge=0.01, le=10.0)] = 0.26
    margin_m: _Least = 0.02
    yaws_rad: Annotated[list[Length], Field(min_length=1, max_length=16)] = [0.0]
    everywhere: bool = False

    @property
    def most(self) -> int:
        """Largest number of a toe's candidates, for views of a fixed size."""
        return _MOST_EVERYWHERE if self.everywhere else self.count


class WeightSpec(_Keys):
    """Weights of the objective, see ``Weights``."""

    goal: _Least = 1.0
    com_path: _Least = 0.0
    com_step: _Least = 0.2
    toe_step: _Least = 0.05
    tilt: _Least = 0.05
    stance: _Least = 0.0


class WrenchSpec(_Keys):
    """A force and a moment on the body beside its weight, in the axes of the world."""

    force_n: Point = (0.0, 0.0, 0.0)
    moment_nm: Point = (0.0, 0.0, 0.0)
    at_m: Point = (0.0, 0.0, 0.0)
    frames: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] | None = None


class CourseSpec(_Keys):
    """A course as a person writes it.

    Arguments:
        frames: number of key frames M.
        gait: limbs that move between frames, by the name of a gait or as a list of sets of limbs,
            which is repeated.
        start_m, via_m, goal_m: the nominal path of the COM, straight between them; start_m may be x
            and y alone, and the height is that in which the robot stands on the terrain there.
        stride_m: distance of neighbouring frames along it; the last line is then gone on, or cut
            short, as the number of frames has it, and where that ends is the goal. Without it the
            frames are spread evenly from start to goal.
        push_n: horizontal push at the centre of mass that every stance has to bear in every
            direction.
        wrench: forces and moments on the body in addition to its weight; several add up.
        mass_kg: mass of the robot with all that it carries, in place of its own; for a robot from a
            file the body gets the difference.
    """

    name: str
    robot: _RobotKey = "hexapod"
    mass_kg: Positive | None = None
    frames: Annotated[int, Field(ge=1, le=MOST_FRAMES)]
    gait: _GaitKey = "tripod"
    start_m: _StartKey
    via_m: list[_ViaKey] = []
    goal_m: Point
    stride_m: Positive | None = None
    stance: StanceSpec = StanceSpec()
    body: BodySpec = BodySpec()
    steps: Annotated[StepLimits, KEYS] = StepLimits()
    weights: WeightSpec = WeightSpec()
    candidates: CandidateSpec = CandidateSpec()
    push_n: _Least = 0.0
    wrench: list[WrenchSpec] = []
    terrain: AnyTerrain
    _given: Robot | None = PrivateAttr(None)
    _models: dict[Any, Any] = PrivateAttr(default_factory=dict)

    def of_robot(self, robot: Robot | str) -> CourseSpec:
        """Specification for another robot: a name or a file, as the key ``robot`` has it, or a
        ``Robot`` as it is.
        """
        if isinstance(robot, str):
            return type(self).model_validate({**self.model_dump(), "robot": robot})
        made = self.model_copy()
        made._given = robot
        return made

    def standing(self, robot: Robot, sets: Sets = "inner") -> CourseSpec:
        """Specification with toes where the robot has them as it stands, if the file does not say
        where they should be: so far from borders of surfaces, where a riser may be, that the feet
        have room, and near the nominal path, from which a high body may be farther than a low one.
        Inner sets, which shrink with the tilt, get less tilt. Nothing changes for a robot without
        legs of its own.
        """
        if not robot.own:
            return self
        from ..robot.reach_sets import standing_toes

        model = robot.own_model()
        update: dict[str, Any] = {}
        if "margin_m" not in self.candidates.model_fields_set or self.candidates.everywhere:
            rolls = (
                0.0 if self.candidates.everywhere else _ROLLS_RAD
            )  # proofs are of all that a foot may stand on
            margin = max(
                self.candidates.margin_m,
                *((1.0 + rolls) * leg.radius_m + ROOM_M for leg in model.legs),
            )
            update["candidates"] = self.candidates.model_copy(update={"margin_m": margin})
        body = {}
        if "com_radius_m" not in self.body.model_fields_set:
            high_m = -float(standing_toes(model)[:, 2].mean())
            body["com_radius_m"] = max(self.body.com_radius_m * robot.size, _BODY_ROOM * high_m)
        if "tilt_limit_rad" not in self.body.model_fields_set and sets == "inner":
            soles = any(limb.sole_m is not None for limb in robot.limbs)  # whose legs have no room
            body["tilt_limit_rad"] = 0.0 if soles else LEVEL_RAD
        if body:
            update["body"] = self.body.model_copy(update=body)
        if "com_path" not in self.weights.model_fields_set:
            update["weights"] = self.weights.model_copy(update={"com_path": _UPRIGHT})
        if "stance" not in self.weights.model_fields_set:
            weights = update.get("weights", self.weights)
            update["weights"] = weights.model_copy(update={"stance": AS_IT_STANDS})
        if "stance" not in self.model_fields_set:
            offsets = standing_toes(model) - np.array([limb.shoulder_m for limb in robot.limbs])
            limbs = {
                limb.name: tuple(offset.tolist())
                for limb, offset in zip(robot.limbs, offsets, strict=True)
            }
            update["stance"] = StanceSpec(limbs=limbs)
        return self.model_copy(update=update)

    def make_robot(self, folder: Path = Path(), sets: Sets = "inner") -> Robot:
        """The robot of the course.

        Arguments:
            folder: folder from which a path of its file starts.
            sets: sets of its legs, see ``contact_robot``.

        Raises:
            InvalidInput: for a robot that cannot be read.
        """
        robot, mass_kg = self._given, self.mass_kg
        if not isinstance(self.robot, str):
            robot = robot or self.robot.make()
        elif self.robot == "hexapod":
            robot = robot or hexapod()
        if robot is not None and not robot.own:
            return robot if mass_kg is None else replace(robot, mass_kg=mass_kg)
        if robot is not None and mass_kg is None:
            return robot if sets == "inner" else robot.sets(sets, self.body.tilt_limit_rad)
        from ..robot.walker import contact_robot, with_mass

        model = self._named(folder) if robot is None else robot.own_model()
        model = model if mass_kg is None else with_mass(model, mass_kg)
        return contact_robot(model, sets=sets, tilt_rad=self.body.tilt_limit_rad)

    def _named(self, folder: Path) -> RobotModel:
        """The model of the robot that the key ``robot`` names, read once.

        Raises InvalidInput.
        """
        from ..robot.robot_file import named_robot

        assert isinstance(self.robot, str)
        name = folder / self.robot if Path(self.robot).suffix else self.robot
        if name not in self._models:
            try:
                self._models[name] = named_robot(name)
            except InvalidInput as error:
                raise InvalidInput(f"robot: {str(error).removeprefix('robot: ')}") from None
        model: RobotModel = self._models[name]
        return model

    def level(self) -> BodySpec:
        """Limits of a body that does not tilt, so that inner sets, which shrink with it, are
        larger.
        """
        return self.body.model_copy(update={"tilt_limit_rad": 0.0})

    def with_frames(self, frames: int) -> CourseSpec:
        """Specification with another number of key frames.

        Raises InvalidInput.
        """
        if (
            isinstance(frames, bool)
            or not isinstance(frames, int)
            or not 1 <= frames <= MOST_FRAMES
        ):
            raise InvalidInput(f"frames: expected 1 to {MOST_FRAMES} key frames, got {frames!r}")
        return self.model_copy(update={"frames": frames})


def toe_offset(limb: Limb, stance: StanceSpec) -> Array:
    """From the shoulder to where the limb likes its toe, body frame, shape (3,) [m]."""
    if limb.name in stance.limbs:
        return np.array(stance.limbs[limb.name])
    out = limb.shoulder_m * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(out))
    return stance.outward_m * out / max(length, 1e-12) - [0.0, 0.0, stance.down_m]


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """One way to lay a course out, beside the one that its description asks for.

    None is better everywhere. Where the legs cannot do a plan over one, another often has one that
    they can: which, is known from a list of robots and grounds.

    Arguments:
        spread: horizontal distance of the toes from the centre of mass as the robot stands, as a
            factor.
        height: height of the body over the toes as the robot stands, as a factor.
        candidates: further candidates per foothold.
        near_toes: whether toes are drawn to where they are as the robot stands, where the description
            says so.
        level: whether the tilt limit is 0: inner sets of legs, which shrink with it, are larger
            then.
        gait: "wave" moves one limb after the other, along one side and then the other, each from
            the rear to the front; None keeps the gait.
        striding: whether legs step over what is in their way, as for ``guide_path``: footholds may be
            farther from where toes like to be, and contacts are searched anew with room for legs
            beside walls.
        free: factor on how far the body may be from its nominal path, and on the longest steps.
    """

    spread: float = 1.0
    height: float = 1.0
    candidates: int = 0
    near_toes: bool = True
    level: bool = False
    gait: Literal["wave"] | None = None
    striding: bool = False
    free: float = 1.0

    def of(self, spec: CourseSpec, robot: Robot, *, mirrored: bool = False) -> CourseSpec:
        """The description with these changes.

        Arguments:
            robot: the robot whose limbs are placed.
            mirrored: whether the right side moves first, not the left.
        """
        update: dict[str, object] = {}
        if (self.spread, self.height) != (1.0, 1.0):
            scale = np.array([self.spread, self.spread, self.height])
            limbs = {
                limb.name: tuple((scale * toe - limb.shoulder_m).tolist())
                for limb in robot.limbs
                for toe in [limb.shoulder_m + toe_offset(limb, spec.stance)]
            }
            update["stance"] = StanceSpec(limbs=limbs)
        if self.candidates:
            count = min(spec.candidates.count + self.candidates, 16)
            update["candidates"] = spec.candidates.model_copy(update={"count": count})
        if not self.near_toes:
            update["weights"] = spec.weights.model_copy(update={"stance": 0.0})
        if self.level:
            update["body"] = spec.level()
        if self.gait is not None:
            left = -1.0 if mirrored else 1.0
            order = sorted(
                robot.limbs, key=lambda limb: (left * limb.shoulder_m[1] < 0.0, limb.shoulder_m[0])
            )
            update["gait"] = [[limb.name] for limb in order]
        return spec.model_copy(update=update)

    @property
    def message(self) -> str:
        """The changes in words; empty where there are none."""
        parts = [
            f"toes {self.spread:g} × as far out" if self.spread != 1.0 else "",
            f"body {self.height:g} × as high" if self.height != 1.0 else "",
            f"{self.candidates} more candidates per foothold" if self.candidates else "",
            "" if self.near_toes else "toes wherever they may be",
            "body level" if self.level else "",
            "one limb after the other, side by side" if self.gait else "",
            "legs step over what the trunk gets over" if self.striding else "",
            f"steps {self.free:g} × as long" if self.free != 1.0 else "",
        ]
        return ", ".join(filter(None, parts))


AS_ASKED = Alternative()
HIGHER = Alternative(height=1.15)
"""The layout that is tried first where a foot alone stays from its path: its leg has no room to
lift it."""
KNEES_BENT = Alternative(height=0.92)
"""The layout that is tried first after that which was asked for where feet are soles: knees that are
bent more have room for soles that lean."""

STRIDES = (
    Alternative(striding=True, free=2.0),
    Alternative(striding=True, free=2.0, height=1.15),
    Alternative(striding=True, free=2.0, spread=1.15, height=0.8),
    Alternative(striding=True),
    Alternative(striding=True, height=1.15),
)
"""The layouts that are tried last between two places: in long steps, with a body that goes ahead of
its feet or stays behind them, and in usual ones, which come first, before all others, where there
are walls and legs that go through something."""
LOW = (
    Alternative(height=0.7),
    Alternative(height=0.6),
    Alternative(spread=1.5, height=0.5),
    Alternative(spread=1.65, height=0.4),
)
"""The layouts that are tried last where the first has no way, and first where it would fit below what
bars its way if it stood lower: of knees that stick out, wide ones alone are low."""
ALTERNATIVES = (
    AS_ASKED,
    Alternative(spread=1.15, height=0.85),
    Alternative(spread=1.08),
    Alternative(near_toes=False),
    Alternative(candidates=2),
    Alternative(level=True),
    Alternative(gait="wave"),
    Alternative(spread=1.15, height=1.08, candidates=2),
    HIGHER,
)
"""The layouts that there are; the first is tried first."""
LEANING = (
    Alternative(spread=1.25, height=0.8),
    AS_ASKED,
    Alternative(spread=0.9, height=0.8),
    Alternative(spread=0.9, height=0.8, near_toes=False),
    Alternative(spread=1.15),
)
"""The layouts that are looked at first on steep ground: legs of low ones have room uphill and length
downhill, and those of wide ones stand firmly."""
TABLE = Path(__file__).with_name("layouts.json")
"""By what is missing over the first layout, the others with their successes there, in the order in
which each next one adds most: ``benchmarks/stands.py layouts``."""
Missing = Literal["contacts", "body"]
"""No plan of contacts was found, or one that the legs cannot do."""


def ordered(layouts: Iterable[Alternative], missing: Missing) -> list[Alternative]:
    """Sort layouts in the order that the table of successes gives; those that it does not have come
    last as they are.
    """
    names = [row["layout"] for row in json.loads(TABLE.read_text(encoding="utf-8"))[missing]]
    places = {name: place for place, name in enumerate(names)}
    return sorted(layouts, key=lambda each: places.get(each.message, len(places)))
