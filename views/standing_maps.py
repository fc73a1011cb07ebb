"""Picture of where a robot can stand: the best of the headings of each place, the share of
headings, the margin, and the limit that is most often in the way.
"""

from __future__ import annotations

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

from .sheet import DEFAULT_STYLE, INK

COLOURS = ("#e4e7eb", "#2c8173", "#b8407a", "#a9d6c9", "#e6bcd3")
"""Colours of unknown, feasible, infeasible, likely feasible, likely infeasible."""
WAYS = ("#8a5a44", "#d1495b", "#edae49", "#00798c", "#30638e", "#6f5aa8", "#444b54")
"""Colours of limits, in their order."""
BEST = (FEASIBLE, LIKELY, UNKNOWN, UNLIKELY, INFEASIBLE)
"""From the best verdict to the worst."""
SIZE_IN = (9.0, 8.4)
TALL_IN = (8.0, 11.0)
LONG = 1.8
"""Length of a map over its width from which on its panels stand below each other."""


@DEFAULT_STYLE
def draw_standing_map(found: StandingMap) -> Figure:
    """The map: the best verdict over the headings of each place, the share of its headings in which
    the robot can stand, the largest margin, and what is in the way of most of its headings that are
    proved infeasible.
    """
    x, y = found.corner_m
    nx, ny, _ = found.shape
    long = nx > LONG * ny
    room = ConstrainedLayoutEngine(rect=(0.0, 0.0, 0.95, 1.0))  # for the bars on the right
    figure = Figure(figsize=TALL_IN if long else SIZE_IN, dpi=100, layout=room)
    axes = figure.subplots(*((4, 1) if long else (2, 2)), sharex=True, sharey=True).ravel()
    half = 0.5 * found.spacing_m
    extent = (
        x - half,
        x + found.spacing_m * nx - half,
        y - half,
        y + found.spacing_m * ny - half,
    )
    rank = np.zeros(len(BEST), dtype=int)
    rank[list(BEST)] = np.arange(len(BEST))
    best = np.array(BEST)[rank[found.verdict].min(axis=2)]
    stands = np.isin(found.verdict, (FEASIBLE, LIKELY)).mean(axis=2)
    margin = np.where(np.isnan(found.margin), -np.inf, found.margin).max(axis=2)
    margin[np.isinf(margin)] = np.nan
    axes[0].imshow(
        best.T,
        origin="lower",
        extent=extent,
        cmap=ListedColormap(COLOURS),
        norm=Normalize(-0.5, len(COLOURS) - 0.5),
        interpolation="nearest",
    )
    counts = found.counts()
    handles = [
        Swatch(color=colour, label=f"{name}: {counts[name]}")
        for name, colour in zip(VERDICTS, COLOURS, strict=True)
        if counts[name]
    ]
    figure.legend(handles=handles, fontsize=8, loc="outside lower center", ncols=5, frameon=False)
    shown = axes[1].imshow(stands.T, origin="lower", extent=extent, cmap="viridis", vmin=0, vmax=1)
    _bar(figure, axes[1], shown)
    largest = float(np.nanmax(np.abs(margin), initial=1e-3))
    wide = min(largest, 0.1)
    shown = axes[2].imshow(
        margin.T, origin="lower", extent=extent, cmap="RdYlGn", vmin=-wide, vmax=wide
    )
    _bar(figure, axes[2], shown)
    _draw_limits(axes[3], found, extent)
    headings = len(found.headings_rad)
    titles = (
        f"best of {headings} headings (poses)",
        "share of headings, feasible or likely",
        "largest margin",
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
    colours = [COLOURS[UNKNOWN], *(WAYS[number % len(WAYS)] for number in there)]
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
