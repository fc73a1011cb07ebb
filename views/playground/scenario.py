"""Interface of a playground's scenes: sliders and grips, known by their keys; a change gives
another scene.

No page takes part. A scene is a value: what it is asked for may make no sense, which ``course``
then says in one line.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import yaml_of
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_between import LaidBetween, course_between
from stancekit.planners.problem.terrain_spec import FileTerrain
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.reach_sets import Sets
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.robot.walker import named_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.patch import Patch

SURFACE = "surface"
"""Key of the grip of the surface that was picked, and of the slider of its friction."""


@dataclass(frozen=True, kw_only=True)
class Slider:
    """A number that may be slid.

    Arguments:
        unit: empty where it has none.
        whole: whether only whole numbers make sense.
    """

    key: str
    label: str
    unit: str
    low: float
    high: float
    step: float
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


class Scenario(Protocol):
    """A scene that can be changed."""

    @property
    def name(self) -> str:
        """Name of the course."""

    @property
    def robot(self) -> str:
        """The name or file of the robot; empty where it cannot be another one."""

    def sliders(self) -> tuple[Slider, ...]:
        """Sliders of the scene."""

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """Grips of the scene, which may be dragged.

        Arguments:
            course: what ``course`` gave.
        """

    def slid(self, key: str, value: float) -> Scenario:
        """Another value of a slider."""

    def dragged(self, key: str, position_m: Array) -> Scenario:
        """Another place of a grip, shape (3,) [m]."""

    def picked(self, course: Problem, patch: int) -> Scenario:
        """Scenario with a grip at this patch of the course's terrain."""

    def with_robot(self, robot: str) -> Scenario:
        """Scenario for another robot, a built-in name or a file."""

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The ways in which it can be laid out, the first of which is the one that is asked for."""

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course that is asked for, or one that is laid out in another way.

        Raises InvalidInput or PlanningFailed in one line.
        """

    def text(self) -> tuple[str, str]:
        """The course's file: how its name ends, and its text.

        Raises InvalidInput for a scene that is no course.
        """


_MOST_FRAMES = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class BetweenScenario:
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
        result = [
            Slider(
                key="friction",
                label="friction of all surfaces",
                unit="μ",
                low=0.0,
                high=1.5,
                step=0.01,
                value=self.terrain.friction,
            )
        ]
        frames = self.frames or self._laid.get("frames", 2)
        result.append(
            Slider(
                key="frames",
                label="key frames",
                unit="",
                low=2,
                high=max(_MOST_FRAMES, frames),
                step=1,
                value=frames,
                whole=True,
            )
        )
        return tuple(result)

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """Start and goal, over the ground."""
        return tuple(
            Grip(key=key, label=key, position_m=course.com_nominal_m[k], axes=(True, True, False))
            for key, k in (("start", 0), ("goal", -1))
        )

    def slid(self, key: str, value: float) -> BetweenScenario:
        """Another value of a slider."""
        if key == "frames":
            return self._with(frames=int(value))
        return self._with(terrain=self.terrain.model_copy(update={"friction": float(value)}))

    def dragged(self, key: str, position_m: Array) -> BetweenScenario:
        """Another start or goal."""
        place = round(float(position_m[0]), 4), round(float(position_m[1]), 4)
        return self._with(**{f"{key}_m": place})

    def picked(self, course: Problem, patch: int) -> BetweenScenario:
        """Raises InvalidInput: surfaces are those of the file."""
        raise InvalidInput(
            "surface: expected a course of surfaces to pick one of, got a terrain's file"
        )

    def with_robot(self, robot: str) -> BetweenScenario:
        """Scenario for another robot."""
        return self._with(robot=str(Path(robot).resolve()) if Path(robot).suffix else robot)

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """Layouts of ``stancekit plan``."""
        return ALTERNATIVES

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
class FixedScenario:
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

    @property
    def robot(self) -> str:
        """None other: its limbs are those of the footholds."""
        return ""

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
                low=0.0,
                high=2.0,
                step=0.01,
                value=1.0 if self.friction is None else self.friction,
                hint=f"Of what the file says: {most:.3g} at most.",
            )
        ]
        if not self.laid.robot.source.own:
            mass = self.laid.robot.mass_kg
            result.append(
                Slider(
                    key="mass_kg",
                    label="mass of the robot",
                    unit="kg",
                    low=0.1,
                    high=4.0 * mass,
                    step=0.1,
                    value=mass if self.mass_kg is None else self.mass_kg,
                )
            )
        if self.chosen is not None:
            result.append(
                Slider(
                    key=SURFACE,
                    label="friction of the picked surface",
                    unit="μ",
                    low=0.0,
                    high=1.5,
                    step=0.01,
                    value=self.laid.terrain[self.chosen].friction,
                )
            )
        return tuple(result)

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """The goal, and the surface that was picked."""
        result = [Grip(key="goal", label="goal", position_m=self.laid.goal_m)]
        if self.chosen is not None:
            at = self.laid.terrain[self.chosen].centre_m
            result.append(Grip(key=SURFACE, label=f"surface {self.chosen}", position_m=at))
        return tuple(result)

    def slid(self, key: str, value: float) -> FixedScenario:
        """Another value of a slider."""
        if key == "friction":
            return replace(self, friction=value)
        if key == "mass_kg":
            return replace(self, mass_kg=value)
        return self._with_surface(lambda patch: patch.with_friction(value))

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

    def with_robot(self, robot: str) -> FixedScenario:
        """Raises InvalidInput: footholds are those of one robot."""
        raise InvalidInput(
            f"robot: expected the robot of a course whose footholds are fixed, got {robot}"
        )

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
class WalkScenario:
    """A walk from a place to another, (x, y) [m].

    Arguments:
        robot: a name or a file.
        duration_s: by the way's length if None.
    """

    terrain: HeightField
    walker: Robot
    robot: str
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
                unit="μ",
                low=0.05,
                high=1.5,
                step=0.01,
                value=self.friction,
            ),
            Slider(
                key="duration_s",
                label="duration",
                unit="s",
                low=1.0,
                high=60.0,
                step=0.1,
                value=self.takes_s,
            ),
        )

    def grips(self) -> tuple[Grip, ...]:
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

    def slid(self, key: str, value: float) -> WalkScenario:
        """Another value of a slider."""
        return (
            replace(self, friction=value) if key == "friction" else replace(self, duration_s=value)
        )

    def dragged(self, key: str, position_m: Array) -> WalkScenario:
        """Another start or goal."""
        place = round(float(position_m[0]), 3), round(float(position_m[1]), 3)
        return replace(self, start_m=place) if key == "start" else replace(self, goal_m=place)

    def with_robot(self, robot: str) -> WalkScenario:
        """Scenario for another robot.

        Raises InvalidInput.
        """
        return replace(self, walker=named_walker(robot), robot=robot)

    def task(self) -> Walk:
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
