"""The gait program of a task: a short list of terms over a chart (W1 in ambient, W7 in warped coordinates)."""

from __future__ import annotations

from collections.abc import Callable

from ..problem.walk import Walk
from ..warp.conformal import flatten
from ..warp.spline_map import SplineMap
from .charts import CHARTS
from .constraints.cone import cone
from .constraints.contact import contact
from .constraints.durations import durations
from .constraints.dynamics import dynamics
from .constraints.ends import goal, heading_end, poised, start, still_end, still_start
from .constraints.footing import footing
from .constraints.reach import reach
from .constraints.swing import swing
from .constraints.trunk import trunk
from .gait_program import GaitProgram
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

    warp: the terrain's map for charts that need it, or what gives it; made by ``warp.conformal.flatten`` if missing.
    Raises InvalidInput for settings that do not fit the task and for a map of another terrain, and PlanningFailed where
    no map of the terrain can be made.

    >>> plan = formulate(task, GaitSettings(chart="shear")).solve()  # doctest: +SKIP
    """
    settings = settings or GaitSettings()

    def flattened() -> SplineMap:
        if warp is None:
            return flatten(task.terrain)
        return warp if isinstance(warp, SplineMap) else warp()

    chart = CHARTS.get(settings.chart).of(task.terrain, smoothing_m=settings.smoothing_m, flattened=flattened)
    structure = Structure(task, settings, chart)
    return GaitProgram(task, settings, structure, terms(structure))
