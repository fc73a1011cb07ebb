"""The footholds of whatever a terrain is: a mesh, a map, or a file of either."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InvalidInput
from .footholds import FootholdLimits, Footholds
from .import_options import ImportOptions

if TYPE_CHECKING:
    from .elevation import ElevationMap
    from .triangle_mesh import TriangleMesh

SINGLE = 0.8
"""Surfaces of a mesh by its triangles, where most triangles are alone in their planes."""


def footholds_of(
    terrain: TriangleMesh | ElevationMap,
    limits: FootholdLimits = FootholdLimits(),
    friction: float = 1.0,
    *,
    none: bool = False,
) -> Footholds:
    """The footholds of a mesh or a map.

    Raises InvalidInput, with the reasons, where there is none, unless ``none`` says that there may
    be none.
    """
    from .facets import shapely_module
    from .triangle_mesh import TriangleMesh

    broken = shapely_module().errors.ShapelyError
    try:
        if isinstance(terrain, TriangleMesh):
            from .mesh_footholds import mesh_footholds

            footholds = mesh_footholds(terrain, limits, friction)
        else:
            from .map_footholds import map_footholds

            footholds = map_footholds(terrain, limits, friction)
    except broken as error:  # outlines that cross themselves within the last digits
        raise InvalidInput(
            f"{terrain.name}: expected surfaces with outlines, got some that cross themselves; "
            "another spacing_m or "
            f"offset_m may help: {' '.join(str(error).split()):.100}"
        ) from None
    if not footholds.pieces and not none:
        refused = ", ".join(
            f"{area:.3g} m² {name}" for name, area in footholds.refused_m2.items() if area > 0.0
        )
        hint = ""
        if footholds.refused_m2["edge"] + footholds.refused_m2["small"] > 0.0:
            hint = f"; no surface has room for a foot that is {2e3 * limits.inset_m:.3g} mm wide (margin_m)"
            if isinstance(terrain, TriangleMesh) and len(footholds.surfaces) > SINGLE * len(
                terrain.triangles
            ):
                hint = "; triangles of a scan that lean by its noise have no planes: make it a map"
        raise InvalidInput(
            f"{terrain.name}: expected footholds, got none: {refused or 'no area'}{hint}"
        )
    return footholds


def read_footholds(
    path: str | Path,
    options: ImportOptions = ImportOptions(),
    limits: FootholdLimits = FootholdLimits(),
    friction: float = 1.0,
) -> Footholds:
    """The footholds of a terrain's file.

    Raises InvalidInput for one that is none, or has none.
    """
    from .terrain_file import (
        read_terrain,
    )  # scipy and trimesh are no part of a course without a file
    from .triangle_mesh import TriangleMesh

    terrain = read_terrain(path, options)
    if isinstance(terrain, TriangleMesh):
        terrain.check_size()
    return footholds_of(terrain, limits, friction)


def check_unasked(options: ImportOptions, name: str) -> None:
    """Raise InvalidInput for options of a file where there is none."""
    for field in fields(options):
        if getattr(options, field.name) != field.default:
            raise InvalidInput(
                f"{field.name}: expected none with {name or 'a height field'}, which is read from "
                "no file"
            )
