"""The terrain of a course in a picture: surfaces in tints of their friction, ice like ice, and the chosen patches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgb as rgb

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.polygon import clipped

from .painter import TERRAIN, VEIL, Painter
from .plot import leg_colour

ICE, ICE_EDGE, ICY = "#d3ebfa", "#5ba7d6", 0.05
"""Colours of ice, and the friction below which a surface is called that."""
GLASS = 0.10
"""Opacity of a surface between the viewer and the robot."""
MARGIN_M = 0.08
"""Terrain is shown so far beyond everywhere that the robot goes."""
CELL_M = 0.1
"""The grid on surfaces; each cell is painted on its own, so that surfaces may stand one behind another."""


def bounds(plan: Plan) -> Array:
    """Lowest and highest coordinates of what is shown, shape (2, 3) [m]: chosen patches, bodies, goal, and a margin."""
    course = plan.course
    mounts = np.array([limb.shoulder_m for limb in course.robot.limbs])
    bodies = (plan.com_m[:, None] + mounts).reshape(-1, 3)
    chosen = [course.patch(p, plan.choice).vertices_m for p in range(len(course.placements))]
    points = np.concatenate([*chosen, bodies, course.goal_m[None]])
    return np.array([points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M])


Piece = tuple[Patch, list[tuple[tuple[int, int], Array]]]
"""A surface and its cells: place in the grid, and corners."""


def pieces(plan: Plan) -> list[Piece]:
    """Every surface of the terrain with its cells within the bounds."""
    box = bounds(plan)
    return [(patch, list(cells(patch, box))) for patch in plan.course.terrain]


def draw_terrain(painter: Painter, terrain: list[Piece], middle_m: Array, friction: ScalarMappable) -> None:
    """Every surface, cell by cell; what stands between the viewer and the middle of the robot's way is glass."""
    middle = painter.near(middle_m)
    for patch, grid in terrain:
        icy = patch.friction < ICY
        colour = np.array(rgb(ICE)) if icy else 0.45 + 0.55 * np.array(friction.to_rgba(np.array(patch.friction))[:3])
        edge = np.array(rgb(ICE_EDGE)) if icy else 0.82 * colour
        shade = 0.6 * colour + 0.4 * np.array(painter.lit(colour, patch.normal)[:3])
        for (i, j), cell in grid:
            centre = cell.mean(axis=0)
            behind = painter.near(centre) < middle
            solid = behind or painter.facing(centre, patch.normal) > 0.0
            layer, alpha = (TERRAIN, 1.0) if solid else (VEIL, GLASS)
            depth = painter.near(centre) - (0.0 if solid else 9.0)
            painter.face(cell, (*shade, alpha), layer, edge=(*edge, 0.6 * alpha), width=0.7, depth=depth)
            if icy and (i + 2 * j) % 3 == 0:
                _glint(painter, patch, cell, layer, depth)


def draw_windows(painter: Painter, plan: Plan, friction: ScalarMappable, frame: int) -> None:
    """The patches that the plan chose: under the robot at a frame in full colour, the others as outlines."""
    course = plan.course
    under = set(course.holds[frame].tolist())
    for p, put in enumerate(course.placements):
        patch = course.patch(p, plan.choice)
        limb = course.robot.limb_names.index(put.limb)
        centre = patch.centre_m
        shown = painter.facing(centre, patch.normal) > 0.0
        layer = TERRAIN if shown else VEIL
        fill: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
        if p in under:
            fill = (*friction.to_rgba(np.array(patch.friction))[:3], 0.55 if shown else 0.15)
        edge = (*rgb(leg_colour(limb)), (0.95 if p in under else 0.4) * (1.0 if shown else 0.6))
        depth = painter.near(centre) + 9.0
        painter.face(patch.vertices_m, fill, layer, edge=edge, width=1.5 if p in under else 0.9, depth=depth)


def cells(patch: Patch, box: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """The pieces of a patch within a box, cut along a grid on its plane: place in the grid, and shape (K, 3) [m]."""
    plane = patch.frame[:, 1:]
    origin = patch.vertices_m[0]
    normals = np.concatenate([plane, -plane])
    offsets = np.concatenate([box[1] - origin, origin - box[0]])
    flat = np.linalg.norm(normals, axis=1) < 1e-9
    if np.any(offsets[flat] < 0.0):
        return
    whole = clipped((patch.vertices_m - origin) @ plane, normals[~flat], offsets[~flat])
    if len(whole) < 3:
        return
    shift = origin @ plane  # lines at multiples of the cell's size in the world
    first, last = np.floor((whole.min(axis=0) + shift) / CELL_M), np.ceil((whole.max(axis=0) + shift) / CELL_M)
    sides = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for i in np.arange(first[0], last[0]):
        strip = clipped(whole, sides[:2], np.array([(i + 1.0) * CELL_M - shift[0], shift[0] - i * CELL_M]))
        if len(strip) < 3:
            continue
        for j in np.arange(first[1], last[1]):
            cell = clipped(strip, sides[2:], np.array([(j + 1.0) * CELL_M - shift[1], shift[1] - j * CELL_M]))
            if len(cell) >= 3:
                yield (int(i), int(j)), origin + cell @ plane.T


def _glint(painter: Painter, patch: Patch, cell: Array, layer: int, depth: float) -> None:
    """Three strokes of light across a cell of ice."""
    y, z = patch.frame[:, 1], patch.frame[:, 2]
    size = 0.5 * float(np.min(np.ptp(cell @ patch.frame[:, 1:], axis=0)))
    alpha = 1.0 if layer == TERRAIN else 0.5
    for aside, length, colour in ((-0.35, 0.45, "white"), (0.0, 0.85, "white"), (0.28, 0.40, ICE_EDGE)):
        middle = cell.mean(axis=0) + size * aside * (y - z)
        ends = np.array([middle - size * length * (y + z), middle + size * length * (y + z)])
        painter.face(ends, "none", layer, edge=(*rgb(colour), alpha), width=1.6, depth=depth + 0.05)
