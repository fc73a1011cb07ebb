"""The scene of the playground: a question, and the handles by which it becomes another one.

No page takes part. A scene is a value: what it is asked for may make no sense, which ``course``
then says in one line.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import yaml_of
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_between import LaidBetween, course_between
from stancekit.planners.problem.course_file import described, spec_from
from stancekit.planners.problem.course_keys import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.robot.model import hexapod
from stancekit.planners.robot.reach_sets import Sets, standing_toes
from stancekit.planners.robot.robot_file import named_robot, robot_of
from stancekit.planners.search.plan_course import LayOut
from stancekit.planners.terrain.patch import Patch

from ..plans import offered

_DEGREES = 180.0 / math.pi


@dataclass(frozen=True, kw_only=True, eq=False)
class Slider:
    """A number of a question that may be slid.

    Arguments:
        path: where it is among the question's keys: names, and the index of one in a list.
        unit: empty where it has none; angles are slid in degrees.
        default: it where the keys have none, or the list that it is in.
        whole: whether only whole numbers make sense.
    """

    key: str
    label: str
    path: tuple[Any, ...]
    unit: str = "μ"
    low: float = 0.0
    high: float = 1.5
    step: float = 0.01
    default: float | tuple[float, ...] = 1.0
    value: float = math.nan
    hint: str = ""
    whole: bool = False

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def scale(self) -> float:
        """Value over the number of the keys."""
        return _DEGREES if self.unit == "°" else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Grip:
    """A place that may be dragged, shape (3,) [m].

    Arguments:
        axes: of the world along which it moves.
    """

    key: str
    label: str
    position_m: Array
    axes: tuple[bool, bool, bool] = (True, True, True)


def _of_terrain(
    key: str, label: str, unit: str, low: float, high: float, step: float, default: Any
) -> Slider:
    """A slider of a number of the terrain; of one in a list the key ends in its index."""
    name, *index = key.split(".")
    return Slider(
        key=key,
        label=label,
        path=("terrain", name, *map(int, index)),
        unit=unit,
        low=low,
        high=high,
        step=step,
        default=default,
    )


_MOST_FRAMES, _MOST_LAID = 40, 60
"""Key frames that follow a goal that is dragged away, and those of a way that is laid out; more are
asked for by hand."""
_FRICTION = Slider(
    key="friction", label="friction of all surfaces", path=("terrain", "friction"), default=1.0
)
_MASS = Slider(
    key="mass_kg", label="mass of the robot", path=("mass_kg",), unit="kg", low=0.1, step=0.1
)
_FRAMES = Slider(
    key="frames",
    label="key frames",
    path=("frames",),
    unit="",
    low=2,
    high=_MOST_FRAMES,
    step=1,
    whole=True,
)
_COURSE = (_FRICTION, _MASS, _FRAMES)
_WALLS = (
    *_COURSE,
    _of_terrain("apart_m", "walls: from the middle to each", "m", 0.15, 0.80, 0.005, 0.38),
    _of_terrain("lean_rad.0", "left wall leans in by", "°", -40.0, 40.0, 0.5, (0.0, 0.0)),
    _of_terrain("lean_rad.1", "right wall leans in by", "°", -40.0, 40.0, 0.5, (0.0, 0.0)),
)
SLIDERS: Mapping[str, tuple[Slider, ...]] = MappingProxyType(
    {
        "walls": _WALLS,
        "icy-walls": _WALLS,
        "ground-to-wall": _WALLS,
        "stairs": (
            *_COURSE,
            _of_terrain("rises_m.0", "rise of a step", "m", -0.20, 0.30, 0.005, (0.06,)),
            _of_terrain("run_m", "depth of a step", "m", 0.10, 0.60, 0.01, 0.26),
            _of_terrain("first_m", "first riser at x", "m", -0.20, 1.00, 0.01, 0.30),
        ),
        "tube": (
            *_COURSE,
            _of_terrain("radius_m", "radius of the tube", "m", 0.20, 0.80, 0.005, 0.40),
            _of_terrain("ring_m", "height of a ring", "m", 0.10, 0.60, 0.01, 0.25),
        ),
        "family": (
            replace(_FRICTION, label="friction, times what was drawn"),
            _MASS,
            _FRAMES,
            _of_terrain("level", "difficulty of the family", "", 0.0, 1.0, 0.01, 0.5),
        ),
        "between": (_FRICTION, replace(_FRAMES, high=_MOST_LAID)),
        "laid": (
            replace(_FRICTION, label="friction of all surfaces, times", unit="", high=2.0),
            _MASS,
        ),
    }
)
"""What may be slid, by the kind of the question, of a course by that of its terrain."""
_SIDES = ("left wall", "right wall")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """A question with the handles by which it is changed.

    Arguments:
        keys: what has handles: of a course all the keys of its file; of another question name,
            robot, ``start_m``, ``goal_m``, the terrain's friction (of a course that is laid out
            already, times what it has), and ``frames``, by the way's length where None.
        given: the question whose fields they take the place of: a way between two places, or a
            course that is laid out; None of a course in the keys of its file.
        folder: where its relative paths begin.
        stride_m: of key frames that follow the goal, None once they were slid [m].
        own_kg: mass of the robot as it is.
    """

    keys: Mapping[str, Any]
    given: LaidBetween | Problem | None = None
    folder: Path = Path()
    stride_m: float | None = None
    own_kg: float = 10.0
    _laid: dict[str, Problem] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, course: str, robot: str | None = None, frames: int | None = None) -> Scenario:
        """The scene of a built-in name, FAMILY:LEVEL:SEED or a YAML file.

        Raises InvalidInput.
        """
        folder = Path(course).parent
        keys = _with_whole_paths(described(course), folder)
        if frames is not None:
            keys["frames"] = frames
        spec = spec_from(keys)
        laid = build_course(spec, folder)
        steps = np.linalg.norm(np.diff(laid.com_nominal_m, axis=0), axis=1)
        stride = spec.stride_m or (float(steps.max()) if len(steps) else 0.05)
        if (
            spec.stride_m is not None
        ):  # the file's goal only says where the way goes; here it is where the way ends
            del keys["stride_m"]
            keys["goal_m"] = laid.goal_m.tolist()
        own = laid.robot
        if "mass_kg" in keys:
            own = spec.model_copy(update={"mass_kg": None}).make_robot(folder)
        made = cls(keys=keys, folder=folder, stride_m=max(stride, 1e-3), own_kg=own.mass_kg)
        return made if robot is None else made.with_robot(robot)

    @classmethod
    def about(cls, given: LaidBetween | Problem, robot: str = "") -> Scenario:
        """The scene of a way between two places, or of a course that is laid out, a posture as one
        of one frame.

        Arguments:
            robot: name or file of its robot, where it may become another one.
        """
        keys: dict[str, Any] = {"robot": robot, "terrain": {"friction": 1.0}}
        if isinstance(given, Problem):
            keys |= {"name": given.name, "goal_m": given.goal_m}
            return cls(keys=keys, given=given, own_kg=given.robot.mass_kg)
        keys["terrain"] = {"friction": given.terrain.friction}
        keys |= {"name": Path(given.terrain.file).stem, "frames": given.frames}
        keys |= {"start_m": given.start_m, "goal_m": given.goal_m}
        return cls(keys=keys, given=given)

    @property
    def name(self) -> str:
        """Name of the question."""
        return str(self.keys["name"])

    @property
    def robot(self) -> str:
        """Name or file of the robot; empty where it cannot be another one, or the file brings it
        with it.
        """
        robot = self.keys.get("robot", "hexapod")
        return robot if isinstance(robot, str) else ""

    @property
    def kind(self) -> str:
        """Kind of the question, of a course in the keys of its file that of its terrain."""
        if self.given is None:
            return str(self.keys["terrain"]["kind"])
        return "laid" if isinstance(self.given, Problem) else "between"

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The ways in which it can be laid out, the first of which is the one that is asked for."""
        return (AS_ASKED,) if isinstance(self.given, Problem) else ALTERNATIVES

    # -----------------------------------------------------------------------------------------------
    # its handles

    def sliders(self) -> tuple[Slider, ...]:
        """What may be slid, with the numbers that there are now."""
        rows, given = SLIDERS.get(self.kind, _COURSE), self.given
        if isinstance(given, Problem):
            most = max(patch.friction for patch in offered(given))
            friction, *mass = rows
            hint = f"Of what the file says: {most:.3g} at most."
            rows = (replace(friction, hint=hint), *([] if given.robot.own else mass))
        return tuple(self._now(row) for row in rows)

    def _now(self, slider: Slider) -> Slider:
        """A slider with the number that there is now."""
        default, high = slider.default, slider.high
        match slider.key:
            case "mass_kg":
                default, high = self.own_kg, 4.0 * self.own_kg
            case "frames":
                laid = self._laid.get(_AS_ASKED)
                default = 2 if laid is None else laid.frames
        value = slider.scale * float(_at(self.keys, slider.path, default))
        return replace(slider, value=value, low=min(slider.low, value), high=max(high, value))

    def slid(self, key: str, value: float) -> Scenario:
        """Another value of a slider."""
        slider = next(each for each in self.sliders() if each.key == key)
        number = int(value) if slider.whole else float(value) / slider.scale
        keys = _put(self.keys, slider.path, number, slider.default)
        if key == "friction" and self.kind == "polygons":
            polygons = [{**each, "friction": number} for each in keys["terrain"]["polygons"]]
            keys["terrain"]["polygons"] = polygons
        return self._with(keys, stride_m=None if key == "frames" else self.stride_m)

    def grips(self, asked: Problem) -> tuple[Grip, ...]:
        """Start and goal, as far as nothing is laid out about them, and both walls.

        Arguments:
            asked: what ``course`` gave.
        """
        kind, result = self.kind, list[Grip]()
        ends = {"start": asked.com_nominal_m[0], "goal": asked.goal_m}
        if SLIDERS.get(kind) is _WALLS:
            middle, terrain = asked.com_nominal_m.mean(axis=0), self.keys["terrain"]
            for side, name in enumerate(_SIDES):
                away = _at(terrain, ("apart_m",), 0.38) + _at(terrain, ("offset_m", side), 0.0)
                at = np.array([middle[0], (1.0, -1.0)[side] * away, ends["start"][2]])
                result.append(Grip(key=name, label=name, position_m=at, axes=(False, True, False)))
        if result or kind == "laid":
            del ends["start"]
        axes = (True, True, kind != "between")
        result += [Grip(key=key, label=key, position_m=at, axes=axes) for key, at in ends.items()]
        return tuple(result)

    def dragged(self, key: str, position_m: Array) -> Scenario:
        """Another place of a grip, shape (3,) [m]; key frames are as many as the way to a goal takes
        at the stride, unless they were slid.
        """
        place = [round(float(value), 4) for value in position_m]
        if key in _SIDES:
            side = _SIDES.index(key)
            away = (1.0, -1.0)[side] * place[1] - _at(self.keys["terrain"], ("apart_m",), 0.38)
            path = ("terrain", "offset_m", side)
            return self._with(_put(self.keys, path, round(away, 4), (0.0, 0.0)))
        keys = {**self.keys, f"{key}_m": place[:2] if self.kind == "between" else place}
        if self.stride_m is not None:
            keys["frames"] = _frames_along(keys, self.stride_m)
        return self._with(keys)

    def with_robot(self, robot: str) -> Scenario:
        """Scenario for another robot, a built-in name or a file, which stands and steps as it does.

        Raises InvalidInput, also where footholds are those of one robot.
        """
        keys = {**self.keys, "robot": _whole_path(robot)}
        if isinstance(self.given, Problem):
            raise InvalidInput(
                f"robot: expected the robot of a course whose footholds are fixed, got {robot}"
            )
        if self.given is not None:
            return self._with(keys, given=replace(self.given, robot=robot_of(robot)))
        keys, own = with_robot(self.keys, self.folder, robot)
        return self._with(keys, own_kg=own)

    def _with(self, keys: Mapping[str, Any], **changes: Any) -> Scenario:
        return replace(self, keys=keys, _laid={}, **changes)

    # -----------------------------------------------------------------------------------------------
    # what is asked

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The question that is asked, or one that is laid out in another way, once in each.

        Raises InvalidInput or PlanningFailed in one line.
        """
        way = f"{sets} {alternative.message}"
        if way not in self._laid:
            match self.given:
                case LaidBetween():
                    course = self.between(sets, alternative)
                case Problem():
                    course = self._changed(self.given)
                case None:
                    spec = spec_from(self.keys)
                    course = build_course(spec, self.folder, sets, alternative=alternative)
            self._laid[way] = course
        return self._laid[way]

    @property
    def question(self) -> LayOut:
        """The question as ``plan_course`` takes it."""
        return self.between if isinstance(self.given, LaidBetween) else self.course

    @cached_property
    def between(self) -> LaidBetween:
        """The question that ``stancekit plan`` asks, made once."""
        assert isinstance(self.given, LaidBetween)
        keys, terrain = self.keys, self.given.terrain
        return replace(
            self.given,
            terrain=terrain.model_copy(update=keys["terrain"]),
            start_m=keys["start_m"],
            goal_m=keys["goal_m"],
            frames=keys["frames"],
        )

    def _changed(self, given: Problem) -> Problem:
        """A course that is laid out, with the goal, the friction and the mass that are asked for."""
        by, goal_m = self.keys["terrain"]["friction"], np.array(self.keys["goal_m"])
        robot = given.robot
        if "mass_kg" in self.keys:
            robot = replace(robot, mass_kg=self.keys["mass_kg"])

        def rubbed(patches: Sequence[Patch]) -> tuple[Patch, ...]:
            return tuple(patch.with_friction(by * patch.friction) for patch in patches)

        footholds = tuple(
            replace(each, candidates=rubbed(each.candidates)) for each in given.footholds
        )
        terrain = rubbed(given.terrain)
        return replace(given, goal_m=goal_m, robot=robot, terrain=terrain, footholds=footholds)

    def text(self) -> tuple[str, str]:
        """The course's file: how its name ends, and its text."""
        keys = self.keys
        if isinstance(self.given, Problem):
            return ".json", json.dumps(self.course().to_json(), indent=1) + "\n"
        if self.given is not None:
            asked = self.between
            spec = course_between(
                asked.terrain, asked.start_m, asked.goal_m, robot=self.robot, frames=asked.frames
            )
            keys = spec.model_dump(mode="json", exclude_defaults=True)
            keys["terrain"]["kind"] = asked.terrain.kind
            for key in ("start_m", "goal_m"):  # to a tenth of a millimetre
                keys[key] = np.round(keys[key], 4).tolist()
            keys["via_m"] = [np.round(each, 4).tolist() for each in keys.get("via_m", [])]
        return ".yaml", yaml_of(_plain(keys))


_AS_ASKED = f"inner {AS_ASKED.message}"
"""The name of the layout that is asked for."""


def _frames_along(keys: Mapping[str, Any], stride_m: float) -> int:
    """Number of key frames of the way of a course at a stride."""
    via = [
        each if isinstance(each, list | tuple) else each["at_m"] for each in keys.get("via_m", ())
    ]
    start = [*keys["start_m"], keys["goal_m"][2]][:3]
    way = np.array([start, *via, keys["goal_m"]], dtype=np.float64)
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    wanted, most = math.ceil(length / stride_m - 1e-6) + 1, max(_MOST_FRAMES, int(keys["frames"]))
    return max(2, min(wanted, most))


# ------------------------------------------------------------------------------------------------
# keys of a course


_OURS = ("stance", "gait", "robot", "mass_kg")
"""Keys that say how the robot before stood."""


def with_robot(keys: Mapping[str, Any], folder: Path, robot: str) -> tuple[dict[str, Any], float]:
    """The keys for another robot, a built-in name or a file, and its mass [kg].

    Raises InvalidInput for none.

    On ground its path is as much higher as it stands higher; between walls it stays.
    """
    changed = {key: value for key, value in keys.items() if key not in _OURS}
    changed["robot"] = _whole_path(robot)
    model = named_robot(robot)
    down = _stands_m(keys, folder)
    if robot == "hexapod":
        changed["gait"], height = "tripod", 0.20
        changed["stance"] = (
            {"outward_m": 0.13, "down_m": 0.20}
            if down > 0.02
            else {"outward_m": 0.08, "down_m": 0.0}
        )
    else:
        changed["gait"] = "tripod" if len(model.legs) >= 6 and len(model.legs) % 2 == 0 else "wave"
        height = -float(standing_toes(model)[:, 2].mean())
    if down > 0.02:
        for key in ("start_m", "goal_m"):
            changed[key] = _raised(changed[key], height - down)
        changed["via_m"] = [
            _raised(each, height - down)
            if isinstance(each, list | tuple)
            else {"at_m": _raised(each["at_m"], height - down)}
            for each in changed.get("via_m", ())
        ]
    return changed, hexapod().mass_kg if robot == "hexapod" else model.mass_kg


def _stands_m(keys: Mapping[str, Any], folder: Path) -> float:
    """Height of the centre of mass above its toes on the course as it is [m]; 0 between walls."""
    spec = spec_from(keys)
    robot = spec.make_robot(folder)
    if not robot.own:
        return spec.stance.down_m
    return -float(np.mean(standing_toes(robot.own_model())[:, 2]))


def _raised(place: Any, by_m: float) -> Any:
    """A place (x, y, z), higher; one of x and y alone stays."""
    return place if len(place) == 2 else [place[0], place[1], round(float(place[2]) + by_m, 4)]


def _whole_path(robot: str, folder: Path = Path()) -> str:
    """The name of a robot; of a file one that means the same from every folder."""
    return str((folder / robot).resolve()) if Path(robot).suffix else robot


def _with_whole_paths(keys: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The keys with names of files that mean the same from every folder."""
    whole, terrain = dict(keys), keys.get("terrain")
    if isinstance(robot := keys.get("robot"), str):
        whole["robot"] = _whole_path(robot, folder)
    if isinstance(terrain, Mapping) and isinstance(terrain.get("file"), str):
        whole["terrain"] = {**terrain, "file": str((folder / terrain["file"]).resolve())}
    return whole


def _at(keys: Any, path: Sequence[Any], default: Any) -> Any:
    """The number at a path of names and indices; where nothing is there the default, or the number
    at the path's end of the default list.
    """
    for part in path:
        keys = keys.get(part) if isinstance(keys, Mapping) else keys[part]
        if keys is None:
            return default[path[-1]] if isinstance(default, tuple) else default
    return keys


def _put(keys: Any, path: Sequence[Any], value: Any, default: Any = ()) -> Any:
    """The keys with another value at a path; a list that is not there begins as the default."""
    part, *rest = path
    if rest:
        value = _put(keys.get(part) or list(default), rest, value, default)
    if isinstance(keys, Mapping):
        return {**keys, part: value}
    return [*keys[:part], value, *keys[part + 1 :]]


def _plain(value: Any) -> Any:
    """Keys, lists and numbers as YAML writes them."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
