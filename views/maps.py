"""Pictures of warp maps: the map's grid over its terrain, and conformal error (Pan et al. Fig.
4).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch as Swatch

from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    LIKELY,
    LIMITS,
    UNKNOWN,
    UNLIKELY,
    VERDICTS,
    StandingMap,
)
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.warp.report import MapReport
from stancekit.planners.warp.spline_map import SplineMap

from .scene import Camera, Path, Scene, polyline
from .sheet import (
    DEFAULT_STYLE,
    INK,
    QUIET,
    SIZE_PX,
    Size,
    headline,
    plain_axes,
    quiet_axes,
    sheet,
)
from .still import Still
from .terrain import EARTH, block

_COLOURS = ("#e4e7eb", "#2c8173", "#b8407a", "#a9d6c9", "#e6bcd3")
"""Colours of unknown, feasible, infeasible, likely feasible, likely infeasible."""
_WAYS = ("#8a5a44", "#d1495b", "#edae49", "#00798c", "#30638e", "#6f5aa8", "#444b54")
"""Colours of limits, in their order."""
_BEST = (FEASIBLE, LIKELY, UNKNOWN, UNLIKELY, INFEASIBLE)
"""From the best verdict to the worst."""
_SIZE_IN = (9.0, 8.4)
_TALL_IN = (8.0, 11.0)
LONG = 1.8
"""Length of a map over its width from which on its panels stand below each other."""


@DEFAULT_STYLE
def draw_standing_map(found: StandingMap) -> Figure:
    """The map: the best verdict over the headings of each place, the share of its headings in which
    the robot can stand, how far its body may move there, and what is in the way of most of its headings that are
    proved infeasible.
    """
    x, y = found.corner_m
    nx, ny, _ = found.shape
    long = nx > LONG * ny
    room = ConstrainedLayoutEngine(rect=(0.0, 0.0, 0.95, 1.0))  # for the bars on the right
    figure = Figure(figsize=_TALL_IN if long else _SIZE_IN, dpi=100, layout=room)
    axes = figure.subplots(*((4, 1) if long else (2, 2)), sharex=True, sharey=True).ravel()
    half = 0.5 * found.spacing_m
    extent = (
        x - half,
        x + found.spacing_m * nx - half,
        y - half,
        y + found.spacing_m * ny - half,
    )
    rank = np.zeros(len(_BEST), dtype=int)
    rank[list(_BEST)] = np.arange(len(_BEST))
    best = np.array(_BEST)[rank[found.verdict].min(axis=2)]
    stands = np.isin(found.verdict, (FEASIBLE, LIKELY)).mean(axis=2)
    support_m = np.where(np.isnan(found.support_m), -np.inf, found.support_m).max(axis=2)
    support_m[np.isinf(support_m)] = np.nan
    axes[0].imshow(
        best.T,
        origin="lower",
        extent=extent,
        cmap=ListedColormap(_COLOURS),
        norm=Normalize(-0.5, len(_COLOURS) - 0.5),
        interpolation="nearest",
    )
    counts = found.counts()
    handles = [
        Swatch(color=colour, label=f"{name}: {counts[name]}")
        for name, colour in zip(VERDICTS, _COLOURS, strict=True)
        if counts[name]
    ]
    figure.legend(handles=handles, fontsize=8, loc="outside lower center", ncols=5, frameon=False)
    shown = axes[1].imshow(stands.T, origin="lower", extent=extent, cmap="viridis", vmin=0, vmax=1)
    _bar(figure, axes[1], shown)
    shown = axes[2].imshow(1e3 * support_m.T, origin="lower", extent=extent, cmap="YlGn", vmin=0)
    _bar(figure, axes[2], shown)
    _draw_limits(axes[3], found, extent)
    headings = len(found.headings_rad)
    titles = (
        f"best of {headings} headings (poses)",
        "share of headings, feasible or likely",
        "how far the body may move, at most [mm]",
        "in the way of most infeasible headings",
    )
    for each, title in zip(axes, titles, strict=True):
        each.set_title(title, fontsize=9, color=INK)
        each.set_xlabel("x [m]", fontsize=8)
        each.tick_params(labelsize=7)
        each.set_ylabel("y [m]", fontsize=8)
        each.label_outer()
    error = "" if found.error is None else f"; likely at an error of {100 * found.error:.3g} %"
    proved = found.shares()["proved"]
    figure.suptitle(
        f"{found.robot} on {found.terrain}, friction {found.friction:g}: {100 * proved:.0f} % "
        f"proved{error}",
        fontsize=10,
        color=INK,
    )
    return figure


def _draw_limits(axes: Axes, found: StandingMap, extent: tuple[float, float, float, float]) -> None:
    """Draw per place the limit that is in the way of most of its proved infeasible headings."""
    infeasible = found.verdict == INFEASIBLE
    counts = np.stack(
        [((found.limit == number) & infeasible).sum(axis=2) for number in range(len(LIMITS))]
    )
    most = np.where(infeasible.any(axis=2), counts.argmax(axis=0), -1)
    there = [number for number in range(len(LIMITS)) if (most == number).any()]
    order = np.full(len(LIMITS) + 1, 0)
    order[there] = np.arange(1, len(there) + 1)
    colours = [_COLOURS[UNKNOWN], *(_WAYS[number % len(_WAYS)] for number in there)]
    axes.imshow(
        order[most].T,
        origin="lower",
        extent=extent,
        cmap=ListedColormap(colours),
        norm=Normalize(-0.5, len(colours) - 0.5),
        interpolation="nearest",
    )
    names = ["none", *(LIMITS[number] or "not known" for number in there)]
    swatches = [Swatch(color=c, label=name) for c, name in zip(colours, names, strict=True)]
    axes.legend(handles=swatches, fontsize=7, loc="upper right", framealpha=0.9)


def _bar(figure: Figure, axes: Axes, image: AxesImage) -> None:
    """Draw the colours of an image beside its panel, as high as the panel."""
    bar = figure.colorbar(image, cax=axes.inset_axes((1.02, 0.0, 0.03, 1.0)))
    bar.ax.tick_params(labelsize=7)


_LINE = "#27407f"
_FACETS, _LINES, _POINTS = 80, 25, 121
"""Facets of the terrain a side; lines of the map a side; points on one."""


@DEFAULT_STYLE
def draw_map(
    warp: SplineMap,
    field: HeightField,
    report: MapReport,
    *,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a map: its ground grid on the terrain, a section through its middle, and the conformal
    error of its ground.

    Raises InvalidInput where the map was made for another terrain.
    """
    warp.check_fits(field)
    figure = sheet(size_px)
    words = (
        f"{report.method}, {' × '.join(map(str, report.cells))} cells, {report.cpu_s:.2f} CPU-s; "
        f"min det J {report.least_det:.2f}; match {1e3 * report.match_m[0]:.2f} mm at most; conformal "
        f"error at the ground {100.0 * float(report.ground_error.mean()):.0f} % on average"
    )
    headline(figure, caption or f"Warp map of {field.name or 'a terrain'}", words)
    height = figure.get_figheight()
    below = 0.36 * height
    scene = plain_axes(figure, 20.0, 100.0 * below, 90.0)
    _ground(warp, field).paint(scene)
    section = figure.add_axes((0.06, 0.09, 0.42, below / height - 0.14))
    _draw_section(section, warp)
    error = figure.add_axes((0.56, 0.09, 0.38, below / height - 0.14))
    _draw_error_map(figure, error, warp, report)
    return figure


def _ground(warp: SplineMap, field: HeightField) -> Still:
    """The terrain on its block, and the images of lines of constant x̄ and ȳ on it."""
    low, high = np.array(field.domain_m).T
    span = float(np.linalg.norm(high - low))
    sheets = block(field, low, high, facets=_FACETS, depth_m=0.08 * span, relief_m=0.0)
    points = sheets[0].points_m.reshape(-1, 3)
    camera = Camera(
        target_m=0.5 * (points.min(axis=0) + points.max(axis=0)),
        azimuth_rad=np.deg2rad(-60.0),
        elevation_rad=np.deg2rad(38.0),
        distance_m=2.2 * span,
    )
    lines, along = (
        [np.linspace(*span_m, count) for span_m in warp.domain_m] for count in (_LINES, _POINTS)
    )
    first = np.moveaxis(warp.ground_on_grid(lines[0], along[1]), 0, -1)
    second = np.moveaxis(warp.ground_on_grid(along[0], lines[1]), 0, -1).swapaxes(0, 1)
    pieces = np.concatenate([polyline(line) for line in (*first, *second)])
    path = Path(pieces_m=pieces, colour=_LINE, opacity=0.6, width=0.8, lift_m=1.5 * span / _FACETS)
    return Still(Scene(sheets=sheets, paths=[path]), camera)


def _draw_section(axes: Axes, warp: SplineMap) -> None:
    """Images of lines of constant x̄ and z̄ in the world's x and z, at the ȳ where the ground rises
    the most.
    """
    (x0, x1), (y0, y1) = warp.domain_m
    candidates = np.linspace(y0, y1, _POINTS)[_POINTS // 4 : -(_POINTS // 4)]
    rise = np.ptp(warp.ground_on_grid(np.linspace(x0, x1, _POINTS), candidates)[2], axis=0)
    near = np.abs(candidates - 0.5 * (y0 + y1)) / (y1 - y0)  # of equal ones the middle
    middle = candidates[[int(np.argmax(rise - 0.02 * rise.max() * near))]]
    upright = warp.on_grid(
        np.linspace(x0, x1, 2 * _LINES - 1), middle, np.linspace(0.0, warp.height_m, _POINTS)
    )[0]
    level = warp.on_grid(
        np.linspace(x0, x1, 4 * _POINTS), middle, np.linspace(0.0, warp.height_m, 13)
    )[0]
    axes.plot(upright[0, :, 0].T, upright[2, :, 0].T, color=_LINE, lw=0.6, alpha=0.6)
    axes.plot(level[0, :, 0], level[2, :, 0], color=_LINE, lw=0.6, alpha=0.6)
    x, heights = level[0, :, 0, 0], level[2, :, 0, 0]
    bottom = float(heights.min()) - 0.12 * warp.height_m
    axes.fill_between(x, heights, bottom, color=tuple(EARTH), lw=0)
    axes.plot(x, heights, color=INK, lw=1.6)
    axes.set(
        xlim=(x0, x1),
        ylim=(bottom, float(level[2].max()) + 0.05),
        aspect="equal",
        anchor="SW",
        xlabel="x [m]",
        ylabel="z [m]",
    )
    axes.set_title(
        f"section at ȳ = {middle[0]:.2g} m: lines of constant x̄ and z̄",
        size=11,
        color=INK,
        loc="left",
    )
    _quiet(axes, grid=None)


def _draw_error_map(figure: Figure, axes: Axes, warp: SplineMap, report: MapReport) -> None:
    """1 − σ_min/σ_max at the ground, over x̄ and ȳ."""
    (x0, x1), (y0, y1) = warp.domain_m
    error = 100.0 * report.ground_error
    most = max(1.0, float(np.quantile(error, 0.995)))
    image = axes.imshow(
        error.T, origin="lower", extent=(x0, x1, y0, y1), cmap="viridis", vmin=0.0, vmax=most
    )
    axes.set_title("conformal error at the ground [%]", size=11, color=INK, loc="left")
    axes.set(xlabel="x̄ [m]", anchor="SW")
    _quiet(axes, grid=None)
    _bar(figure, axes, image)


def _quiet(axes: Axes, *, grid: Literal["both"] | None = "both") -> None:
    quiet_axes(axes, grid=grid, sides=("bottom", "left"))
    axes.tick_params(which="both", labelsize=10, pad=3)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(size=10.5, color=QUIET)
