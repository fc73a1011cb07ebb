"""The strip below the picture of a posture: an envelope's bounds on [p, f], and where the posture
is in them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import Envelope

from .sheet import ACCENT, INK, QUIET, leg_colour, quiet_axes

COMPONENTS = ("$p_x$", "$p_y$", "$p_z$", "$f_n$", "$f_y$", "$f_z$")


def draw_strip(
    figure: Figure, legs: Sequence[str], envelope: Envelope, points: Array | None
) -> None:
    """One panel a limb, at the foot of the sheet: the bounds on each component as a bar and the
    answer as a dot.

    Arguments:
        points: the answer's [p, f], non-dimensional, shape (N, 6); None draws the bounds only.
    """
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    words = "Envelope: bounds on [p, f], non-dimensional" + (
        "" if points is None else "; the dot is this posture"
    )
    figure.text(30.0 / width, 238.0 / height, words, size=11, color=QUIET, va="center")
    shown = [envelope.low, envelope.high, *([] if points is None else [points])]
    reach = max(1.0, *(float(np.max(np.abs(values))) for values in shown))
    panel = (width - 90.0 + 18.0) / len(legs)
    for index, leg in enumerate(legs):
        axes = figure.add_axes(
            ((60.0 + panel * index) / width, 32.0 / height, (panel - 18.0) / width, 166.0 / height)
        )
        _frame_panel(axes, reach, named=index == 0)
        axes.set_title(
            leg,
            size=11.5,
            weight="bold",
            color=leg_colour(index),
            loc="left",
            pad=5,
            parse_math=False,
        )
        for row in range(6):
            low, high = float(envelope.low[index, row]), float(envelope.high[index, row])
            dot = None if points is None else float(points[index, row])
            _bound_bar(axes, row, low, high, dot, leg_colour(index))


def _frame_panel(axes: Axes, reach: float, *, named: bool) -> None:
    axes.set(xlim=(-1.06 * reach, 1.06 * reach), ylim=(5.75, -0.75), facecolor="#f6f7f9")
    axes.set_yticks(
        range(6), COMPONENTS if named else [""] * 6, size=12, color=INK, parse_math=True
    )
    ticks = (
        [-1.0, 0.0, 1.0] if reach < 1.5 else [-float(np.floor(reach)), 0.0, float(np.floor(reach))]
    )
    axes.set_xticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks], size=10, color=QUIET)
    quiet_axes(axes, grid="x", sides=())
    axes.axhspan(2.5, 5.75, color="#eceff3", lw=0, zorder=0)
    axes.axvline(0.0, color="#b9c1ca", lw=1.0, zorder=1)


def _bound_bar(
    axes: Axes, row: int, low: float, high: float, dot: float | None, colour: str
) -> None:
    axes.plot(
        [low, high], [row, row], color=colour, lw=7.5, alpha=0.32, solid_capstyle="butt", zorder=2
    )
    axes.vlines([low, high], row - 0.3, row + 0.3, color=colour, lw=1.4, zorder=3)
    if dot is not None:
        inside = low - 1e-6 <= dot <= high + 1e-6
        axes.plot(
            [dot], [row], "o", ms=6.5, mfc=INK if inside else ACCENT, mec="white", mew=0.9, zorder=4
        )
