"""Terrain as something to look at: patches in tints of their friction, ice like ice, and height
fields as blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgb as rgb

from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.polygon import clipped

from .scene import Colour, DrawnBody, Facet, Layer, Path, Scene, Sheet
from .shapes import hull, polyline, thinned
from .sheet import INK

ICE, ICE_EDGE, ICY = "#d3ebfa", "#5ba7d6", 0.05
"""Colours of ice, and the friction below which a surface is called that."""
CELL_M = 0.1
"""The grid on surfaces; each cell is painted on its own, so that surfaces may stand one behind
another."""
SCALE = f"grid {CELL_M:g} m"
"""Words of a picture for it."""
STRAIGHT_M = 0.0005
"""A line on the ground is straight where it is this near to a piece."""
LOW, HIGH, EARTH = np.array(rgb("#9fb4b0")), np.array(rgb("#ecdcc0")), np.array(rgb("#cfc8ba"))
"""Colours of the lowest and the highest ground, and of what is below it."""


def tint(friction: float, colours: ScalarMappable) -> Colour:
    """Colour of a surface of this friction."""
    return (
        ICE
        if friction < ICY
        else tuple(0.45 + 0.55 * np.array(colours.to_rgba(np.array(friction))[:3]))
    )


def patches(terrain: Iterable[Patch], box_m: Array, colours: ScalarMappable) -> Scene:
    """The parts of patches within a box, lowest and highest corner, shape (2, 3) [m], in cells,
    with glints on ice.
    """
    facets, glints = list[Facet](), list[Array]()
    for patch in terrain:
        colour = tint(patch.friction, colours)
        edge = ICE_EDGE if patch.friction < ICY else tuple(0.82 * np.array(colour))
        for (i, j), cell in cells(patch, box_m):
            facets.append(
                Facet(corners_m=cell, normal=patch.normal, colour=colour, edge=(*rgb(edge), 0.6))
            )
            if patch.friction < ICY and (i + 2 * j) % 3 == 0:
                glints.append(_glints(patch, cell))
    strokes = np.array(glints).reshape(-1, 3, 2, 3)
    paths = [
        Path(pieces_m=pieces, colour=colour, width=1.6, layer=Layer.TERRAIN, lift_m=0.05)
        for pieces, colour in (
            (strokes[:, :2].reshape(-1, 2, 3), "white"),
            (strokes[:, 2], ICE_EDGE),
        )
        if len(pieces)
    ]
    return Scene(facets=facets, paths=paths)


def cells(patch: Patch, box_m: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """The pieces of a patch within a box, cut along a grid on its plane: place in the grid, and
    shape (K, 3) [m].
    """
    plane, origin = patch.frame[:, 1:], patch.vertices_m[0]
    whole = _within(patch, box_m)
    if len(whole) < 3:
        return
    shift = origin @ plane  # lines at multiples of the cell's size in the world
    first, last = (
        np.floor((whole.min(axis=0) + shift) / CELL_M),
        np.ceil((whole.max(axis=0) + shift) / CELL_M),
    )
    sides = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for i in np.arange(first[0], last[0]):
        strip = clipped(
            whole, sides[:2], np.array([(i + 1.0) * CELL_M - shift[0], shift[0] - i * CELL_M])
        )
        for j in np.arange(first[1], last[1]):
            cell = clipped(
                strip, sides[2:], np.array([(j + 1.0) * CELL_M - shift[1], shift[1] - j * CELL_M])
            )
            if len(cell) >= 3:
                yield (int(i), int(j)), origin + cell @ plane.T


Piece = tuple[Array, Array]
"""The part of a patch that is drawn and the lines of the grid on it, (K, 3) and (L, 2, 3) [m]."""


def surfaces(terrain: Sequence[Patch], pieces: Sequence[Piece], colours: ScalarMappable) -> Scene:
    """The parts of patches within a box in one piece each, with the lines of the grid on them: for
    those who draw with a depth buffer, and many times a second. As ``patches`` otherwise.

    Arguments:
        pieces: of each patch, as ``pieces_within`` gives them.
    """
    facets, lines, tints = list[Facet](), dict[Colour, list[Array]](), dict[float, Colour]()
    for patch, (corners, grid) in zip(terrain, pieces, strict=True):
        if len(corners) < 3:
            continue
        if patch.friction not in tints:
            tints[patch.friction] = tint(patch.friction, colours)
        colour = tints[patch.friction]
        edge = ICE_EDGE if patch.friction < ICY else tuple(0.82 * np.array(colour))
        facets.append(
            Facet(
                corners_m=corners,
                normal=patch.normal,
                colour=colour,
                edge=(*rgb(edge), 1.0),
                width=1.4,
            )
        )
        lines.setdefault(rgb(edge), []).append(grid)
    return Scene(
        facets=facets,
        paths=[
            Path(pieces_m=np.concatenate(each), colour=edge, width=0.6)
            for edge, each in lines.items()
        ],
    )


def pieces_within(terrain: Iterable[Patch], box_m: Array) -> list[Piece]:
    """The pieces of patches in a box that is given by two corners, shape (2, 3) [m]; nothing of
    those outside.
    """
    pieces = list[Piece]()
    for patch in terrain:
        whole = _within(patch, box_m)
        if len(whole) < 3:
            pieces.append((np.zeros((0, 3)), np.zeros((0, 2, 3))))
            continue
        plane, origin = patch.frame[:, 1:], patch.vertices_m[0] + 0.001 * patch.normal
        grid = _grid(whole, patch.vertices_m[0] @ plane)
        pieces.append((patch.vertices_m[0] + whole @ plane.T, origin + grid @ plane.T))
    return pieces


def _within(patch: Patch, box_m: Array) -> Array:
    """The part of a patch that lies within a box, as a polygon in the coordinates of the patch's
    plane.

    Arguments:
        patch: the patch; its first corner is the origin of the coordinates.
        box_m: lower and upper corner of the box in the world frame, shape (2, 3) [m].

    Returns:
        The corners, shape (K, 2) [m]; K < 3 if no part lies within.
    """
    plane, origin = patch.frame[:, 1:], patch.vertices_m[0]
    normals = np.concatenate([plane, -plane])
    offsets = np.concatenate([box_m[1] - origin, origin - box_m[0]])
    flat = np.linalg.norm(normals, axis=1) < 1e-9
    if np.any(offsets[flat] < 0.0):
        return np.zeros((0, 2))
    return clipped((patch.vertices_m - origin) @ plane, normals[~flat], offsets[~flat])


def _grid(whole: Array, shift: Array) -> Array:
    """Lines at multiples of the cell's size in the world across a convex piece, shape (L, 2, 2)
    [m].
    """
    pieces = [np.zeros((0, 2, 2))]
    ahead = np.roll(whole, -1, axis=0)
    for axis in (0, 1):
        low, high = (
            (whole[:, axis].min() + shift[axis]) / CELL_M,
            (whole[:, axis].max() + shift[axis]) / CELL_M,
        )
        at = np.arange(np.floor(low) + 1.0, np.ceil(high)) * CELL_M - shift[axis]
        run = ahead[:, axis] - whole[:, axis]
        share = (at[:, None] - whole[:, axis]) / np.where(np.abs(run) < 1e-12, np.inf, run)
        across = whole[:, 1 - axis] + share * (ahead - whole)[:, 1 - axis]
        hit = (share >= 0.0) & (share <= 1.0) & (np.abs(run) > 1e-12)
        ends = np.stack(
            [np.where(hit, across, np.inf).min(axis=1), np.where(hit, across, -np.inf).max(axis=1)],
            axis=1,
        )
        keep = np.isfinite(ends).all(axis=1)
        lines = np.empty((int(keep.sum()), 2, 2))
        lines[..., axis], lines[..., 1 - axis] = at[keep, None], ends[keep]
        pieces.append(lines)
    return np.concatenate(pieces)


def block(
    field: HeightField, low: Array, high: Array, *, facets: int, depth_m: float, relief_m: float
) -> list[Sheet]:
    """A height field between two corners, shape (2,) [m], coloured by height, on a block of earth.

    Arguments:
        facets: along its longer side.
        depth_m: of the block below the lowest place.
        relief_m: heights that differ by less are less than all colours apart.
    """
    step = float(np.max(high - low)) / facets
    lines = (
        np.linspace(a, b, max(2, round((b - a) / step) + 1)) for a, b in zip(low, high, strict=True)
    )
    xy = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    points = np.concatenate([xy, field.height(xy)[..., None]], axis=-1)
    heights = points[..., 2]
    share = (heights - heights.min()) / max(float(np.ptp(heights)), relief_m, 1e-9)
    floor = float(heights.min()) - depth_m
    borders = (points[:, 0], points[::-1, -1], points[0, ::-1], points[-1])
    sides = [
        np.stack([np.where([False, False, True], floor, border), border], axis=1)
        for border in borders
    ]
    return [
        Sheet(points_m=points, colours=LOW + share[..., None] * (HIGH - LOW)),
        *(Sheet(points_m=side, colours=np.broadcast_to(EARTH, side.shape)) for side in sides),
    ]


def on_ground(
    points: Array, field: HeightField, low: Array, high: Array, off_m: float = 0.0
) -> Array:
    """The pieces between points in a row, shape (K, 3) [m], over these corners, laid on the
    terrain: (L, 2, 3) [m].

    Arguments:
        off_m: points are left out where the ground is as straight as this.
    """
    inside = np.all((points[:, :2] >= low) & (points[:, :2] <= high), axis=1)
    laid = np.column_stack([points[:, :2], field.height(points[:, :2])])
    turns = np.flatnonzero(np.diff(inside)) + 1
    runs = [
        run
        for run, seen in zip(np.split(laid, turns), np.split(inside, turns), strict=True)
        if seen[0]
    ]
    return np.concatenate([np.zeros((0, 2, 3)), *(polyline(thinned(run, off_m)) for run in runs)])


def grid_on_ground(
    field: HeightField,
    low: Array,
    high: Array,
    step_m: float,
    corners: int,
    warp: Callable[[Array], Array] | None = None,
) -> Array:
    """Lines of constant x and of constant y over a field, ``step_m`` apart, laid on it between two
    corners, shape (2,) [m], in pieces of shape (L, 2, 3) [m].

    Arguments:
        corners: of a line, before those are left out that are not needed.
        warp: takes the lines, shape (K, 3), to where they run.
    """
    pieces = [np.zeros((0, 2, 3))]
    (x0, x1), (y0, y1) = field.domain_m
    for axis, ((first, last), (begin, end)) in enumerate(
        (((x0, x1), (y0, y1)), ((y0, y1), (x0, x1)))
    ):
        points = np.zeros((corners, 3))
        points[:, 1 - axis] = np.linspace(begin, end, corners)
        for value in step_m * np.arange(np.ceil(first / step_m), np.floor(last / step_m) + 1.0):
            points[:, axis] = value
            pieces.append(
                on_ground(points if warp is None else warp(points), field, low, high, STRAIGHT_M)
            )
    return np.concatenate(pieces)


def plane(axis: int, sign: float, corners_m: Array, step_m: float) -> Scene:
    """A pale piece of the plane across an axis between two corners, shape (2, 3) [m], with grid
    lines.
    """
    low, high = corners_m
    first, second = (k for k in range(3) if k != axis)
    corners = np.array([low, low, high, high])
    corners[1, first], corners[3, first] = high[first], low[first]
    lines = []
    for k in (first, second):
        for at in step_m * np.arange(np.ceil(low[k] / step_m), high[k] / step_m):
            lines.append(np.array([low, high]))
            lines[-1][:, k] = at
    plane = Facet(
        corners_m=corners,
        normal=sign * np.eye(3)[axis],
        colour="#f3f5f7",
        edge="#c3cad2",
        width=1.0,
        layer=Layer.BACKDROP,
        lift_m=-99.0,
    )
    grid = Path(
        pieces_m=np.array(lines), colour="#dde2e8", width=0.8, layer=Layer.BACKDROP, lift_m=-33.0
    )
    return Scene(facets=[plane], paths=[grid] if lines else [])


def stone(patch: Patch, axis: int, level: float, colour: Colour, *, behind: bool) -> Scene:
    """A block from the plane up to a patch, its sides a tint of the colour; of glass where seen
    from behind.
    """
    tint = 0.35 * np.array(colour) + 0.65 * np.array(rgb("#dcd8d0"))
    foot = np.where(np.arange(3) == axis, level, patch.vertices_m)
    block = DrawnBody(
        name="stone",
        shape=hull(np.vstack([patch.vertices_m, foot])),
        position_m=np.zeros(3),
        colour=tuple(tint),
        edge=None if behind else tuple(0.75 * tint),
        opacity=0.3 if behind else 1.0,
    )
    face = Facet(
        corners_m=patch.vertices_m,
        normal=patch.normal,
        colour=colour,
        edge=INK,
        width=1.0,
        opacity=0.75 if behind else 1.0,
        layer=Layer.GLASS if behind else Layer.SPACE,
        lift_m=0.05,
    )
    return Scene(bodies=[block], facets=[face])


def _glints(patch: Patch, cell: Array) -> Array:
    """Three strokes of light across a cell of ice, shape (3, 2, 3)."""
    y, z = patch.frame[:, 1], patch.frame[:, 2]
    size = 0.5 * float(np.min(np.ptp(cell @ patch.frame[:, 1:], axis=0)))
    middle = cell.mean(axis=0) + 0.002 * patch.normal
    strokes = ((-0.35, 0.45), (0.0, 0.85), (0.28, 0.40))
    return np.array(
        [
            [middle + size * (aside * (y - z) + side * half * (y + z)) for side in (-1.0, 1.0)]
            for aside, half in strokes
        ]
    )
