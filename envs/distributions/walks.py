"""Walks drawn at random, or from those that a terrain is known for: what
``stancekit/WarpedGait-v0`` begins with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stancekit.planners.cached import cached_property
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.families import (
    SMOOTH,
    TERRAIN_FAMILIES,
    random_heights,
    terrain_family,
)
from stancekit.planners.terrain.reference import (
    TERRAINS,
    TerrainTask,
    reference_tasks,
    reference_terrain,
)

DRAWS = 100
Tasks = Callable[[np.random.Generator], Walk]
"""Draws a walk."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledTasks:
    """Walks over drawn terrains, or the paper's tasks on one of its own.

    Arguments:
        terrain: a family of ground, ``any`` for all of them at random, ``mixed`` for the smooth
            ones (``SMOOTH``), or a terrain of ``TERRAINS`` or ``FILE.py:NAME``, with the walks that
            it is known for, else drawn ones.
        difficulty: lowest and highest level of the families, drawn uniformly.
        distance_m: shortest and longest distance from start to goal, drawn uniformly [m].
        robot: the walker, ANYmal by default.
    """

    terrain: str = "mixed"
    difficulty: tuple[float, float] = (0.2, 0.8)
    distance_m: tuple[float, float] = (0.3, 0.8)
    duration_s: float = 3.0
    robot: Robot = field(default_factory=anymal)

    def __post_init__(self) -> None:
        known = tuple(
            dict.fromkeys(("mixed", *SMOOTH, "any", *TERRAIN_FAMILIES.names(), *TERRAINS.names()))
        )
        if self.terrain not in known and ".py:" not in self.terrain:
            raise InvalidInput(
                f"terrain: expected one of {', '.join(known)}, or FILE.py:NAME, got "
                f"{self.terrain!r}"
            )
        if not self._families:
            TERRAINS.get(self.terrain)
        elif self.terrain not in ("mixed", "any") and not terrain_family(self.terrain).walked:
            raise InvalidInput(
                f"terrain: expected a family of ground to walk on, got {self.terrain}, all upright"
            )
        for name, most in (("difficulty", 1.0), ("distance_m", 3.0)):
            low, high = getattr(self, name)
            if not 0.0 <= low <= high <= most:
                raise InvalidInput(
                    f"{name}: expected 0 ≤ low ≤ high ≤ {most:g}, got {low:g} and {high:g}"
                )

    @cached_property
    def _families(self) -> tuple[str, ...]:
        """The families of which every walk has a ground of its own; none for one terrain."""
        if self.terrain == "mixed":
            return SMOOTH
        if self.terrain == "any":
            return tuple(name for name in TERRAIN_FAMILIES.names() if terrain_family(name).walked)
        return (self.terrain,) if self.terrain in TERRAIN_FAMILIES.names() else ()

    def __call__(self, rng: np.random.Generator) -> Walk:
        """Draw a walk; a goal where the robot cannot stand is drawn again.

        Raises PlanningFailed if none is found.
        """
        tasks = () if self._families else reference_tasks(self.terrain)
        for _ in range(DRAWS):
            try:
                return self._task_of(tasks, rng) if tasks else self._drawn(rng)
            except InvalidInput as error:
                refused = error
        raise PlanningFailed(
            f"no walk was found on {self.terrain} in {DRAWS} draws; the last: {refused}"
        )

    def _drawn(self, rng: np.random.Generator) -> Walk:
        if names := self._families:
            family = str(rng.choice(names)) if self.terrain in ("mixed", "any") else self.terrain
            field_ = random_heights(family, float(rng.uniform(*self.difficulty)), rng)
        else:
            field_ = reference_terrain(self.terrain)
        turn = float(rng.uniform(-np.pi, np.pi))
        start = rng.uniform(-1.5, 1.5, 2)
        goal = start + rng.uniform(*self.distance_m) * np.array([np.cos(turn), np.sin(turn)])
        return Walk(
            robot=self.robot,
            terrain=field_,
            start_xy_m=start,
            goal_xy_m=goal,
            start_yaw_rad=turn,
            duration_s=self.duration_s,
            gait=_gait(self.robot),
        )

    def _task_of(self, tasks: Sequence[TerrainTask], rng: np.random.Generator) -> Walk:
        walk = tasks[int(rng.integers(len(tasks)))]
        return Walk(
            robot=self.robot,
            terrain=reference_terrain(self.terrain),
            start_xy_m=walk.start_xy_m,
            goal_xy_m=walk.goal_xy_m,
            adhesive=walk.adhesive,
            duration_s=self.duration_s,
            gait=_gait(self.robot),
        )


def _gait(robot: Robot) -> str:
    return "trot" if len(robot.feet) == 4 else "tripod"
