"""Distributions of courses: the built-in ones and the user's, perturbed, and walls with random
panels of ice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_spec
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.course_terrain import (
    FamilyScene,
    FileTerrain,
    Flat,
    GroundToWall,
    IcyWalls,
    Polygons,
    Stairs,
    TerrainSpec,
    Tube,
    Walls,
)
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.families import (
    NOT_WALKED,
    SMOOTH,
    TERRAIN_FAMILIES,
    random_heights,
)
from stancekit.planners.terrain.reference import (
    TERRAINS,
    TerrainTask,
    reference_tasks,
    reference_terrain,
)

_DRAWS = 100
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
        elif self.terrain not in ("mixed", "any") and self.terrain in NOT_WALKED:
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
            return tuple(name for name in TERRAIN_FAMILIES.names() if name not in NOT_WALKED)
        return (self.terrain,) if self.terrain in TERRAIN_FAMILIES.names() else ()

    def __call__(self, rng: np.random.Generator) -> Walk:
        """Draw a walk; a goal where the robot cannot stand is drawn again.

        Raises PlanningFailed if none is found.
        """
        tasks = () if self._families else reference_tasks(self.terrain)
        for _ in range(_DRAWS):
            try:
                return self._task_of(tasks, rng) if tasks else self._drawn(rng)
            except InvalidInput as error:
                refused = error
        raise PlanningFailed(
            f"no walk was found on {self.terrain} in {_DRAWS} draws; the last: {refused}"
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
            start=start,
            goal=goal,
            start_yaw_rad=turn,
            duration_s=self.duration_s,
            gait=_gait(self.robot),
        )

    def _task_of(self, tasks: Sequence[TerrainTask], rng: np.random.Generator) -> Walk:
        walk = tasks[int(rng.integers(len(tasks)))]
        return Walk(
            robot=self.robot,
            terrain=reference_terrain(self.terrain),
            start=walk.start,
            goal=walk.goal,
            adhesive=walk.adhesive,
            duration_s=self.duration_s,
            gait=_gait(self.robot),
        )


def _gait(robot: Robot) -> str:
    return "trot" if len(robot.feet) == 4 else "tripod"


ICE = 0.5
"""Share of the panels of icy walls that have no friction."""
_ROWS, COLUMNS = 24, 8
"""Size of a drawn pattern of panels; larger walls repeat it."""
REDRAWS = 1000


def perturbed(
    course: str | Path | CourseSpec,
    rng: np.random.Generator,
    *,
    frames: int | None = None,
    amount: float = 1.0,
) -> Problem:
    """A course like this one: other heights, distances, leans, friction and panels, the same path
    and gait.

    Arguments:
        amount: scales every deviation; 1 keeps the built-in courses climbable for the default
            hexapod. Scenes of families are drawn anew at their level instead, climbable or not,
            unless it is 0; then NoFooting may be raised, too. Walls with ice are drawn so that
            every toe has some candidate that grips; ``icy_walls`` does not promise that.

    Raises:
        InvalidInput: where no such walls were found.
    """
    spec, folder = (
        (course, Path())
        if isinstance(course, CourseSpec)
        else (read_spec(course), Path(course).parent)
    )
    spec = spec if frames is None else spec.with_frames(frames)
    for _ in range(REDRAWS):
        changed = spec.model_copy(update={"terrain": _changed(spec.terrain, rng, amount)})
        result = build_course(changed, folder)
        if not isinstance(spec.terrain, IcyWalls) or grips(result):
            return result
    raise InvalidInput(
        f"{spec.name}: expected walls that offer every toe some grip, got none in {REDRAWS} draws"
    )


def icy_walls(
    rng: np.random.Generator, frames: int = 8, regions: int = 4, *, ice: float = ICE
) -> Problem:
    """The built-in walls with panels of .3 m, each without friction by this chance, whether or not
    that can be climbed.

    Arguments:
        regions: candidate patches a toe, the nearest panels whether icy or not (Lin et al.
            §IV-B.2).
    """
    spec = read_spec("icy-walls").with_frames(frames)
    terrain = spec.terrain.model_copy(update=_panels(rng, ice))
    candidates = spec.candidates.model_copy(update={"count": regions})
    return build_course(
        spec.model_copy(update={"terrain": terrain, "candidates": candidates}), Path()
    )


def grips(course: Problem) -> bool:
    """Every foothold has a candidate with friction."""
    return all(
        any(patch.friction > 0.0 for patch in foothold.candidates) for foothold in course.footholds
    )


def _changed(terrain: TerrainSpec, rng: np.random.Generator, amount: float) -> TerrainSpec:
    """The terrain, perturbed."""
    if isinstance(terrain, IcyWalls):
        return terrain.model_copy(update=_walls(terrain, rng, amount) | _panels(rng, ICE))
    if isinstance(terrain, Walls | GroundToWall):
        return terrain.model_copy(update=_walls(terrain, rng, amount))
    if isinstance(terrain, FamilyScene):
        return terrain.model_copy(update={"seed": int(rng.integers(2**62))} if amount else {})
    if isinstance(terrain, Stairs):
        rises = [
            rise + amount * rng.uniform(-0.02, 0.02) for rise in _repeated(terrain.rises_m, 40)
        ]
        first = terrain.first_m + amount * rng.uniform(-0.05, 0.05)
        run = terrain.run_m + amount * rng.uniform(-0.02, 0.04)
        return terrain.model_copy(
            update={
                "rises_m": rises,
                "first_m": first,
                "run_m": run,
                "friction": _slippery(terrain, rng, amount),
            }
        )
    if isinstance(terrain, Tube):
        leans = [
            lean + amount * rng.uniform(-0.1, 0.1) for lean in _repeated(terrain.leans_rad, 60)
        ]
        azimuth = terrain.first_azimuth_rad + amount * rng.uniform(-0.2, 0.2)
        radius = terrain.radius_m + amount * rng.uniform(-0.03, 0.02)
        return terrain.model_copy(
            update={
                "leans_rad": leans,
                "first_azimuth_rad": azimuth,
                "radius_m": radius,
                "friction": _slippery(terrain, rng, amount),
            }
        )
    if isinstance(terrain, Polygons):
        polygons = [
            polygon.model_copy(
                update={
                    "vertices_m": [
                        tuple(corner) for corner in np.array(polygon.vertices_m) + shift
                    ],
                    "friction": friction * (1.0 - amount * rng.uniform(0.0, 0.2)),
                }
            )
            for polygon in terrain.polygons
            for shift in [amount * rng.uniform(-0.01, 0.01, 3)]
            for friction in [terrain.friction if polygon.friction is None else polygon.friction]
        ]
        return terrain.model_copy(update={"polygons": polygons})
    assert isinstance(terrain, Flat | FileTerrain)
    return terrain.model_copy(update={"friction": _slippery(terrain, rng, amount)})


def _walls(terrain: Walls, rng: np.random.Generator, amount: float) -> dict[str, Any]:
    """Other distances, leans and friction of two walls."""
    lean = np.array(terrain.lean_rad) + amount * rng.uniform(-0.05, 0.05, 2)
    offset = np.array(terrain.offset_m) + amount * rng.uniform(-0.02, 0.02, 2)
    return {
        "lean_rad": tuple(lean.tolist()),
        "offset_m": tuple(offset.tolist()),
        "friction": _slippery(terrain, rng, amount),
    }


def _panels(rng: np.random.Generator, ice: float) -> dict[str, Any]:
    """Two patterns of panels, each without friction by this chance."""
    if not 0.0 <= ice <= 1.0:
        raise InvalidInput(f"ice: expected a chance in [0, 1], got {ice!r}")
    slippery = rng.random((2, _ROWS, COLUMNS)) < ice
    rows = [["".join(".#"[int(not icy)] for icy in row) for row in side] for side in slippery]
    return {"left": rows[0], "right": rows[1]}


def _slippery(terrain: TerrainSpec, rng: np.random.Generator, amount: float) -> float:
    """Friction up to a fifth less."""
    return float(terrain.friction * (1.0 - amount * rng.uniform(0.0, 0.2)))


def _repeated(values: list[float], count: int) -> list[float]:
    return [values[index % len(values)] for index in range(count)]
