"""The flat parts of the pictures: sheet, title, legend, envelope strip and comparison chart, and how they are saved."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrow, Rectangle, Wedge
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, write_bytes
from stancekit.planners.relaxation.envelope import Envelope

Size = tuple[int, int]
SIZE_PX, CHART_PX = (1200, 900), (1200, 640)
DEFAULT_STYLE = style.context(["default", {"text.parse_math": False}])
"""Decorator: matplotlib's own settings for one call, so that a user's matplotlibrc changes no picture."""
INK, QUIET, RULE, ACCENT = "#1f2933", "#66717e", "#d5dae0", "#d1233b"
LEG_COLOURS = ("#0b7285", "#d9730d", "#7048a8", "#3f8f3a", "#b8407a", "#4a6fd0", "#8c6d31", "#5b6770")
"""Colours of the limbs, in the order of the contacts; they repeat after the eighth."""
MEASURE_COLOURS = ("#27407f", "#e08a2b", "#8fc7b5", "#58a695", "#2c8173", "#125a50", "#9a86c4", "#c9a227")
COMPONENTS = ("$p_x$", "$p_y$", "$p_z$", "$f_n$", "$f_y$", "$f_z$")
NO_XML = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
"""Letters that names may have, and XML may not."""
UNDATED: Mapping[str, dict[str, None]] = {".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


@dataclass(frozen=True, kw_only=True)
class ComparisonBar:
    """One row of a comparison table.

    values: measure → share of problems in [0, 1], e.g. "P1 correct feasible", "fix-p". A measure that a selector does
    not have is left out. paper: what the paper printed for the same measures, where it did.
    """

    selector: str
    values: Mapping[str, float]
    paper: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, values in (("values", self.values), ("paper", self.paper)):
            for measure, value in values.items():
                if not 0.0 <= value <= 1.0:
                    where = f"{self.selector}: {name}[{measure!r}]"
                    raise InvalidInput(f"{where}: expected a share in [0, 1], got {value:g}")


def sheet(size_px: Size, usual_px: Size = SIZE_PX) -> Figure:
    """An empty white figure of this many pixels; its text is as large as in one of the usual size, scaled to fit.

    Raises InvalidInput below 300 pixels.
    """
    width, height = size_px
    if min(width, height) < 300:
        raise InvalidInput(f"size_px: expected at least 300 by 300 pixels, got {width} by {height}")
    dpi = 100.0 * min(width / usual_px[0], height / usual_px[1])
    figure = Figure(figsize=((width + 1e-6) / dpi, (height + 1e-6) / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def plain_axes(figure: Figure, side: float, bottom: float, top: float) -> Axes:
    """Axes without frame or ticks, so far from the figure's sides, bottom and top, in hundredths of an inch."""
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    axes = figure.add_axes((side / width, bottom / height, 1.0 - 2.0 * side / width, 1.0 - (bottom + top) / height))
    axes.set_axis_off()
    return axes


def friction_colours(friction: Sequence[float]) -> ScalarMappable:
    """Colours of friction coefficients: from 0 to 1.2, or as far as they go."""
    return ScalarMappable(Normalize(0.0, max(1.2, *friction)), "viridis")


def draw_legend(
    figure: Figure, bottom: float, friction: ScalarMappable, *, arrow: tuple[float, str] | None, boxes: bool
) -> None:
    """One line below the scene: what is drawn, the scale of the forces, and the colours of friction.

    arrow: its length in hundredths of an inch and its label; None without forces.
    """
    width = 100.0 * figure.get_figwidth()
    axes = plain_axes(figure, 0.0, bottom, 100.0 * figure.get_figheight() - bottom - 50.0)
    axes.set(xlim=(0.0, width), ylim=(0.0, 50.0))
    x = 30.0

    def words(text: str) -> None:
        nonlocal x
        axes.text(x, 25.0, text, size=10.5, color=INK, va="center_baseline", parse_math=True)
        x += 7.9 * len(text) + 22.0

    if arrow is not None:
        length, text = arrow
        shaft = length - 15.0
        axes.add_patch(FancyArrow(x, 25.0, shaft, 0.0, width=4.5, head_width=14.0, head_length=15.0, fc=ACCENT, lw=0))
        x += length + 10.0
        words(text)
        axes.fill([x, x + 26.0, x + 26.0], [25.0, 37.0, 13.0], color=ACCENT, alpha=0.12, lw=0)
        axes.plot([x + 26.0, x, x + 26.0], [37.0, 25.0, 13.0], color=ACCENT, alpha=0.4, lw=0.9)
        axes.add_patch(Ellipse((x + 26.0, 25.0), 9.0, 24.0, fc=to_rgba(ACCENT, 0.15), ec=to_rgba(ACCENT, 0.6), lw=0.9))
        x += 40.0
        words("friction cone")
    mark_com(axes, (x + 12.0, 25.0), 6.5)
    axes.add_patch(Circle((x + 12.0, 25.0), 12.0, fill=False, ec=INK, lw=1.0, ls=(0, (3, 2))))
    x += 32.0
    words("centre of mass, allowed ball")
    if boxes:
        axes.add_patch(Rectangle((x, 16.0), 18.0, 18.0, fc=to_rgba(LEG_COLOURS[0], 0.1), ec=LEG_COLOURS[0], lw=1.3))
        x += 27.0
        words("envelope on $p$")
    friction_bar(figure, width, bottom, friction)


def friction_bar(figure: Figure, width: float, bottom: float, friction: ScalarMappable) -> None:
    """The scale of colours that stand for friction, at the right of the legend; width and bottom in pixels."""
    height = 100.0 * figure.get_figheight()
    axes = figure.add_axes(((width - 210.0) / width, (bottom + 22.0) / height, 180.0 / width, 12.0 / height))
    bar = figure.colorbar(friction, cax=axes, orientation="horizontal")
    ends = float(np.max(friction.get_clim()))
    bar.set_ticks([0.0, 0.5 * ends, ends], labels=["0", f"{0.5 * ends:.2g}", f"{ends:.2g}"])
    bar.outline.set_visible(False)
    axes.tick_params(length=0, pad=3, labelsize=10, labelcolor=QUIET)
    axes.text(-0.05, 0.5, "friction μ", size=10.5, color=INK, ha="right", va="center", transform=axes.transAxes)


def mark_com(axes: Axes, at: tuple[float, float], radius: float) -> None:
    """The sign of a centre of mass."""
    axes.add_patch(Circle(at, radius, fc="white", ec=INK, lw=1.3, zorder=6))
    for start in (0.0, 180.0):
        axes.add_patch(Wedge(at, radius, start, start + 90.0, fc=INK, lw=0, zorder=7))


def headline(figure: Figure, title: str, subtitle: str, *, alarm: bool = False) -> None:
    """Title and a quiet line below it, at the top left; a long title is set smaller."""
    inches, room = figure.get_figheight(), 95.0 * figure.get_figwidth() / 12.0  # room: characters that fit at 16 points
    size = 16.0 * min(1.0, room / max(len(title), 1))
    figure.text(0.025, 1.0 - 0.36 / inches, title, size=size, weight="bold", color=INK, va="center", parse_math=False)
    size = 11.5 * min(1.0, 1.45 * room / max(len(subtitle), 1))
    figure.text(0.025, 1.0 - 0.66 / inches, subtitle, size=size, color=ACCENT if alarm else QUIET, va="center")


def draw_strip(figure: Figure, legs: Sequence[str], envelope: Envelope, points: Array | None) -> None:
    """One panel a limb, at the foot of the sheet: the bounds on each component as a bar and the answer as a dot.

    points: the answer's [p, f], non-dimensional, shape (N, 6); None draws the bounds only.
    """
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    words = "Envelope: bounds on [p, f], non-dimensional" + ("" if points is None else "; the dot is this posture")
    figure.text(30.0 / width, 238.0 / height, words, size=11, color=QUIET, va="center")
    shown = [envelope.low, envelope.high, *([] if points is None else [points])]
    reach = max(1.0, *(float(np.max(np.abs(values))) for values in shown))
    panel = (width - 90.0 + 18.0) / len(legs)
    for index, leg in enumerate(legs):
        axes = figure.add_axes(((60.0 + panel * index) / width, 32.0 / height, (panel - 18.0) / width, 166.0 / height))
        _frame_panel(axes, reach, named=index == 0)
        axes.set_title(leg, size=11.5, weight="bold", color=leg_colour(index), loc="left", pad=5, parse_math=False)
        for row in range(6):
            low, high = float(envelope.low[index, row]), float(envelope.high[index, row])
            dot = None if points is None else float(points[index, row])
            _bound_bar(axes, row, low, high, dot, leg_colour(index))


def leg_colour(index: int) -> str:
    """Colour of the limb at this contact."""
    return LEG_COLOURS[index % len(LEG_COLOURS)]


def _frame_panel(axes: Axes, reach: float, *, named: bool) -> None:
    axes.set(xlim=(-1.06 * reach, 1.06 * reach), ylim=(5.75, -0.75), facecolor="#f6f7f9")
    axes.set_yticks(range(6), COMPONENTS if named else [""] * 6, size=12, color=INK, parse_math=True)
    ticks = [-1.0, 0.0, 1.0] if reach < 1.5 else [-float(np.floor(reach)), 0.0, float(np.floor(reach))]
    axes.set_xticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks], size=10, color=QUIET)
    axes.tick_params(length=0, pad=4)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.axhspan(2.5, 5.75, color="#eceff3", lw=0, zorder=0)
    axes.axvline(0.0, color="#b9c1ca", lw=1.0, zorder=1)
    axes.grid(axis="x", color=RULE, lw=0.8)


def _bound_bar(axes: Axes, row: int, low: float, high: float, dot: float | None, colour: str) -> None:
    axes.plot([low, high], [row, row], color=colour, lw=7.5, alpha=0.32, solid_capstyle="butt", zorder=2)
    axes.vlines([low, high], row - 0.3, row + 0.3, color=colour, lw=1.4, zorder=3)
    if dot is not None:
        inside = low - 1e-6 <= dot <= high + 1e-6
        axes.plot([dot], [row], "o", ms=6.5, mfc=INK if inside else ACCENT, mec="white", mew=0.9, zorder=4)


@DEFAULT_STYLE
def draw_comparison(rows: Sequence[ComparisonBar], *, caption: str = "", size_px: Size = CHART_PX) -> Figure:
    """Grouped bars: a group a selector, a bar a measure, in percent; hollow diamonds are the paper's values.

    Measures come in the order in which the rows name them. Raises InvalidInput without rows or values.
    """
    measures = list(dict.fromkeys(measure for row in rows for measure in (*row.values, *row.paper)))
    if not measures:
        raise InvalidInput("rows: expected one or more rows with values, got none")
    figure = sheet(size_px, CHART_PX)
    high = figure.get_figheight()
    headline(figure, caption or "Selectors compared", "% of problems")
    axes = figure.add_axes((0.055, 0.62 / high, 0.925, 1.0 - 2.15 / high))
    _frame_chart(axes, [row.selector for row in rows])
    width = 0.84 / len(measures)
    room = 92.5 * figure.get_figwidth() * width / len(rows)  # width of a bar, in hundredths of an inch
    for position, measure in enumerate(measures):
        colour = MEASURE_COLOURS[position % len(MEASURE_COLOURS)]
        at = np.arange(len(rows)) - 0.42 + width * (position + 0.5)
        for x, row in zip(at, rows, strict=True):
            _bar(axes, float(x), width, row, measure, colour, room)
        axes.bar([-9.0], [0.0], color=colour, label=measure)
    if any(row.paper for row in rows):
        axes.plot([-9.0], [0.0], "D", ms=6, mfc="white", mec=INK, mew=1.2, label="paper", ls="none")
    _name_measures(axes)
    return figure


def _name_measures(axes: Axes) -> None:
    """The legend above the chart, in one line or two, the paper's diamond last."""
    handles, names = axes.get_legend_handles_labels()
    pairs = sorted(zip(handles, names, strict=True), key=lambda pair: pair[1] == "paper")
    lines = 1 if sum(len(name) + 5 for name in names) < 125 else 2
    axes.legend(
        *zip(*pairs, strict=True), ncols=-(-len(names) // lines), loc="lower left", bbox_to_anchor=(-0.005, 1.02),
        frameon=False, fontsize=11, labelcolor=INK, handlelength=1.0, handleheight=1.0, columnspacing=1.5,
        handletextpad=0.5, borderpad=0.0,
    )  # fmt: skip


def _frame_chart(axes: Axes, selectors: Sequence[str]) -> None:
    axes.set(xlim=(-0.52, len(selectors) - 0.48), ylim=(0.0, 104.0))
    axes.set_xticks(range(len(selectors)), selectors, size=12.5, color=INK, parse_math=False)
    axes.set_yticks(range(0, 101, 20), [str(tick) for tick in range(0, 101, 20)], size=11, color=QUIET)
    axes.tick_params(length=0, pad=7)
    axes.grid(axis="y", color=RULE, lw=0.8)
    axes.set_axisbelow(True)
    for name, side in axes.spines.items():
        side.set_visible(name == "bottom")
        side.set_color("#9aa5b1")


def _bar(axes: Axes, x: float, width: float, row: ComparisonBar, measure: str, colour: str, room: float) -> None:
    value, paper = row.values.get(measure), row.paper.get(measure)
    if value is None:
        axes.text(x, 0.8, "–", size=11, color=QUIET, ha="center", va="bottom")
    else:
        axes.bar([x], [100.0 * value], 0.9 * width, color=colour, lw=0, zorder=2)
        if room >= 13.0:
            _bar_number(axes, x, 100.0 * value, colour, room)
    if paper is not None:
        axes.plot([x], [100.0 * paper], "D", ms=6, mfc="white", mec=INK, mew=1.2, zorder=4, clip_on=False)


def _bar_number(axes: Axes, x: float, percent: float, colour: str, room: float) -> None:
    """The number at the foot of its bar, where no marker hides it, or above a short bar; upright in a narrow one."""
    dark = float(np.dot(to_rgba(colour)[:3], (0.299, 0.587, 0.114))) < 0.6
    tall = percent > 12.0
    axes.text(
        x, 1.8 if tall else percent + 1.2, f"{percent:.1f}", size=min(11.5, 0.5 * room), ha="center", va="bottom",
        rotation=0 if room > 42.0 else 90, color="white" if tall and dark else INK, zorder=3,
    )  # fmt: skip


@DEFAULT_STYLE
def to_rgb(figure: Figure) -> NDArray[np.uint8]:
    """The figure's pixels, shape (H, W, 3)."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="rgba", dpi=figure.dpi)
    width, height = int(figure.bbox.width), int(figure.bbox.height)
    return np.frombuffer(drawn.getvalue(), dtype=np.uint8).reshape(height, width, 4)[..., :3].copy()


@DEFAULT_STYLE
def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write the figure as .png, .pdf or .svg, whole or not at all; equal figures give equal files.

    Raises InvalidInput for another suffix and for a folder that is not there.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in UNDATED:
        raise InvalidInput(f"{target}: expected a name that ends in {', '.join(UNDATED)}, got {suffix or 'no suffix'}")
    check_writable(target)
    drawn = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "stancekit"}):
        figure.savefig(drawn, format=suffix[1:], dpi=figure.dpi, metadata=UNDATED[suffix])
    content = drawn.getvalue()
    write_bytes(target, NO_XML.sub(b"?", content) if suffix == ".svg" else content)
