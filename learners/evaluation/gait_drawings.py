"""The cells of ``gait_bench`` as pictures: violation and CPU time by walking direction (Pan et al.
Figs. 8 and 9), and violation by iteration.

Drawn are the paper's method, ours and the baseline, by the paper's quasi-Newton and by the exact
Hessian; a portfolio has phases, and is in the tables alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.terrain.reference import reference_tasks
from stancekit.views.gait_plot import GaitRun, draw_convergence, draw_directions, draw_times

from .gait_bench import METHODS
from .gait_figures import Row

DRAWN = ("ambient-lbfgs", "warped-lbfgs", "decoupled-lbfgs", "ambient", "warped", "decoupled")
COLOURED = tuple(METHODS[method].label for method in DRAWN)
"""A method has the same colour in every picture, whatever was measured."""
AROUND = ("ripple", "cone", "pit", "pit-84", "pit-87")
"""Terrains whose tasks go all around."""


def draw(rows: Iterable[Row], folder: Path) -> list[Path]:
    """Write convergence-TERRAIN.png, and directions- and times-TERRAIN.png where tasks go all
    around; what was written.

    Cells without a single iterate, e.g. for want of a map, are left out.
    """
    from stancekit.views.sheet import save

    every, written = (
        [row for row in rows if row["method"] in DRAWN and row.get("violations")],
        list[Path](),
    )
    for terrain in dict.fromkeys(row["terrain"] for row in every):
        rows_of_method = [
            row
            for method in DRAWN
            for row in every
            if (row["method"], row["terrain"]) == (method, terrain)
        ]
        for name, figure in _figures(terrain, rows_of_method):
            written.append(folder / f"{name}-{terrain}.png")
            save(figure, written[-1])
    return written


def _figures(terrain: str, rows: Sequence[Row]) -> Iterator[tuple[str, Any]]:
    seeds = sorted({row["seed"] for row in rows})
    runs = [_run(row) for row in rows]
    yield (
        "convergence",
        draw_convergence(runs, caption=f"Convergence on {terrain}", methods=COLOURED),
    )
    if terrain in AROUND:
        wedge = 2.0 * math.pi / len(reference_tasks(terrain)) / len(seeds)
        beside = [
            _run(row, wedge * (seeds.index(row["seed"]) - 0.5 * (len(seeds) - 1))) for row in rows
        ]
        guesses = (
            f"up to {len(seeds)} guesses a direction" if len(seeds) > 1 else "one guess a direction"
        )
        yield (
            "directions",
            draw_directions(
                beside, caption=f"Violation by walking direction on {terrain}, {guesses}"
            ),
        )
        caption = f"CPU time by walking direction on {terrain}, {guesses}"
        yield "times", draw_times(runs, caption=caption, methods=COLOURED)


def _run(row: Row, beside_rad: float = 0.0) -> GaitRun:
    task = reference_tasks(row["terrain"])[row["task"]]
    way = task.goal_xy_m - task.start_xy_m
    return GaitRun(
        method=METHODS[row["method"]].label,
        violations=np.array([math.inf if value is None else value for value in row["violations"]]),
        direction_rad=math.atan2(way[0], way[1]) + beside_rad,
        seconds=row["cpu_s"],
    )
