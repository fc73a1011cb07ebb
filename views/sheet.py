"""The paper of pictures and plots: sheet, title, axes and colours, and how a figure is saved."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Literal

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.writing import check_writable, write_bytes

Size = tuple[int, int]
SIZE_PX, PLOT_PX = (1200, 900), (1200, 640)
DEFAULT_STYLE = style.context(["default", {"text.parse_math": False}])
"""Decorator: matplotlib's own settings for one call, so that a user's matplotlibrc changes no
picture."""
INK, QUIET, RULE, ACCENT, GUIDE = "#1f2933", "#66717e", "#d5dae0", "#d1233b", "#3f6fb5"
GOAL, REAL = "#e8a317", "#c2410c"
"""Colours of the goal, and of the path of the robot in a world."""
LEG_COLOURS = (
    "#0b7285",
    "#d9730d",
    "#7048a8",
    "#3f8f3a",
    "#b8407a",
    "#4a6fd0",
    "#8c6d31",
    "#5b6770",
)
"""Colours of the limbs, in the order of the contacts; they repeat after the eighth."""
MEASURE_COLOURS = (
    "#27407f",
    "#e08a2b",
    "#8fc7b5",
    "#58a695",
    "#2c8173",
    "#125a50",
    "#9a86c4",
)
_NO_XML = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
"""Letters that names may have, and XML may not."""
_UNDATED: Mapping[str, dict[str, None]] = {
    ".png": {},
    ".pdf": {"CreationDate": None},
    ".svg": dict.fromkeys(("Date", "Creator", "Format", "Type")),
}


def sheet(size_px: Size, usual_px: Size = SIZE_PX) -> Figure:
    """An empty white figure of this many pixels; its text is as large as in one of the usual size,
    scaled to fit.

    Raises InvalidInput below 300 pixels.
    """
    width, height = size_px
    if min(width, height) < 300:
        raise InvalidInput(f"size_px: expected at least 300 by 300 pixels, got {width} by {height}")
    dpi = 100.0 * min(width / usual_px[0], height / usual_px[1])
    figure = Figure(
        figsize=((width + 1e-6) / dpi, (height + 1e-6) / dpi), dpi=dpi, facecolor="white"
    )
    FigureCanvasAgg(figure)
    return figure


def plain_axes(figure: Figure, side: float, bottom: float, top: float) -> Axes:
    """Axes without frame or ticks, so far from the figure's sides, bottom and top, in hundredths of
    an inch.
    """
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    axes = figure.add_axes(
        (side / width, bottom / height, 1.0 - 2.0 * side / width, 1.0 - (bottom + top) / height)
    )
    axes.set_axis_off()
    return axes


def friction_colours(friction: Sequence[float]) -> ScalarMappable:
    """Colours of friction coefficients: from 0 to 1.2, or as far as they go."""
    return ScalarMappable(Normalize(0.0, max(1.2, *friction)), "viridis")


def headline(figure: Figure, title: str, subtitle: str, *, alarm: bool = False) -> None:
    """Title and a quiet line below it, at the top left; a long title is set smaller."""
    inches, room = (
        figure.get_figheight(),
        95.0 * figure.get_figwidth() / 12.0,
    )  # room: characters that fit at 16 points
    size = 16.0 * min(1.0, room / max(len(title), 1))
    figure.text(
        0.025,
        1.0 - 0.36 / inches,
        title,
        size=size,
        weight="bold",
        color=INK,
        va="center",
        parse_math=False,
    )
    longest = max(map(len, subtitle.splitlines()), default=1)
    size = 11.5 * min(1.0, 1.45 * room / longest)
    figure.text(
        0.025,
        1.0 - 0.57 / inches,
        subtitle,
        size=size,
        color=ACCENT if alarm else QUIET,
        va="top",
    )


def wrapped(words: str) -> str:
    """Words for the line below a title, in two lines where they are too long for one."""
    return fill(words, 140 if len(words) <= 140 else len(words) // 2 + 12)


def leg_colour(index: int) -> str:
    """Colour of the limb at this contact."""
    return LEG_COLOURS[index % len(LEG_COLOURS)]


def quiet_axes(
    axes: Axes, *, grid: Literal["both", "x", "y"] | None = "y", sides: Sequence[str] = ("bottom",)
) -> None:
    """Axes with pale lines, no ticks, and of their frame only these sides."""
    axes.tick_params(which="both", length=0, pad=6, labelcolor=QUIET)
    if grid is not None:
        axes.grid(axis=grid, color=RULE, lw=0.8)
        axes.set_axisbelow(True)
    for name, side in axes.spines.items():
        side.set_visible(name in sides)
        side.set_color("#9aa5b1")


@DEFAULT_STYLE
def to_rgb(figure: Figure) -> NDArray[np.uint8]:
    """The figure's pixels, shape (H, W, 3)."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba", dpi=figure.dpi)
    width, height = int(figure.bbox.width), int(figure.bbox.height)
    return (
        np.frombuffer(buffer.getvalue(), dtype=np.uint8).reshape(height, width, 4)[..., :3].copy()
    )


def check_picture(path: str | os.PathLike[str]) -> Path:
    """The file behind the name of a picture, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end as pictures do, and where nothing can be
    written.
    """
    target = Path(path)
    if target.suffix.lower() not in _UNDATED:
        ends = ", ".join(_UNDATED)
        raise InvalidInput(
            f"{path}: expected a name that ends in {ends}, got "
            f"{target.suffix.lower() or 'no suffix'}"
        )
    return check_writable(target)


@DEFAULT_STYLE
def encoded(figure: Figure, suffix: str) -> bytes:
    """The figure as a file of this suffix has it; equal figures give equal bytes."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "stancekit"}):
        figure.savefig(buffer, format=suffix[1:], dpi=figure.dpi, metadata=_UNDATED[suffix])
    return _NO_XML.sub(b"?", buffer.getvalue()) if suffix == ".svg" else buffer.getvalue()


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write the figure as .png, .pdf or .svg, whole or not at all; equal figures give equal files.

    Raises InvalidInput for another suffix and for a folder that is not there.
    """
    target = check_picture(path)
    write_bytes(target, encoded(figure, target.suffix.lower()))
