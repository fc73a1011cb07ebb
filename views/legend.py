"""The line at the foot of a picture: what is drawn, the scale of the forces, and the colours of
friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrow, Rectangle, Wedge

from .scene import Colour
from .sheet import ACCENT, INK, QUIET, plain_axes


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
