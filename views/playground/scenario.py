"""Interface of a playground's scenes: sliders and grips, known by their keys; a change gives
another scene.

No page takes part. A scene is a value: what it is asked for may make no sense, which ``course``
then says in one line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import AS_ASKED, Alternative
from stancekit.planners.robot.reach_sets import Sets

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
        ...

    @property
    def robot(self) -> str:
        """The name or file of the robot; empty where it cannot be another one."""
        ...

    def sliders(self) -> tuple[Slider, ...]:
        """Sliders of the scene."""
        ...

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """Grips of the scene, which may be dragged.

        Arguments:
            course: what ``course`` gave.
        """
        ...

    def slid(self, key: str, value: float) -> Scenario:
        """Another value of a slider."""
        ...

    def dragged(self, key: str, position_m: Array) -> Scenario:
        """Another place of a grip, shape (3,) [m]."""
        ...

    def picked(self, course: Problem, patch: int) -> Scenario:
        """Scenario with a grip at this patch of the course's terrain."""
        ...

    def with_robot(self, robot: str) -> Scenario:
        """Scenario for another robot, a built-in name or a file."""
        ...

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The ways in which it can be laid out, the first of which is the one that is asked for."""
        ...

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course that is asked for, or one that is laid out in another way.

        Raises InvalidInput or PlanningFailed in one line.
        """
        ...

    def text(self) -> tuple[str, str]:
        """The course's file: how its name ends, and its text.

        Raises InvalidInput for a scene that is no course.
        """
        ...
