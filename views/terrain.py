"""Terrain as something to look at: patches in tints of their friction, ice like ice, and height
fields as blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_hex, to_rgb, to_rgb as rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrow, Rectangle, Wedge

from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.footholds import Footholds, TerrainPatch
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.polygon import clipped

from .scene import (
    Animation,
    Camera,
    Colour,
    DrawnBody,
    Facet,
    Layer,
    Path,
    Scene,
    Sheet,
    hull,
    polyline,
    ring,
    thinned,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    QUIET,
    SIZE_PX,
    Size,
    headline,
    plain_axes,
    sheet,
)
from .still import Still

_STONE, _STONE_EDGE = "#d9d4c9", "#b5aea0"
_GOOD, _GOOD_EDGE = "#58a695", "#125a50"
_UNSURE = "#d99a2b"
_UNSURE_SD_M = 0.005
"""A foothold whose height has this standard deviation is all amber: 2 cm of touch-down are four of
them [m]."""
_OFF_M = 0.003
"""Footholds are drawn so far off their surface [m]."""
_AXES, _AXIS = ("#c0392b", "#27803b"), 0.15
"""Colours of the world's x and y, drawn from the place nearest to its origin, and their length, in
extents of the terrain."""
_LEGEND = ((_GOOD, "foothold"), (_STONE, "surface"))


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
    scene = _foothold_scene(found)
    Still(scene, _camera(found)).paint(plain_axes(figure, 20.0, 20.0, 90.0))
    return figure


def _foothold_scene(found: Footholds) -> Scene:
    """Surfaces and footholds as facets."""
    surfaces = [_facet(patch, _STONE, _STONE_EDGE, Layer.TERRAIN, 0.0) for patch in found.surfaces]
    good = [
        _facet(piece.patch, _colour(piece), _GOOD_EDGE, Layer.SPACE, _OFF_M)
        for piece in found.pieces
    ]
    low, high = found.extent_m.T
    corner, arms = (
        np.append(np.clip(0.0, low, high)[:2], high[2]),
        _AXIS * float(np.ptp(found.extent_m[:2])),
    )
    axes = [
        Path(pieces_m=np.array([[corner, corner + arms * np.eye(3)[k]]]), colour=colour, width=2.0)
        for k, colour in enumerate(_AXES)
    ]
    return Scene(facets=[*surfaces, *good], paths=axes)


def foothold_motion(found: Footholds) -> Animation:
    """Animation of the footholds, for a page that can be turned, see ``draw_footholds``."""
    scene = _foothold_scene(found)
    outlines = [
        ring(piece.patch.vertices_m + 2.0 * _OFF_M * piece.patch.normal) for piece in found.pieces
    ]
    moment = Scene(paths=[Path(pieces_m=np.concatenate(outlines), colour=_GOOD_EDGE, width=1.2)])
    title = f"footholds of {found.name}: {len(found.pieces)} patches, {found.area_m2:.4g} m²{_sure(found)}"
    amber = ((_UNSURE, f"known to {1e3 * _UNSURE_SD_M:g} mm or worse"),) if _sure(found) else ()
    return Animation(
        fixed=scene,
        moments=[moment],
        step_s=1.0,
        camera=_camera(found),
        title=title,
        legend=(*_LEGEND, *amber),
    )


def _sure(found: Footholds) -> str:
    """Words for the certainty of heights, empty where they are exact."""
    deviations = [piece.height_sd_m for piece in found.pieces if piece.height_sd_m is not None]
    return f", sd of height {1e3 * float(np.median(deviations)):.2g} mm" if deviations else ""


def _colour(piece: TerrainPatch) -> str:
    """Green where a foothold's height is exact, amber where it is not known to ``_UNSURE_SD_M``,
    between them else.
    """
    share = min((piece.height_sd_m or 0.0) / _UNSURE_SD_M, 1.0)
    red, green, blue = (
        (1.0 - share) * a + share * b for a, b in zip(to_rgb(_GOOD), to_rgb(_UNSURE), strict=True)
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


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A sign and its words.

    Arguments:
        sign: arrow, cone, ball, path, box, ice, dot or line.
        length: of an arrow, in 0.01 inch.
    """

    text: str
    sign: str = ""
    colour: Colour = INK
    fill: Colour = "white"
    length: float = 0.0


def force_entry(newtons_a_unit: float, longest: float) -> Entry:
    """The longest arrow of a round force.

    Arguments:
        newtons_a_unit: of an arrow of 0.01 inch of paper.
    """
    power = 10.0 ** np.floor(np.log10(longest * newtons_a_unit))
    newtons = max(
        step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * newtons_a_unit
    )
    return Entry(
        text=f"contact force, {newtons:g} N",
        sign="arrow",
        colour=ACCENT,
        length=newtons / newtons_a_unit,
    )


def draw_legend(
    figure: Figure, bottom: float, entries: Sequence[Entry], friction: ScalarMappable | None = None
) -> None:
    """Write the entries in one line at the foot of the figure, and the scale of friction.

    Arguments:
        bottom: distance of the line from the lower edge of the figure, in 0.01 inch.
        entries: signs with their words, from left to right.
        friction: the colours of friction; None for no scale.
    """
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    axes = plain_axes(figure, 0.0, bottom, height - bottom - 50.0)
    axes.set(xlim=(0.0, width), ylim=(0.0, 50.0))
    x = 30.0
    for entry in entries:
        x += _draw_sign(axes, entry, x)
        axes.text(
            x,
            25.0,
            entry.text,
            size=10.5,
            color=INK,
            va="center_baseline",
            parse_math="$" in entry.text,
        )
        x += 7.75 * len(entry.text) + 21.0
    if friction is not None:
        _draw_friction(figure, bottom, friction)


def mark_com(axes: Axes, at: tuple[float, float], radius: float) -> None:
    """The sign of a centre of mass."""
    axes.add_patch(Circle(at, radius, fc="white", ec=INK, lw=1.3, zorder=6))
    for start in (0.0, 180.0):
        axes.add_patch(Wedge(at, radius, start, start + 90.0, fc=INK, lw=0, zorder=7))


def _draw_sign(axes: Axes, entry: Entry, x: float) -> float:
    """The sign at x; returns the room that it takes."""
    colour = entry.colour
    match entry.sign:
        case "arrow":
            head = min(15.0, 0.6 * entry.length)
            axes.add_patch(
                FancyArrow(
                    x,
                    25.0,
                    entry.length - head,
                    0.0,
                    width=4.5,
                    head_width=14.0,
                    head_length=head,
                    fc=colour,
                    lw=0,
                )
            )
            return entry.length + 10.0
        case "cone":
            axes.fill([x, x + 26.0, x + 26.0], [25.0, 37.0, 13.0], color=colour, alpha=0.12, lw=0)
            axes.plot([x + 26.0, x, x + 26.0], [37.0, 25.0, 13.0], color=colour, alpha=0.4, lw=0.9)
            rim = Ellipse(
                (x + 26.0, 25.0),
                9.0,
                24.0,
                fc=to_rgba(colour, 0.15),
                ec=to_rgba(colour, 0.6),
                lw=0.9,
            )
            axes.add_patch(rim)
            return 40.0
        case "ball":
            mark_com(axes, (x + 12.0, 25.0), 6.5)
            axes.add_patch(
                Circle((x + 12.0, 25.0), 12.0, fill=False, ec=colour, lw=1.0, ls=(0, (3, 2)))
            )
            return 32.0
        case "path":
            axes.plot(
                [x, x + 30.0],
                [25.0, 25.0],
                "-o",
                color=colour,
                ms=5.0,
                lw=1.6,
                mec="white",
                mew=0.8,
            )
            return 42.0
        case "box" | "ice":
            axes.add_patch(Rectangle((x, 16.0), 24.0, 18.0, fc=entry.fill, ec=colour, lw=1.5))
            if entry.sign == "ice":
                axes.plot([x + 7.0, x + 17.0], [18.5, 31.5], color="white", lw=2.0)
            return 33.0
        case "dot":
            axes.add_patch(Circle((x + 6.0, 25.0), 6.0, fc=colour, ec="white", lw=1.0))
            return 18.0
        case "line":
            axes.plot([x, x + 24.0], [25.0, 25.0], color=colour, alpha=0.6, lw=1.0)
            return 32.0
    return 0.0


def _draw_friction(figure: Figure, bottom: float, friction: ScalarMappable) -> None:
    """The scale of colours that stand for friction, at the right."""
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    axes = figure.add_axes(
        ((width - 210.0) / width, (bottom + 22.0) / height, 180.0 / width, 12.0 / height)
    )
    bar = figure.colorbar(friction, cax=axes, orientation="horizontal")
    ends = float(np.max(friction.get_clim()))
    bar.set_ticks([0.0, 0.5 * ends, ends], labels=["0", f"{0.5 * ends:.2g}", f"{ends:.2g}"])
    bar.outline.set_visible(False)
    axes.tick_params(length=0, pad=3, labelsize=10, labelcolor=QUIET)
    axes.text(
        -0.05,
        0.5,
        "friction μ",
        size=10.5,
        color=INK,
        ha="right",
        va="center",
        transform=axes.transAxes,
    )


ICE, ICE_EDGE, ICY = "#d3ebfa", "#5ba7d6", 0.05
"""Colours of ice, and the friction below which a surface is called that."""
_CELL_M = 0.1
"""The grid on surfaces; each cell is painted on its own, so that surfaces may stand one behind
another."""
SCALE = f"grid {_CELL_M:g} m"
"""Words of a picture for it."""
_STRAIGHT_M = 0.0005
"""A line on the ground is straight where it is this near to a piece."""
_LOW, _HIGH, EARTH = np.array(rgb("#9fb4b0")), np.array(rgb("#ecdcc0")), np.array(rgb("#cfc8ba"))
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
        np.floor((whole.min(axis=0) + shift) / _CELL_M),
        np.ceil((whole.max(axis=0) + shift) / _CELL_M),
    )
    sides = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for i in np.arange(first[0], last[0]):
        strip = clipped(
            whole, sides[:2], np.array([(i + 1.0) * _CELL_M - shift[0], shift[0] - i * _CELL_M])
        )
        for j in np.arange(first[1], last[1]):
            cell = clipped(
                strip, sides[2:], np.array([(j + 1.0) * _CELL_M - shift[1], shift[1] - j * _CELL_M])
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
            (whole[:, axis].min() + shift[axis]) / _CELL_M,
            (whole[:, axis].max() + shift[axis]) / _CELL_M,
        )
        at = np.arange(np.floor(low) + 1.0, np.ceil(high)) * _CELL_M - shift[axis]
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
        Sheet(points_m=points, colours=_LOW + share[..., None] * (_HIGH - _LOW)),
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
                on_ground(points if warp is None else warp(points), field, low, high, _STRAIGHT_M)
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
