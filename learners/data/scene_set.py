"""Scenes of a terrain family for other simulators: heights, surfaces, and whether the hexapod has a
plan there.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.files.arrays import checked, checked_int
from stancekit.planners.files.writing import check_new_folder, replaced
from stancekit.planners.problem.candidates import NoFooting
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.answer import Planner
from stancekit.planners.terrain.families import family_terrain, terrain_family
from stancekit.planners.terrain.family import SCENE
from stancekit.planners.terrain.terrain import Terrain

FORMAT = "stancekit/scenes/1"
INDEX = "scenes.json"


@dataclass(frozen=True, kw_only=True)
class SceneVerdict:
    """Verdict on a scene.

    Arguments:
        proof: of an infeasible one, a certificate that was verified, or that nothing is within
            reach of some toe; else empty.
    """

    status: Status
    proof: str = ""


def judged(planner: Planner, name: str) -> SceneVerdict:
    """Decide whether the course FAMILY:LEVEL:SEED has a plan, by a planner whose answers are
    verified. Raises InvalidInput.
    """
    try:
        outcome = planner.solve(read_course(name))
    except NoFooting:
        return SceneVerdict(status=Status.INFEASIBLE, proof="no footing")
    if outcome.status is Status.INFEASIBLE and outcome.certificate is None:
        return SceneVerdict(status=Status.UNDECIDED)
    return SceneVerdict(
        status=outcome.status, proof="certificate" if outcome.status is Status.INFEASIBLE else ""
    )


def export_scenes(
    out: Path,
    family: str,
    level: float,
    *,
    count: int,
    planner: Planner,
    seed: int = 0,
    spacing_m: float = 0.02,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write scenes ``seed`` to ``seed + count − 1`` into a new or empty folder, whole or not at
    all; and their index.

    Raises InvalidInput for a folder with something in it, and for another family, level, seed or
    spacing.
    """
    check_new_folder(out)
    checked_int(count, "count", least=1)
    family_terrain(family, level, seed)  # what is wrong is said before a folder is made
    scenes = []
    with replaced(out, folder=True) as folder:
        for k in range(count):
            number = seed + k
            scene = family_terrain(family, level, number)
            verdict = judged(planner, f"{family}:{level!r}:{number}")
            record = {
                "seed": number,
                "status": verdict.status.value,
                "proof": verdict.proof,
                "figures": dict(scene.figures),
            }
            if scene.rise is not None:
                record |= _heights(folder, f"{number}.npy", scene, spacing_m)
            scenes.append(record | {"surfaces": _surfaces(scene)})
            if progress is not None:
                progress(k + 1, count)
        index = {
            "format": FORMAT,
            "family": family,
            "level": level,
            "quantity": terrain_family(family).quantity,
            "robot": "hexapod",
            "scenes": scenes,
        }
        (folder / INDEX).write_text(json.dumps(index), encoding="utf-8")
    return index


def _heights(folder: Path, name: str, scene: Terrain, spacing_m: float) -> dict[str, Any]:
    """The keys of the heights of a scene, written into its folder."""
    step = checked(spacing_m, "spacing_m", least=0.002, most=0.2)
    (x0, y0, _), (x1, y1, _) = SCENE
    x, y = (
        scene.begin_m[k] + np.arange(a, b + 1e-9, step)
        for k, (a, b) in enumerate(((x0, x1), (y0, y1)))
    )
    np.save(folder / name, scene.grid(x, y))
    return {"heights": name, "spacing_m": spacing_m, "corner_m": [float(x[0]), float(y[0])]}


def _surfaces(scene: Terrain) -> list[dict[str, Any]]:
    """Every polygon with its normal and friction."""
    return [
        {
            "vertices_m": patch.vertices_m.tolist(),
            "normal": patch.normal.tolist(),
            "friction": patch.friction,
            "footing": footing,
        }
        for patch, footing in scene.surfaces
    ]
