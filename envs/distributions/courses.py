"""Distributions of courses: the built-in ones and the user's, perturbed, and walls with random
panels of ice.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
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

ICE = 0.5
"""Share of the panels of icy walls that have no friction."""
ROWS, COLUMNS = 24, 8
"""Size of a drawn pattern of panels; larger walls repeat it."""
REDRAWS = 1000
SMALL = ("stairs", "walls", "tube", "icy-walls")


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
    slippery = rng.random((2, ROWS, COLUMNS)) < ice
    rows = [["".join(".#"[int(not icy)] for icy in row) for row in side] for side in slippery]
    return {"left": rows[0], "right": rows[1]}


def _slippery(terrain: TerrainSpec, rng: np.random.Generator, amount: float) -> float:
    """Friction up to a fifth less."""
    return float(terrain.friction * (1.0 - amount * rng.uniform(0.0, 0.2)))


def _repeated(values: list[float], count: int) -> list[float]:
    return [values[index % len(values)] for index in range(count)]
