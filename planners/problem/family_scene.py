"""Terrains of courses that are drawn from a family at a level, and the course that goes with
each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from ..errors import InvalidInput
from ..files.arrays import Array
from ..robot.urdf import FOOT_RADIUS_M
from ..terrain.families import TERRAIN_FAMILIES, family_terrain, read_draw
from ..terrain.patch import Patch
from ..terrain.terrain import Terrain
from .terrain_spec import ROOM_M, TerrainSpec

FRAMES, STRIDE_M, HEIGHT_M = 4, 0.08, 0.20
"""Numbers of the courses, see ``family_keys``."""


class FamilyScene(TerrainSpec):
    """A scene of a family, see ``terrain.families``, about the origin.

    Arguments:
        friction: a factor on what is drawn.
    """

    kind: Literal["family"] = "family"
    family: str
    level: Annotated[float, Field(ge=0.0, le=1.0)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @field_validator("family")
    @classmethod
    def _is_family(cls, family: str) -> str:
        if (
            family not in TERRAIN_FAMILIES.names()
        ):  # none of a FILE.py: reading a course runs nothing
            raise InvalidInput(
                f"expected one of {', '.join(TERRAIN_FAMILIES.names())}, got {family!r}"
            )
        return family

    def along(self, path_m: Array, folder: Path) -> Terrain:
        """The scene, wherever the path goes."""
        return family_terrain(self.family, self.level, self.seed).with_friction(self.friction)


def family_keys(name: str) -> dict[str, Any]:
    """The course of a name FAMILY:LEVEL or FAMILY:LEVEL:SEED, in keys as YAML has them.

    Raises InvalidInput.

    The default hexapod walks FRAMES key frames of a tripod gait, STRIDE_M each, in the mean
    HEIGHT_M above the ground and along it; between walls it climbs. A toe is offered all that it
    could reach.
    """
    family, level, seed = read_draw(name, "course")
    scene = family_terrain(family, level, seed)
    rise = scene.rise
    far = STRIDE_M * (FRAMES - 1)
    along = 1.0 if rise is None else float((1.0 + rise**2) ** 0.5)
    x, y, z = scene.begin_m
    start = [x, y, z + HEIGHT_M]
    goal = (
        [x, y, start[2] + far]
        if rise is None
        else [x + far / along, y, start[2] + far * rise / along]
    )
    stance = {"outward_m": 0.13, "down_m": 0.0 if rise is None else HEIGHT_M}
    return {
        "name": Path(name).name.replace(":", "-"),
        "frames": FRAMES,
        "gait": "tripod",
        "start_m": start,
        "goal_m": goal,
        "stride_m": STRIDE_M,
        "stance": stance,
        "body": {"com_radius_m": 0.06, "first_radius_m": 0.02},
        "steps": {"com_m": 0.15, "toe_m": 0.40, "rotation_rad": 0.15, "progress_m": 0.02},
        "candidates": {"everywhere": True, "margin_m": FOOT_RADIUS_M + ROOM_M},
        "terrain": polygon_keys(*zip(*scene.surfaces, strict=True))
        if ".py:" in family
        else {"kind": "family", "family": family, "level": level, "seed": seed},
    }


def polygon_keys(patches: Sequence[Patch], footing: Sequence[bool]) -> dict[str, Any]:
    """A terrain in keys, surface by surface.

    Arguments:
        footing: truth values, True for patches that toes may stand on.
    """
    polygons = [
        {
            "vertices_m": patch.vertices_m.tolist(),
            "normal": patch.normal.tolist(),
            "friction": patch.friction,
            "shear_reference": patch.shear_reference.tolist(),
            "footing": footing,
        }
        for patch, footing in zip(patches, footing, strict=True)
    ]
    return {"kind": "polygons", "polygons": polygons}
