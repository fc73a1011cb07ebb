"""The optimisation program of a gait: a short list of constraints, written for a chart of the space
(W1 in ambient coordinates, W7 in warped ones).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..problem.walk import Walk
from ..warp.conformal import flatten
from ..warp.spline_map import SplineMap
from .charts import CHARTS
from .charts.warped import Shear
from .constraints.cone import cone
from .constraints.contact import contact
from .constraints.durations import durations
from .constraints.dynamics import dynamics
from .constraints.ends import goal, heading_end, poised, start, still_end, still_start
from .constraints.footing import SHARE, footing, slope_about
from .constraints.reach import reach
from .constraints.swing import swing
from .constraints.trunk import trunk
from .gait_program import GaitProgram
from .method.guess import GuessedWalk
from .task import GaitSettings
from .transcription.blocks import Constraint
from .variables.structure import Structure


def terms(structure: Structure) -> list[Constraint]:
    """All constraints, in the order in which violations are reported (W1, W7)."""
    every = [
        dynamics(structure),
        contact(structure),
        cone(structure),
        footing(structure),
        reach(structure),
        *swing(structure),
        trunk(structure),
        still_start(structure),
        *start(structure),
        goal(structure),
        heading_end(structure),
        still_end(structure),
        poised(structure),
        durations(structure),
    ]
    return [term for term in every if term is not None]


def formulate(
    task: Walk,
    settings: GaitSettings | None = None,
    warp: SplineMap | Callable[[], SplineMap] | None = None,
) -> GaitProgram:
    """Write a task down as a program (W1 in the ambient chart, W7 in a warped one).

    >>> plan = formulate(task, GaitSettings(chart="shear")).solve()  # doctest: +SKIP

    Arguments:
        warp: the terrain's map for charts that need it, or what gives it; made by
            ``warp.conformal.flatten`` if missing.

    Raises:
        InvalidInput: for settings that do not fit the task and for a map of another terrain, and
            PlanningFailed where no map of the terrain can be made.
    """
    settings = sure(task, settings or GaitSettings())

    def flattened() -> SplineMap:
        if warp is None:
            return flatten(task.terrain)
        return warp if isinstance(warp, SplineMap) else warp()

    chart = CHARTS.get(settings.chart).of(
        task.terrain, smoothing_m=settings.smoothing_m, flattened=flattened
    )
    structure = Structure(task, settings, chart)
    return GaitProgram(task, settings, structure, terms(structure))


def sure(task: Walk, settings: GaitSettings) -> GaitSettings:
    """The settings with a share in ``footing``, where they leave that to the task.

    ``SHARE`` where feet that do not stick have sure footing near every place where a straight walk
    would put them, and not all ground is gentle anyway; else 0. Robots that stand on two feet at a
    time and put them on edges fall in simulations of others. Where a hill is as steep as friction
    holds there is nothing else to stand on, and walks are planned as the paper has them.
    """
    if settings.footing is not None:
        return settings
    limit = SHARE * task.friction
    if task.terrain.steepest <= limit or all(task.adhesive):
        return replace(settings, footing=0.0)
    surer = replace(settings, footing=SHARE)
    walk = GuessedWalk(Structure(task, surer, Shear(task.terrain)))
    feet = [walk.footholds(foot)[:, :2] for foot, sticks in enumerate(task.adhesive) if not sticks]
    has = slope_about(task.terrain, np.concatenate(feet)).max() <= limit
    return surer if has else replace(settings, footing=0.0)
