"""Scenes of the playground: a question, and the handles by which it becomes another one.

No page takes part. A scene is a value: what it is asked for may make no sense, which ``course``
then says in one line.
"""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import yaml_of
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_between import LaidBetween, course_between
from stancekit.planners.problem.course_file import described, spec_from
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.terrain_spec import FileTerrain, polygon_keys
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot, hexapod
from stancekit.planners.robot.reach_sets import Sets, standing_toes
from stancekit.planners.robot.robot_file import named_robot, robot_of
from stancekit.planners.robot.walker import named_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.patch import Patch

SURFACE = "surface"
"""Key of the grip of the surface that was picked, and of the slider of its friction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slider:
    """A number that may be slid.

    Arguments:
        to: the scene with another one.
        unit: empty where it has none.
        whole: whether only whole numbers make sense.
    """

    key: str
    label: str
    to: Callable[[float], Scenario]
    unit: str = "μ"
    low: float = 0.0
    high: float = 1.5
    step: float = 0.01
    value: float
    hint: str = ""
    whole: bool = False

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario(ABC):
    """A question with the handles by which it is changed: sliders, grips, robots and surfaces."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the question."""

    @property
    def robot(self) -> str:
        """The name or file of the robot; empty where it cannot be another one."""
        return ""

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The ways in which it can be laid out, the first of which is the one that is asked for."""
        return ALTERNATIVES

    @abstractmethod
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders of the scene."""

    @abstractmethod
    def grips(self, asked: Any) -> tuple[Grip, ...]:
        """Grips of the scene, which may be dragged.

        Arguments:
            asked: what ``course`` gave.
        """

    def slid(self, key: str, value: float) -> Any:
        """Another value of a slider."""
        return next(each for each in self.sliders() if each.key == key).to(float(value))

    @abstractmethod
    def dragged(self, key: str, position_m: Array) -> Scenario:
        """Another place of a grip, shape (3,) [m]."""

    def picked(self, course: Problem, patch: int) -> Scenario:
        """Scenario with a grip at this patch of the course's terrain.

        Raises InvalidInput where surfaces are those of a file.
        """
        raise InvalidInput(
            "surface: expected a course of surfaces to pick one of, got a terrain's file"
        )

    def with_robot(self, robot: str) -> Scenario:
        """Scenario for another robot, a built-in name or a file.

        Raises InvalidInput where footholds are those of one robot.
        """
        raise InvalidInput(
            f"robot: expected the robot of a course whose footholds are fixed, got {robot}"
        )

    @abstractmethod
    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Any:
        """The question that is asked, or one that is laid out in another way.

        Raises InvalidInput or PlanningFailed in one line.
        """

    def text(self) -> tuple[str, str]:
        """The course's file: how its name ends, and its text.

        Raises InvalidInput for a scene that is no course.
        """
        raise InvalidInput(f"course: expected one to save, got a walk over {self.name}")


def _of_mass(value: float, own_kg: float, to: Callable[[float], Scenario]) -> Slider:
    """The slider of the robot's mass, up to four times its own."""
    return Slider(
        key="mass_kg",
        label="mass of the robot",
        unit="kg",
        low=0.1,
        high=4.0 * own_kg,
        step=0.1,
        value=value,
        to=to,
    )


def _of_frames(value: int, low: int, most: int, to: Callable[[float], Scenario]) -> Slider:
    """The slider of the number of key frames."""
    return Slider(
        key="frames",
        label="key frames",
        unit="",
        low=low,
        high=max(most, value),
        step=1,
        value=value,
        whole=True,
        to=to,
    )


def _of_surface(value: float, to: Callable[[float], Scenario]) -> Slider:
    """The slider of the picked surface's friction."""
    return Slider(key=SURFACE, label="friction of the picked surface", value=value, to=to)


_OURS = ("stance", "gait", "robot", "mass_kg")
"""Keys that say how the robot before stood."""


def with_robot(keys: Mapping[str, Any], folder: Path, robot: str) -> tuple[dict[str, Any], float]:
    """The keys for another robot, a built-in name or a file, and its mass [kg].

    Raises InvalidInput for none.

    On ground its path is as much higher as it stands higher; between walls it stays.
    """
    name = str(Path(robot).resolve()) if Path(robot).suffix else robot
    changed = {key: value for key, value in keys.items() if key not in _OURS} | {"robot": name}
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


def own_kg(spec: CourseSpec, folder: Path) -> float:
    """Mass of a course's robot without what its key mass_kg says [kg]."""
    plain = spec.model_copy(update={"mass_kg": None})
    return plain.make_robot(folder).mass_kg


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


_MOST_FRAMES = 40
"""Key frames that follow a goal that is dragged away; more are asked for by hand."""
_DEGREES = 180.0 / math.pi
_OF_TERRAIN: Mapping[
    str, tuple[tuple[tuple[str, ...], str, str, float, float, float, float], ...]
] = {
    "walls": (
        (("apart_m",), "walls: from the middle to each", "m", 0.15, 0.80, 0.005, 0.38),
        (("lean_rad", "0"), "left wall leans in by", "°", -40.0, 40.0, 0.5, 0.0),
        (("lean_rad", "1"), "right wall leans in by", "°", -40.0, 40.0, 0.5, 0.0),
    ),
    "stairs": (
        (("rises_m", "0"), "rise of a step", "m", -0.20, 0.30, 0.005, 0.06),
        (("run_m",), "depth of a step", "m", 0.10, 0.60, 0.01, 0.26),
        (("first_m",), "first riser at x", "m", -0.20, 1.00, 0.01, 0.30),
    ),
    "tube": (
        (("radius_m",), "radius of the tube", "m", 0.20, 0.80, 0.005, 0.40),
        (("ring_m",), "height of a ring", "m", 0.10, 0.60, 0.01, 0.25),
    ),
    "family": ((("level",), "difficulty of the family", "", 0.0, 1.0, 0.01, 0.5),),
}
"""By kind of terrain its keys that are slid: path of the key, label, unit, from, to, step, and the
default."""
_LIKE = {"icy-walls": "walls", "ground-to-wall": "walls"}
_SIDES = ("left wall", "right wall")


@dataclass(frozen=True, kw_only=True, eq=False)
class KeysScenario(Scenario):
    """A course in the keys of its file.

    Arguments:
        keys: as YAML has them.
        folder: where its relative paths begin.
        stride_m: of key frames that follow the goal, [m].
        chosen: which of its polygons has a grip.
        own_kg: mass of the robot as it is.
        follows: whether the number of frames follows the goal.
    """

    keys: Mapping[str, Any]
    folder: Path = Path()
    stride_m: float = 0.05
    chosen: int | None = None
    own_kg: float = 10.0
    follows: bool = True
    _built: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, course: str, robot: str | None = None, frames: int | None = None) -> KeysScenario:
        """The scene of a built-in name, FAMILY:LEVEL:SEED or a YAML file.

        Raises InvalidInput.
        """
        keys = _with_whole_paths(described(course), Path(course).parent)
        if frames is not None:
            keys["frames"] = frames
        spec = spec_from(keys)
        scenario = cls(keys=keys, folder=Path(course).parent)
        laid = build_course(spec, scenario.folder)
        steps = np.linalg.norm(np.diff(laid.com_nominal_m, axis=0), axis=1)
        stride = spec.stride_m or (float(steps.max()) if len(steps) else 0.05)
        if (
            spec.stride_m is not None
        ):  # the file's goal only says where the way goes; here it is where the way ends
            del keys["stride_m"]
            keys["goal_m"] = laid.goal_m.tolist()
        mass = laid.robot.mass_kg if "mass_kg" not in keys else own_kg(spec, scenario.folder)
        scenario = replace(scenario, keys=keys, stride_m=max(stride, 1e-3), own_kg=mass)
        return scenario if robot is None else scenario.with_robot(robot)

    @property
    def name(self) -> str:
        """Name of the course."""
        return str(self.keys["name"])

    @property
    def robot(self) -> str:
        """Name or file of the robot; empty for one that the file brings with it."""
        robot = self.keys.get("robot", "hexapod")
        return robot if isinstance(robot, str) else ""

    @property
    def kind(self) -> str:
        """Kind of its terrain."""
        return str(self.keys["terrain"]["kind"])

    def sliders(self) -> tuple[Slider, ...]:
        """Friction, mass, key frames, and what its kind of terrain has."""
        terrain, frames = self.keys["terrain"], int(self.keys["frames"])
        drawn = ", times what was drawn" if self.kind == "family" else " of all surfaces"
        result = [
            Slider(
                key="friction",
                label=f"friction{drawn}",
                value=float(terrain.get("friction", 1.0)),
                to=self._rubbed,
            ),
            _of_mass(
                float(self.keys.get("mass_kg") or self.own_kg),
                self.own_kg,
                lambda value: self._with({**self.keys, "mass_kg": value}),
            ),
            _of_frames(
                frames,
                min(2, frames),
                _MOST_FRAMES,
                lambda value: self._with({**self.keys, "frames": int(value)}, follows=False),
            ),
        ]
        for path, label, unit, low, high, step, default in _OF_TERRAIN.get(
            _LIKE.get(self.kind, self.kind), ()
        ):
            scale = _DEGREES if unit == "°" else 1.0
            value = _at(terrain, path, default) * scale
            result.append(
                Slider(
                    key=".".join(path),
                    label=label,
                    unit=unit,
                    low=min(low, value),
                    high=max(high, value),
                    step=step,
                    value=value,
                    to=partial(self._put, path, scale, default),
                )
            )
        if self.chosen is not None:
            friction = terrain["polygons"][self.chosen].get("friction")
            value = float(terrain.get("friction", 1.0) if friction is None else friction)
            result.append(_of_surface(value, lambda each: self._with_polygon(friction=each)))
        return tuple(result)

    def grips(self, asked: Problem) -> tuple[Grip, ...]:
        """The goal; the start where nothing is laid out about it; both walls; the surface that was
        picked.
        """
        result = [Grip(key="goal", label="goal", position_m=asked.goal_m)]
        middle = asked.com_nominal_m.mean(axis=0)
        if _LIKE.get(self.kind, self.kind) == "walls":
            terrain = self.keys["terrain"]
            for side, name in enumerate(_SIDES):
                away = _at(terrain, ("apart_m",), 0.38) + _at(terrain, ("offset_m", str(side)), 0.0)
                at = np.array([middle[0], (1.0, -1.0)[side] * away, asked.com_nominal_m[0, 2]])
                result.append(Grip(key=name, label=name, position_m=at, axes=(False, True, False)))
        else:
            result.append(Grip(key="start", label="start", position_m=asked.com_nominal_m[0]))
        if self.chosen is not None:
            corners = np.array(
                self.keys["terrain"]["polygons"][self.chosen]["vertices_m"], dtype=np.float64
            )
            result.append(
                Grip(key=SURFACE, label=f"surface {self.chosen}", position_m=corners.mean(axis=0))
            )
        return tuple(result)

    def dragged(self, key: str, position_m: Array) -> KeysScenario:
        """Another place of a grip; key frames are as many as the way to a goal takes at the stride,
        unless they were slid.
        """
        place = [round(float(value), 4) for value in position_m]
        if key in ("goal", "start"):
            return self._led({**self.keys, f"{key}_m": place})
        terrain = self.keys["terrain"]
        if key in _SIDES:
            side = _SIDES.index(key)
            away = (1.0, -1.0)[side] * place[1] - _at(terrain, ("apart_m",), 0.38)
            return self._put(("offset_m", str(side)), 1.0, 0.0, round(away, 4))
        if self.chosen is None:
            return self
        corners = np.array(terrain["polygons"][self.chosen]["vertices_m"], dtype=np.float64)
        moved = corners + (np.array(place) - corners.mean(axis=0))
        return self._with_polygon(vertices_m=np.round(moved, 6).tolist())

    def _rubbed(self, friction: float) -> KeysScenario:
        """Scenario with another friction of all surfaces."""
        terrain = {**self.keys["terrain"], "friction": friction}
        if self.kind == "polygons":
            terrain["polygons"] = [{**each, "friction": friction} for each in terrain["polygons"]]
        return self._with({**self.keys, "terrain": terrain})

    def _put(
        self, path: tuple[str, ...], scale: float, default: float, value: float
    ) -> KeysScenario:
        """Scenario with another number at a key of its terrain, or at an index of the list there."""
        terrain, number = dict(self.keys["terrain"]), value / scale
        name, *index = path
        if index:
            few = int(index[0]) + 1 if name == "rises_m" else 2
            numbers = list(terrain.get(name) or [default] * few)
            numbers[int(index[0])] = number
        terrain[name] = numbers if index else number
        return self._with({**self.keys, "terrain": terrain})

    def _with_polygon(self, **changes: Any) -> KeysScenario:
        """Scenario with other keys of the picked surface."""
        terrain = self.keys["terrain"]
        polygons = [
            {**each, **changes} if k == self.chosen else each
            for k, each in enumerate(terrain["polygons"])
        ]
        return self._with({**self.keys, "terrain": {**terrain, "polygons": polygons}})

    def _led(self, keys: dict[str, Any]) -> KeysScenario:
        """Scenario on a path with another start or goal."""
        if self.follows:
            via = [
                each if isinstance(each, list | tuple) else each["at_m"]
                for each in keys.get("via_m", ())
            ]
            start = [*keys["start_m"], keys["goal_m"][2]][:3]
            way = np.array([start, *via, keys["goal_m"]], dtype=np.float64)
            length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            keys["frames"] = int(
                min(math.ceil(length / self.stride_m - 1e-6) + 1, max(_MOST_FRAMES, keys["frames"]))
            )
            keys["frames"] = max(keys["frames"], 2)
        return self._with(keys)

    def picked(self, course: Problem, patch: int) -> KeysScenario:
        """Scenario with its surfaces as a list of polygons, one of which has a grip."""
        if self.kind == "polygons":
            return self._with(self.keys, chosen=patch)
        terrain = spec_from(self.keys).terrain.along(course.com_nominal_m, self.folder)
        gaps = [
            float(np.linalg.norm(each.centre_m - course.terrain[patch].centre_m))
            for each in terrain.patches
        ]
        keys = {
            **polygon_keys(terrain.patches, terrain.footing),
            "friction": self.keys["terrain"].get("friction", 1.0),
        }
        return self._with({**self.keys, "terrain": keys}, chosen=int(np.argmin(gaps)))

    def with_robot(self, robot: str) -> KeysScenario:
        """Scenario for another robot, which stands and steps as it does."""
        return self._with(*with_robot(self.keys, self.folder, robot))

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course, laid out once in each way."""
        key = f"{sets} {alternative.message}"
        if key not in self._built:
            self._built[key] = build_course(self.spec, self.folder, sets, alternative=alternative)
        return cast("Problem", self._built[key])

    @property
    def spec(self) -> CourseSpec:
        """The keys, typed.

        Raises InvalidInput with every key that is wrong.
        """
        return spec_from(self.keys)

    def text(self) -> tuple[str, str]:
        """The suffix ``.yaml`` and the keys of the course as YAML text."""
        return ".yaml", yaml_of(_plain(self.keys))

    def _with(
        self, keys: Mapping[str, Any], own_kg: float | None = None, **changes: Any
    ) -> KeysScenario:
        return replace(self, keys=keys, own_kg=own_kg or self.own_kg, _built={}, **changes)


def _with_whole_paths(keys: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The keys with names of files that mean the same from every folder."""
    whole, terrain = dict(keys), keys.get("terrain")
    if isinstance(robot := keys.get("robot"), str) and Path(robot).suffix:
        whole["robot"] = str((folder / robot).resolve())
    if isinstance(terrain, Mapping) and isinstance(terrain.get("file"), str):
        whole["terrain"] = {**terrain, "file": str((folder / terrain["file"]).resolve())}
    return whole


def _at(keys: Mapping[str, Any], path: tuple[str, ...], default: float) -> float:
    """The number at a key, or at an index of the list there."""
    value = keys.get(path[0])
    if value is None:
        return default
    return float(value if len(path) == 1 else value[int(path[1])])


def _plain(value: Any) -> Any:
    """Keys, lists and numbers as YAML writes them."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


_MOST_LAID = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class BetweenScenario(Scenario):
    """A terrain's file with a start and a goal, (x, y) [m].

    Arguments:
        frames: as many as the way takes where None.
    """

    terrain: FileTerrain
    start_m: tuple[float, float]
    goal_m: tuple[float, float]
    robot: str = "hexapod"
    frames: int | None = None
    _laid: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """Name of the course, from its file."""
        return Path(self.terrain.file).stem

    def sliders(self) -> tuple[Slider, ...]:
        """Friction, and key frames."""
        frames = self.frames or self._laid.get("frames", 2)
        friction = Slider(
            key="friction",
            label="friction of all surfaces",
            value=self.terrain.friction,
            to=lambda value: self._with(
                terrain=self.terrain.model_copy(update={"friction": value})
            ),
        )
        return friction, _of_frames(
            frames, 2, _MOST_LAID, lambda value: self._with(frames=int(value))
        )

    def grips(self, asked: Problem) -> tuple[Grip, ...]:
        """Start and goal, over the ground."""
        return tuple(
            Grip(key=key, label=key, position_m=asked.com_nominal_m[k], axes=(True, True, False))
            for key, k in (("start", 0), ("goal", -1))
        )

    def dragged(self, key: str, position_m: Array) -> BetweenScenario:
        """Another start or goal."""
        place = round(float(position_m[0]), 4), round(float(position_m[1]), 4)
        return self._with(**{f"{key}_m": place})

    def with_robot(self, robot: str) -> BetweenScenario:
        """Scenario for another robot."""
        return self._with(robot=str(Path(robot).resolve()) if Path(robot).suffix else robot)

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course, laid out.

        Raises InvalidInput, and PlanningFailed where no way over footholds is found.
        """
        course = self.question(sets, alternative)
        self._laid["frames"] = course.frames
        return course

    @property
    def question(self) -> LaidBetween:
        """The question that ``stancekit plan`` asks, made once."""
        if "question" not in self._laid:
            self._laid["question"] = LaidBetween(
                terrain=self.terrain,
                start_m=self.start_m,
                goal_m=self.goal_m,
                robot=robot_of(self.robot),
                frames=self.frames,
            )
        return cast("LaidBetween", self._laid["question"])

    def text(self) -> tuple[str, str]:
        """A YAML file with the way that was laid out."""
        spec = course_between(
            self.terrain, self.start_m, self.goal_m, robot=self.robot, frames=self.frames
        )
        keys = spec.model_dump(mode="json", exclude_defaults=True)
        keys["terrain"]["kind"] = self.terrain.kind
        return ".yaml", yaml_of(_whole(keys))

    def _with(self, **changes: Any) -> BetweenScenario:
        return replace(self, _laid={}, **changes)


def _whole(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of a path to a tenth of a millimetre."""
    whole = dict(keys)
    for key in ("start_m", "goal_m"):
        whole[key] = np.round(whole[key], 4).tolist()
    whole["via_m"] = [np.round(each, 4).tolist() for each in whole.get("via_m", [])]
    return whole


_ON_M = 1e-6
"""A candidate so near to a surface, facing as it does, is a piece of it [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedScenario(Scenario):
    """A course as it is laid out; goal, surfaces, friction and mass can be others.

    Arguments:
        chosen: the surface with a grip.
    """

    laid: Problem
    friction: float | None = None
    mass_kg: float | None = None
    chosen: int | None = None

    @property
    def name(self) -> str:
        """Name of the course."""
        return self.laid.name

    def sliders(self) -> tuple[Slider, ...]:
        """Friction of all surfaces, and of the picked one; mass, unless the robot's model says
        it.
        """
        most = max(patch.friction for patch in self.laid.terrain)
        result = [
            Slider(
                key="friction",
                label="friction of all surfaces, times",
                unit="",
                high=2.0,
                value=1.0 if self.friction is None else self.friction,
                hint=f"Of what the file says: {most:.3g} at most.",
                to=lambda value: replace(self, friction=value),
            )
        ]
        if not self.laid.robot.own:
            own_kg = self.laid.robot.mass_kg
            mass = own_kg if self.mass_kg is None else self.mass_kg
            result.append(_of_mass(mass, own_kg, lambda value: replace(self, mass_kg=value)))
        if self.chosen is not None:
            friction = self.laid.terrain[self.chosen].friction
            result.append(
                _of_surface(
                    friction,
                    lambda value: self._with_surface(lambda patch: patch.with_friction(value)),
                )
            )
        return tuple(result)

    def grips(self, asked: Problem) -> tuple[Grip, ...]:
        """The goal, and the surface that was picked."""
        result = [Grip(key="goal", label="goal", position_m=self.laid.goal_m)]
        if self.chosen is not None:
            at = self.laid.terrain[self.chosen].centre_m
            result.append(Grip(key=SURFACE, label=f"surface {self.chosen}", position_m=at))
        return tuple(result)

    def dragged(self, key: str, position_m: Array) -> FixedScenario:
        """Another place of a grip."""
        if key == "goal":
            return replace(self, laid=replace(self.laid, goal_m=position_m))
        if self.chosen is None:
            return self
        by = position_m - self.laid.terrain[self.chosen].centre_m
        return self._with_surface(lambda patch: replace(patch, vertices_m=patch.vertices_m + by))

    def _with_surface(self, change: Callable[[Patch], Patch]) -> FixedScenario:
        """Scenario with the picked surface changed, and with the pieces of it that toes were
        offered.
        """
        assert self.chosen is not None
        surface = self.laid.terrain[self.chosen]
        terrain = [*self.laid.terrain]
        terrain[self.chosen] = change(surface)
        footholds = tuple(
            replace(
                foothold,
                candidates=tuple(
                    change(each) if _is_piece(each, surface) else each
                    for each in foothold.candidates
                ),
                toe_m=_moved(foothold.toe_m, foothold.candidates, surface, terrain[self.chosen]),
            )
            for foothold in self.laid.footholds
        )
        return replace(self, laid=replace(self.laid, terrain=tuple(terrain), footholds=footholds))

    def picked(self, course: Problem, patch: int) -> FixedScenario:
        """Scenario with a grip at this patch."""
        return replace(self, chosen=patch)

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The one that there is: its footholds are fixed."""
        return (AS_ASKED,)

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course with its friction and mass.

        Raises InvalidInput for a mass that is none.
        """
        result = self.laid
        if self.friction is not None:

            def rubbed(patch: Patch, by: float = self.friction) -> Patch:
                return patch.with_friction(by * patch.friction)

            footholds = tuple(
                replace(foothold, candidates=tuple(map(rubbed, foothold.candidates)))
                for foothold in result.footholds
            )
            result = replace(
                result, terrain=tuple(map(rubbed, result.terrain)), footholds=footholds
            )
        if self.mass_kg is not None:
            result = replace(result, robot=replace(result.robot, mass_kg=self.mass_kg))
        return result

    def text(self) -> tuple[str, str]:
        """The JSON form, which has every foothold."""
        return ".json", json.dumps(self.course().to_json(), indent=1) + "\n"


def _is_piece(patch: Patch, surface: Patch) -> bool:
    """Tell whether a patch lies on a surface's plane and within its corners' bounds."""
    if patch is surface:
        return True
    if float(patch.normal @ surface.normal) < 1.0 - 1e-9:
        return False
    if np.abs((patch.vertices_m - surface.vertices_m[0]) @ surface.normal).max() > _ON_M:
        return False
    low, high = surface.vertices_m.min(axis=0) - _ON_M, surface.vertices_m.max(axis=0) + _ON_M
    return bool(np.all((patch.vertices_m >= low) & (patch.vertices_m <= high)))


def _moved(
    toe_m: Array | None, candidates: tuple[Patch, ...], before: Patch, after: Patch
) -> Array | None:
    """Place of a toe that stands already when its surface moved."""
    if toe_m is None or not any(_is_piece(each, before) for each in candidates):
        return toe_m
    return toe_m + (after.centre_m - before.centre_m)


_PACE_M_S = 0.25
"""A walk takes as long as this speed asks for, until its duration is slid."""
_SHORTEST_S = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkScenario(Scenario):
    """A walk from a place to another, (x, y) [m].

    Arguments:
        robot: a name or a file.
        duration_s: by the way's length if None.
    """

    terrain: HeightField
    walker: Robot
    robot: str = "anymal"
    start_m: tuple[float, float] = (0.0, 0.0)
    goal_m: tuple[float, float] = (1.0, 0.5)
    duration_s: float | None = None
    friction: float = 0.75

    @classmethod
    def of(cls, terrain: HeightField, robot: str, **given: Any) -> WalkScenario:
        """A walk of a robot of a name or a file.

        Raises InvalidInput.
        """
        return cls(terrain=terrain, walker=named_walker(robot), robot=robot, **given)

    @property
    def name(self) -> str:
        """Name of the terrain."""
        return self.terrain.name or "a terrain"

    @property
    def takes_s(self) -> float:
        """Duration of the walk [s]."""
        if self.duration_s is not None:
            return self.duration_s
        way = float(np.hypot(self.goal_m[0] - self.start_m[0], self.goal_m[1] - self.start_m[1]))
        return round(float(np.clip(way / _PACE_M_S, _SHORTEST_S, 60.0)), 1)

    def sliders(self) -> tuple[Slider, ...]:
        """Friction and duration."""
        return (
            Slider(
                key="friction",
                label="friction of the terrain",
                low=0.05,
                value=self.friction,
                to=lambda value: replace(self, friction=value),
            ),
            Slider(
                key="duration_s",
                label="duration",
                unit="s",
                low=1.0,
                high=60.0,
                step=0.1,
                value=self.takes_s,
                to=lambda value: replace(self, duration_s=value),
            ),
        )

    def grips(self, asked: Walk | None = None) -> tuple[Grip, ...]:
        """Start and goal, at the height of the torso."""
        return tuple(
            Grip(key=key, label=key, position_m=self.torso_m(place), axes=(True, True, False))
            for key, place in (("start", self.start_m), ("goal", self.goal_m))
        )

    def torso_m(self, place: tuple[float, float]) -> Array:
        """Place of the torso over a point, as the robot stands, shape (3,) [m]."""
        (x0, x1), (y0, y1) = self.terrain.domain_m
        inside = np.clip(place, [x0, y0], [x1, y1])
        return np.array([*place, float(self.terrain.height(inside)) + self.walker.stand_height_m])

    def dragged(self, key: str, position_m: Array) -> WalkScenario:
        """Another start or goal."""
        place = round(float(position_m[0]), 3), round(float(position_m[1]), 3)
        return replace(self, start_m=place) if key == "start" else replace(self, goal_m=place)

    def with_robot(self, robot: str) -> WalkScenario:
        """Scenario for another robot.

        Raises InvalidInput.
        """
        return replace(self, walker=named_walker(robot), robot=robot)

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Walk:
        """The walk that is asked for.

        Raises InvalidInput for a place where the robot cannot stand.
        """
        return Walk(
            robot=self.walker,
            terrain=self.terrain,
            start=np.array(self.start_m),
            goal=np.array(self.goal_m),
            duration_s=self.takes_s,
            friction=self.friction,
            gait="trot" if len(self.walker.feet) == 4 else "tripod",
        )
