"""Scenes in keys, as a course's YAML file has them: every change is one of its keys, and what is
saved is that file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import yaml_of
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_file import described, spec_from
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.terrain_spec import polygon_keys
from stancekit.planners.robot.model import hexapod
from stancekit.planners.robot.reach_sets import Sets, standing_toes
from stancekit.planners.robot.robot_file import named_robot

from .scenario import SURFACE, Grip, Slider

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
    return changed, hexapod().mass_kg if robot == "hexapod" else model.body.mass_kg


def own_kg(spec: CourseSpec, folder: Path) -> float:
    """Mass of a course's robot without what its key mass_kg says [kg]."""
    plain = spec.model_copy(update={"mass_kg": None})
    return plain.make_robot(folder).mass_kg


def _stands_m(keys: Mapping[str, Any], folder: Path) -> float:
    """Height of the centre of mass above its toes on the course as it is [m]; 0 between walls."""
    spec = spec_from(keys)
    robot = spec.make_robot(folder)
    if not robot.source.own:
        return spec.stance.down_m
    return -float(np.mean(standing_toes(robot.source.own_model())[:, 2]))


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
class KeysScenario:
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
        terrain = self.keys["terrain"]
        whole = (
            "friction of all surfaces"
            if self.kind != "family"
            else "friction, times what was drawn"
        )
        result = [
            Slider(
                key="friction",
                label=whole,
                unit="μ",
                low=0.0,
                high=1.5,
                step=0.01,
                value=float(terrain.get("friction", 1.0)),
            )
        ]
        mass = float(self.keys.get("mass_kg") or self.own_kg)
        result.append(
            Slider(
                key="mass_kg",
                label="mass of the robot",
                unit="kg",
                low=0.1,
                high=4.0 * self.own_kg,
                step=0.1,
                value=mass,
            )
        )
        frames = int(self.keys["frames"])
        result.append(
            Slider(
                key="frames",
                label="key frames",
                unit="",
                low=min(2, frames),
                high=max(_MOST_FRAMES, frames),
                step=1,
                value=frames,
                whole=True,
            )
        )
        for path, label, unit, low, high, step, default in _OF_TERRAIN.get(
            _LIKE.get(self.kind, self.kind), ()
        ):
            value = _at(terrain, path, default) * (_DEGREES if unit == "°" else 1.0)
            result.append(
                Slider(
                    key=".".join(path),
                    label=label,
                    unit=unit,
                    low=min(low, value),
                    high=max(high, value),
                    step=step,
                    value=value,
                )
            )
        if self.chosen is not None:
            friction = terrain["polygons"][self.chosen].get("friction")
            value = float(terrain.get("friction", 1.0) if friction is None else friction)
            result.append(
                Slider(
                    key=SURFACE,
                    label="friction of the picked surface",
                    unit="μ",
                    low=0.0,
                    high=1.5,
                    step=0.01,
                    value=value,
                )
            )
        return tuple(result)

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """The goal; the start where nothing is laid out about it; both walls; the surface that was
        picked.
        """
        result = [Grip(key="goal", label="goal", position_m=course.goal_m)]
        middle = course.com_nominal_m.mean(axis=0)
        if _LIKE.get(self.kind, self.kind) == "walls":
            terrain = self.keys["terrain"]
            for side, name in enumerate(_SIDES):
                away = _at(terrain, ("apart_m",), 0.38) + _at(terrain, ("offset_m", str(side)), 0.0)
                at = np.array([middle[0], (1.0, -1.0)[side] * away, course.com_nominal_m[0, 2]])
                result.append(Grip(key=name, label=name, position_m=at, axes=(False, True, False)))
        else:
            result.append(Grip(key="start", label="start", position_m=course.com_nominal_m[0]))
        if self.chosen is not None:
            corners = np.array(
                self.keys["terrain"]["polygons"][self.chosen]["vertices_m"], dtype=np.float64
            )
            result.append(
                Grip(key=SURFACE, label=f"surface {self.chosen}", position_m=corners.mean(axis=0))
            )
        return tuple(result)

    def slid(self, key: str, value: float) -> KeysScenario:
        """Another value of a slider; a number of key frames that is slid stays as it is."""
        if key in ("mass_kg", "frames"):
            whole = {"frames": int(value)} if key == "frames" else {"mass_kg": float(value)}
            return self._with({**self.keys, **whole}, follows=self.follows and key != "frames")
        terrain = dict(self.keys["terrain"])
        if key == SURFACE and self.chosen is not None:
            terrain["polygons"] = [*terrain["polygons"]]
            terrain["polygons"][self.chosen] = {
                **terrain["polygons"][self.chosen],
                "friction": float(value),
            }
        elif key == "friction":
            terrain["friction"] = float(value)
            if self.kind == "polygons":
                terrain["polygons"] = [
                    {**each, "friction": float(value)} for each in terrain["polygons"]
                ]
        else:
            rows = _OF_TERRAIN[_LIKE.get(self.kind, self.kind)]
            (path, unit, default), *_ = [
                (row[0], row[2], row[6]) for row in rows if ".".join(row[0]) == key
            ]
            _put(terrain, path, value / _DEGREES if unit == "°" else float(value), default)
        return self._with({**self.keys, "terrain": terrain})

    def dragged(self, key: str, position_m: Array) -> KeysScenario:
        """Another place of a grip; key frames are as many as the way to a goal takes at the stride,
        unless they were slid.
        """
        place = [round(float(value), 4) for value in position_m]
        if key in ("goal", "start"):
            return self._led({**self.keys, f"{key}_m": place})
        terrain = dict(self.keys["terrain"])
        if key in _SIDES:
            side = _SIDES.index(key)
            away = (1.0, -1.0)[side] * place[1] - _at(terrain, ("apart_m",), 0.38)
            _put(terrain, ("offset_m", str(side)), round(away, 4), 0.0)
        elif self.chosen is not None:
            polygon = terrain["polygons"][self.chosen]
            corners = np.array(polygon["vertices_m"], dtype=np.float64)
            moved = corners + (np.array(place) - corners.mean(axis=0))
            terrain["polygons"] = [*terrain["polygons"]]
            terrain["polygons"][self.chosen] = {
                **polygon,
                "vertices_m": np.round(moved, 6).tolist(),
            }
        return self._with({**self.keys, "terrain": terrain})

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

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """Layouts of ``stancekit plan``."""
        return ALTERNATIVES

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


def _put(keys: dict[str, Any], path: tuple[str, ...], value: float, default: float) -> None:
    """Another number there."""
    if len(path) == 1:
        keys[path[0]] = value
        return
    index = int(path[1])
    numbers = list(keys.get(path[0]) or [default] * (index + 1 if path[0] == "rises_m" else 2))
    numbers[index] = value
    keys[path[0]] = numbers


def _plain(value: Any) -> Any:
    """Keys, lists and numbers as YAML writes them."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
