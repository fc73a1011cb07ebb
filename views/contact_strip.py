"""The strip at the foot of a film: which feet stand when, and the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.trajectory import Trajectory

from .sheet import DEFAULT_STYLE, INK, QUIET, Size, leg_colour, quiet_axes, sheet, to_rgb

FILM_PX = (1280, 720)
MARGIN = 0.08
"""Left and right of the time axis, as a share of the width."""


@DEFAULT_STYLE
def draw_contacts(trajectory: Trajectory, size_px: Size, height: int) -> NDArray[np.uint8]:
    """A bar a foot where it stands, at the foot of every frame."""
    figure = sheet(size_px, FILM_PX)
    feet, share = trajectory.robot.feet, height / size_px[1]
    axes = figure.add_axes((MARGIN, 0.3 * share, 1.0 - 2.0 * MARGIN, 0.62 * share))
    times_s = trajectory.times_s - trajectory.times_s[0]
    for row in range(len(feet)):
        steps = np.diff(trajectory.contact[:, row].astype(int), prepend=0, append=0)
        begins, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
        spans = [
            (times_s[a], max(times_s[b] - times_s[a], 1e-9))
            for a, b in zip(begins, ends, strict=True)
        ]
        axes.broken_barh(spans, (row - 0.36, 0.72), color=leg_colour(row), lw=0)
    axes.set(xlim=(0.0, trajectory.duration_s), ylim=(len(feet) - 0.4, -0.6), facecolor="#eef1f4")
    quiet_axes(axes, grid=None, sides=())
    axes.set_yticks(range(len(feet)), [foot.name for foot in feet], size=10.5, color=INK)
    axes.tick_params(labelsize=10.5)
    axes.annotate(
        "s",
        (1.0, 0.0),
        (14, -4),
        "axes fraction",
        "offset points",
        size=10.5,
        color=QUIET,
        va="top",
    )
    return to_rgb(figure)[-height:]


def mark_time(pixels: NDArray[np.uint8], height: int, share: float) -> None:
    """A line across the strip at the share of the time that has passed."""
    rows, width = pixels.shape[:2]
    x = round((MARGIN + (1.0 - 2.0 * MARGIN) * share) * width)
    half = max(1, width // 900)
    top, bottom = rows - round(0.94 * height), rows - round(0.28 * height)
    pixels[top:bottom, max(0, x - half) : x + half] = (209, 35, 59)
