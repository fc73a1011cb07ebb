"""Charts: coordinates in which a walk is optimised (Pan et al. §IV-C). A chart is a file, and a
line in the table here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...plugins import Registry

if TYPE_CHECKING:
    from .warped import Chart


def _is_chart(thing: Any) -> bool:
    from .warped import Chart

    return isinstance(thing, type) and issubclass(thing, Chart)


CHARTS: Registry[type[Chart]] = Registry(
    "chart",
    "stancekit.charts",
    {
        "ambient": "stancekit.planners.gait.charts.warped:Ambient",
        "shear": "stancekit.planners.gait.charts.warped:Shear",
        "decoupled": "stancekit.planners.gait.charts.warped:DecoupledChart",
        "warped": "stancekit.planners.gait.charts.warped:Warped",
        "warped-exact": "stancekit.planners.gait.charts.warped:WarpedExact",
    },
    expected="a class of charts, as those in planners/gait/charts are",
    accepts=_is_chart,
)
"""Charts by name: command line, settings, environment and benchmarks know them from here."""
