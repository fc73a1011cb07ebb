"""Walks that can be changed: start, goal, duration, friction and robot over a terrain of
heights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.walker import named_walker
from stancekit.planners.terrain.heightfield import HeightField

from .scenario import Grip, Slider

PACE_M_S = 0.25
"""A walk takes as long as this speed asks for, until its duration is slid."""
SHORTEST_S = 2.0


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
        return round(float(np.clip(way / PACE_M_S, SHORTEST_S, 60.0)), 1)

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
            start_xy_m=np.array(self.start_m),
            goal_xy_m=np.array(self.goal_m),
            duration_s=self.takes_s,
            friction=self.friction,
            gait="trot" if len(self.walker.feet) == 4 else "tripod",
        )
