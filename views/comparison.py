"""The plot that compares selectors: grouped bars, and what the paper printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from stancekit.planners.errors import InvalidInput

from .sheet import (
    DEFAULT_STYLE,
    INK,
    MEASURE_COLOURS,
    PLOT_PX,
    QUIET,
    Size,
    headline,
    quiet_axes,
    sheet,
)


@dataclass(frozen=True, kw_only=True)
class ComparisonBar:
    """One row of a comparison table.

    Arguments:
        values: measure → share of problems in [0, 1], e.g. "P1 correct feasible", "fix-p". A
            measure that a selector does not have is left out.
        paper: what the paper printed for the same measures, where it did.
        intervals: ends of the interval of each value, where they are known.
    """

    selector: str
    values: Mapping[str, float]
    paper: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@DEFAULT_STYLE
def draw_comparison(
    rows: Sequence[ComparisonBar], *, caption: str = "", size_px: Size = PLOT_PX
) -> Figure:
    """Grouped bars: a group a selector, a bar a measure, in percent; hollow diamonds are the
    paper's values.

    Measures come in the order in which the rows name them. Raises InvalidInput without rows or
    values.
    """
    measures = list(dict.fromkeys(measure for row in rows for measure in (*row.values, *row.paper)))
    if not measures:
        raise InvalidInput("rows: expected one or more rows with values, got none")
    figure = sheet(size_px, PLOT_PX)
    high = figure.get_figheight()
    headline(figure, caption or "Selectors compared", "% of problems; the lines are 95 % intervals")
    axes = figure.add_axes((0.055, 0.62 / high, 0.925, 1.0 - 2.15 / high))
    axes.set(xlim=(-0.52, len(rows) - 0.48), ylim=(0.0, 104.0))
    names = [row.selector for row in rows]
    axes.set_xticks(range(len(rows)), names, size=12.5, color=INK, parse_math=False)
    axes.set_yticks(range(0, 101, 20), [str(tick) for tick in range(0, 101, 20)], size=11)
    quiet_axes(axes)
    width = 0.84 / len(measures)
    room = (
        92.5 * figure.get_figwidth() * width / len(rows)
    )  # width of a bar, in hundredths of an inch
    for position, measure in enumerate(measures):
        turns, place = divmod(position, len(MEASURE_COLOURS))
        colour, hatch = MEASURE_COLOURS[place], "//" * turns
        at = np.arange(len(rows)) - 0.42 + width * (position + 0.5)
        for x, row in zip(at, rows, strict=True):
            _bar(axes, float(x), width, row, measure, (colour, hatch), room)
        axes.bar([-9.0], [0.0], color=colour, hatch=hatch, ec="white", lw=0, label=measure)
    if any(row.paper for row in rows):
        axes.plot([-9.0], [0.0], "D", ms=6, mfc="white", mec=INK, mew=1.2, label="paper", ls="none")
    _name_measures(axes)
    return figure


def _name_measures(axes: Axes) -> None:
    """The legend above the plot, in one line or two, the paper's diamond last."""
    handles, names = axes.get_legend_handles_labels()
    pairs = sorted(zip(handles, names, strict=True), key=lambda pair: pair[1] == "paper")
    lines = 1 if sum(len(name) + 5 for name in names) < 125 else 2
    axes.legend(
        *zip(*pairs, strict=True),
        ncols=-(-len(names) // lines),
        loc="lower left",
        bbox_to_anchor=(-0.005, 1.02),
        frameon=False,
        fontsize=11,
        labelcolor=INK,
        handlelength=1.0,
        handleheight=1.0,
        columnspacing=1.5,
        handletextpad=0.5,
        borderpad=0.0,
    )


def _bar(
    axes: Axes,
    x: float,
    width: float,
    row: ComparisonBar,
    measure: str,
    look: tuple[str, str],
    room: float,
) -> None:
    value, paper, (colour, hatch) = row.values.get(measure), row.paper.get(measure), look
    if value is None:
        axes.text(x, 0.8, "–", size=11, color=QUIET, ha="center", va="bottom")
    else:
        height, ends = 100.0 * value, [100.0 * end for end in row.intervals.get(measure, ())]
        axes.bar([x], [height], 0.9 * width, color=colour, hatch=hatch, ec="white", lw=0, zorder=2)
        halo = [withStroke(linewidth=3.2, foreground="white")]
        axes.plot([x] * len(ends), ends, color=INK, lw=1.4, zorder=4, path_effects=halo)
        if room >= 13.0:
            _bar_number(axes, x, height, max([height, *ends]), colour, room)
    if paper is not None:
        axes.plot(
            [x], [100.0 * paper], "D", ms=6, mfc="white", mec=INK, mew=1.2, zorder=4, clip_on=False
        )


def _bar_number(axes: Axes, x: float, percent: float, top: float, colour: str, room: float) -> None:
    """The number at the foot of its bar, where no marker hides it, or above a short bar and its
    interval; upright in a narrow one.
    """
    dark = float(np.dot(to_rgba(colour)[:3], (0.299, 0.587, 0.114))) < 0.6
    tall = percent > 12.0
    axes.text(
        x,
        1.8 if tall else top + 1.2,
        f"{percent:.1f}",
        size=min(11.5, 0.5 * room),
        ha="center",
        va="bottom",
        rotation=0 if room > 42.0 else 90,
        color="white" if tall and dark else INK,
        zorder=5,
        path_effects=[withStroke(linewidth=2.5, foreground=colour if tall else "white")],
    )
