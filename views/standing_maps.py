"""Picture of where a robot can stand: a sheet of places, the best of their headings on the left, the
share of headings and the margin beside it.
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
    UNKNOWN,
    UNLIKELY,
    VERDICTS,
    StandingMap,
)

from .sheet import DEFAULT_STYLE, INK

COLOURS = ("#e4e7eb", "#2c8173", "#b8407a", "#a9d6c9", "#e6bcd3")
"""Of unknown, feasible, infeasible, likely feasible, likely infeasible."""
BEST = (FEASIBLE, LIKELY, UNKNOWN, UNLIKELY, INFEASIBLE)
"""From the best verdict to the worst."""
SIZE_IN = (12.0, 4.6)
TALL_IN = (8.0, 9.0)
LONG = 1.8
"""Length of a map over its width from which on its panels stand below each other."""


@DEFAULT_STYLE
def draw_standing_map(found: StandingMap) -> Figure:
    """The map: the best verdict over the headings of each place, the share of its headings in which
    the robot can stand, and the largest margin.
    """
    x, y = found.corner_m
    nx, ny, _ = found.shape
    long = nx > LONG * ny
    room = ConstrainedLayoutEngine(rect=(0.0, 0.0, 0.95, 1.0))  # for the bars on the right
    figure = Figure(figsize=TALL_IN if long else SIZE_IN, dpi=100, layout=room)
    axes = figure.subplots(*((3, 1) if long else (1, 3)), sharex=True, sharey=True)
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
    headings = len(found.headings_rad)
    titles = (
        f"best of {headings} headings (poses)",
        "share of headings, feasible or likely",
        "largest margin",
    )
    for each, title in zip(axes, titles, strict=True):
        each.set_title(title, fontsize=9, color=INK)
        each.set_xlabel("x [m]", fontsize=8)
        each.tick_params(labelsize=7)
        each.label_outer()
    axes[0].set_ylabel("y [m]", fontsize=8)
    error = "" if found.error is None else f"; likely at an error of {100 * found.error:.3g} %"
    proved = found.shares()["proved"]
    figure.suptitle(
        f"{found.robot} on {found.terrain}, friction {found.friction:g}: {100 * proved:.0f} % proved{error}",
        fontsize=10,
        color=INK,
    )
    return figure


def _bar(figure: Figure, axes: Axes, image: AxesImage) -> None:
    """Draw the colours of an image beside its panel, as high as the panel."""
    bar = figure.colorbar(image, cax=axes.inset_axes((1.02, 0.0, 0.03, 1.0)))
    bar.ax.tick_params(labelsize=7)
