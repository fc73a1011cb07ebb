"""Difficulty curves of terrain families: by level, the share of scenes with a plan, and with a
proof of none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stancekit.planners.errors import InvalidInput

from .sheet import ACCENT, DEFAULT_STYLE, INK, QUIET, SIZE_PX, Size, headline, quiet_axes, sheet

COLUMNS = 4
PLANNED, NONE = "#2c8173", ACCENT


@DEFAULT_STYLE
def difficulty_curves(rows: Sequence[Mapping[str, Any]], size_px: Size = SIZE_PX) -> Figure:
    """A panel a family.

    Arguments:
        rows: each with family, level, scenes, planned, proved_none, undecided and half_width,
            shares of 1; the band is the half-width.

    Raises:
        InvalidInput: without any.
    """
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    if not families:
        raise InvalidInput("rows: expected one or more levels of a family, got none")
    figure = sheet(size_px)
    scenes = [row["scenes"] for row in rows]
    worst = max(row["undecided"] for row in rows)
    headline(
        figure,
        "How hard is a level?",
        f"{min(scenes)} to {max(scenes)} scenes a level; at most {100.0 * worst:.1f} % of a "
        "level's undecided",
    )
    grid = figure.add_gridspec(
        -(-len(families) // COLUMNS),
        COLUMNS,
        left=0.06,
        right=0.98,
        bottom=0.07,
        top=0.84,
        hspace=0.35,
        wspace=0.25,
    )
    for k, family in enumerate(families):
        axes = figure.add_subplot(grid[divmod(k, COLUMNS)])
        quiet_axes(axes)
        mine = sorted(
            (row for row in rows if row["family"] == family), key=lambda row: float(row["level"])
        )
        level = np.array([row["level"] for row in mine])
        half = np.array([row["half_width"] for row in mine])
        for name, colour in (("planned", PLANNED), ("proved_none", NONE)):
            share = np.array([row[name] for row in mine])
            low, high = np.clip(share - half, 0.0, 1.0), np.clip(share + half, 0.0, 1.0)
            axes.fill_between(level, 100.0 * low, 100.0 * high, color=colour, alpha=0.2, lw=0)
            axes.plot(level, 100.0 * share, color=colour, lw=2.0, marker="o", ms=3.5, label=name)
        axes.set(xlim=(-0.02, 1.02), ylim=(-2.0, 102.0))
        axes.set_title(family, loc="left", size=12, color=INK, weight="bold")
        axes.set_xlabel("level", color=QUIET)
        if k % COLUMNS == 0:
            axes.set_ylabel("% of scenes", color=QUIET)
    height = figure.get_figheight()
    figure.text(
        0.72, 1.0 - 0.36 / height, "● a verified plan", color=PLANNED, va="center", weight="bold"
    )
    figure.text(0.72, 1.0 - 0.66 / height, "● proved: none", color=NONE, va="center", weight="bold")
    return figure
