"""Scenes over a terrain's file, from a place to another: a way over footholds is laid out anew for
every change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_between import course_between
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.terrain_spec import FileTerrain
from stancekit.planners.robot.reach_sets import Sets

from .scenario import Grip, Slider

MOST_FRAMES = 60


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
        spec = self._laid.get("spec")
        frames = self.frames or (spec.frames if isinstance(spec, CourseSpec) else 2)
        result.append(
            Slider(
                key="frames",
                label="key frames",
                unit="",
                low=2,
                high=max(MOST_FRAMES, frames),
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
        """The course, laid out once in each way.

        Raises InvalidInput, and PlanningFailed where no way over footholds is found.
        """
        spec = self._spec(alternative)
        key = f"{sets} {alternative.message}"
        if key not in self._laid:
            self._laid[key] = build_course(spec, sets=sets)
        return cast("Problem", self._laid[key])

    def _spec(self, alternative: Alternative = AS_ASKED) -> CourseSpec:
        """The description of the course, made once in each way.

        Raises likewise.
        """
        key = (
            f"spec {alternative.message}".rstrip()
        )  # "spec" is that of the layout that is asked for
        if key not in self._laid:
            self._laid[key] = course_between(
                self.terrain,
                self.start_m,
                self.goal_m,
                robot=self.robot,
                frames=self.frames,
                alternative=alternative,
            )
        return cast("CourseSpec", self._laid[key])

    def text(self) -> tuple[str, str]:
        """A YAML file with the way that was laid out."""
        keys = self._spec().model_dump(mode="json", exclude_defaults=True)
        keys["terrain"]["kind"] = self.terrain.kind
        return ".yaml", yaml.safe_dump(
            _whole(keys), sort_keys=False, default_flow_style=None, width=110
        )

    def _with(self, **changes: Any) -> BetweenScenario:
        return replace(self, _laid={}, **changes)


def _whole(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of a path to a tenth of a millimetre."""
    whole = dict(keys)
    for key in ("start_m", "goal_m"):
        whole[key] = np.round(whole[key], 4).tolist()
    whole["via_m"] = [np.round(each, 4).tolist() for each in whole.get("via_m", [])]
    return whole
