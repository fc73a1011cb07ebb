"""Footholds of a terrain as a picture and a page: what may be stood on in green, the rest of the
terrain in stone.

Footholds whose height is measured with noise go from green to amber, the less sure their plane is.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.footholds import Footholds, TerrainPatch

from .camera import Camera
from .scene import Animation, Facet, Layer, Path, Scene
from .shapes import ring
from .sheet import DEFAULT_STYLE, SIZE_PX, Size, headline, plain_axes, sheet
from .still import Still

STONE, STONE_EDGE = "#d9d4c9", "#b5aea0"
GOOD, GOOD_EDGE = "#58a695", "#125a50"
UNSURE = "#d99a2b"
UNSURE_SD_M = 0.005
"""A foothold whose height has this standard deviation is all amber: 2 cm of touch-down are four of
them [m]."""
OFF_M = 0.003
"""Footholds are drawn so far off their surface [m]."""
AXES, AXIS = ("#c0392b", "#27803b"), 0.15
"""Colours of the world's x and y, drawn from the terrain's least corner, and their length, in
extents of the terrain."""
LEGEND = ((GOOD, "foothold"), (STONE, "surface"))


@DEFAULT_STYLE
def draw_footholds(found: Footholds, *, size_px: Size = SIZE_PX) -> Figure:
    """The terrain with its footholds, seen from above aside.

    Raises InvalidInput below 300 pixels.
    """
    figure = sheet(size_px)
    refused = ", ".join(
        f"{name} {area:.3g}" for name, area in found.refused_m2.items() if area > 1e-3
    )
    x, y = (
        f"{axis} {a:.4g} to {b:.4g} m"
        for axis, (a, b) in zip("xy", found.extent_m[:2], strict=True)
    )
    sizes = f"{len(found.pieces)} patches, {found.area_m2:.4g} m²{_sure(found)}"
    subtitle = f"{sizes}; {x} (red), {y} (green); not: {refused or 'nothing'}"
    headline(figure, f"footholds of {found.name}", subtitle)
    Still(_foothold_scene(found), _camera(found)).paint(plain_axes(figure, 20.0, 20.0, 90.0))
    return figure


def _foothold_scene(found: Footholds) -> Scene:
    """Surfaces and footholds as facets."""
    surfaces = [_facet(patch, STONE, STONE_EDGE, Layer.TERRAIN, 0.0) for patch in found.surfaces]
    good = [
        _facet(piece.patch, _colour(piece), GOOD_EDGE, Layer.SPACE, OFF_M) for piece in found.pieces
    ]
    low, high = found.extent_m.T
    corner, arms = np.append(low[:2], high[2]), AXIS * float(np.ptp(found.extent_m[:2]))
    axes = [
        Path(pieces_m=np.array([[corner, corner + arms * np.eye(3)[k]]]), colour=colour, width=2.0)
        for k, colour in enumerate(AXES)
    ]
    return Scene(facets=[*surfaces, *good], paths=axes)


def foothold_motion(found: Footholds) -> Animation:
    """Animation of the footholds, for a page that can be turned."""
    scene = _foothold_scene(found)
    outlines = [
        ring(piece.patch.vertices_m + 2.0 * OFF_M * piece.patch.normal) for piece in found.pieces
    ]
    moment = Scene(paths=[Path(pieces_m=np.concatenate(outlines), colour=GOOD_EDGE, width=1.2)])
    title = f"footholds of {found.name}: {len(found.pieces)} patches, {found.area_m2:.4g} m²{_sure(found)}"
    amber = ((UNSURE, f"known to {1e3 * UNSURE_SD_M:g} mm or worse"),) if _sure(found) else ()
    return Animation(
        fixed=scene,
        moments=[moment],
        step_s=1.0,
        camera=_camera(found),
        title=title,
        legend=(*LEGEND, *amber),
    )


def _sure(found: Footholds) -> str:
    """Words for the certainty of heights, empty where they are exact."""
    deviations = [piece.height_sd_m for piece in found.pieces if piece.height_sd_m is not None]
    return f", sd of height {1e3 * float(np.median(deviations)):.2g} mm" if deviations else ""


def _colour(piece: TerrainPatch) -> str:
    """Green where a foothold's height is exact, amber where it is not known to ``UNSURE_SD_M``,
    between them else.
    """
    share = min((piece.height_sd_m or 0.0) / UNSURE_SD_M, 1.0)
    red, green, blue = (
        (1.0 - share) * a + share * b for a, b in zip(to_rgb(GOOD), to_rgb(UNSURE), strict=True)
    )
    return to_hex((red, green, blue))


def _facet(patch: Patch, colour: str, edge: str, layer: Layer, off_m: float) -> Facet:
    return Facet(
        corners_m=patch.vertices_m + off_m * patch.normal,
        normal=patch.normal,
        colour=colour,
        edge=edge,
        width=0.5,
        layer=layer,
    )


def _camera(found: Footholds) -> Camera:
    corners: Array = np.concatenate(
        [patch.vertices_m for patch in (*found.surfaces, *(piece.patch for piece in found.pieces))]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Camera(
        target_m=0.5 * (low + high),
        azimuth_rad=np.deg2rad(-60.0),
        elevation_rad=np.deg2rad(38.0),
        distance_m=1.8 * float(np.linalg.norm(high - low)) + 1e-3,
    )
