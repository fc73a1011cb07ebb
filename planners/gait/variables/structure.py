"""Structure that all terms of one program share: the chart, the variables, and the features at the
nodes t_k = k Δt.
"""

from __future__ import annotations

import numpy as np

from ...arguments import cached_property
from ...errors import InvalidInput
from ...files.arrays import Array
from ...problem.walk import Walk
from ..charts.warped import Chart
from ..task import GaitSettings
from ..transcription.blocks import Rows, Selection, VariableGroup
from .layout import GaitLayout, Index
from .timing import FootGroup, entry_group, moving_groups, scheduled_groups


class Structure:
    """The shape of one program: settings applied to a task, before any term is written."""

    def __init__(self, task: Walk, settings: GaitSettings, chart: Chart) -> None:
        self.task, self.settings, self.chart = task, settings, chart
        steps = round(task.duration_s / settings.step_s)
        if steps < 2 or abs(steps * settings.step_s - task.duration_s) > 1e-9:
            raise InvalidInput(
                f"step_s: expected a share of the duration of {task.duration_s:g} s, got "
                f"{settings.step_s:g} s"
            )
        self.mean_s = settings.step_s if settings.mean_forces else 0.0
        self.times_s: Array = np.asarray(settings.step_s * np.arange(steps + 1), dtype=np.float64)
        self.layout = GaitLayout(
            task.phases(settings.step_s),
            task.duration_s,
            torso_knot_s=settings.torso_knot_s,
            force_knot_s=settings.force_knot_s,
            flat=chart.flat,
            optimised=task.timings == "optimised",
        )

    @property
    def nodes(self) -> int:
        """Number of nodes, those at 0 and T included."""
        return len(self.times_s)

    @property
    def feet(self) -> int:
        """Number of feet, E."""
        return len(self.task.robot.feet)

    @cached_property
    def torso(self) -> VariableGroup:
        """(p̄, θ̄) at all nodes."""
        return VariableGroup("torso", self.layout.torso_rows(self.times_s), 6, self.chart.torso_map)

    def torso_at(self, nodes: Rows) -> Selection:
        """(p̄, θ̄) at nodes; before the start y₋ = y₋₋ = y₀ (W14), the robot stands still, and so
        after a still end.
        """
        return self.torso, np.clip(nodes, 0, self.nodes - 1)

    @cached_property
    def feet_at_nodes(self) -> tuple[FootGroup, ...]:
        """All feet at all nodes, in groups."""
        if self.task.timings == "optimised":
            return moving_groups(
                self.layout, self.times_s, self.chart.foot_map, self.settings.switch_slack_s
            )
        return scheduled_groups(self.layout, self.times_s, self.chart.foot_map, self.mean_s)

    def entries(self, name: str, entries: Index, on_foot: bool = False) -> VariableGroup:
        """Entries of the decision vector as features, shape (K, width).

        Arguments:
            on_foot: points with the feet's map about.
        """
        return entry_group(self.layout, name, entries, self.chart.foot_map if on_foot else None)
