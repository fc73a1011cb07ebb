"""What all terms of one program share: the chart, the variables, and the signals at the nodes t_k = k Δt."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from ...errors import InvalidInput
from ...files.arrays import Array
from ..charts.chart import Chart
from ..task import GaitSettings, GaitTask
from ..transcription.blocks import Family, Port, Rows, Signal, itself
from .layout import NOTHING, Index, Layout
from .phases import gait_named, schedule


@dataclass(frozen=True, eq=False)
class FootGroup:
    """Feet of one kind at nodes. family: its signal is (p̄_i, f̄_i), or p̄_i of swinging feet; foot, node: shape (K,)."""

    family: Family
    foot: NDArray[np.intp]
    node: NDArray[np.intp]
    pushes: bool

    def port(self, chosen: Rows | None = None) -> Port:
        """All its instances, or some."""
        return self.family, np.arange(len(self.foot)) if chosen is None else chosen


class Structure:
    """The shape of one program: settings applied to a task, before any term is written."""

    def __init__(self, task: GaitTask, settings: GaitSettings, chart: Chart) -> None:
        self.task, self.settings, self.chart = task, settings, chart
        steps = round(task.duration_s / settings.step_s)
        if steps < 2 or abs(steps * settings.step_s - task.duration_s) > 1e-9:
            raise InvalidInput(
                f"step_s: expected a share of the duration of {task.duration_s:g} s, got {settings.step_s:g} s"
            )
        self.times_s: Array = np.asarray(settings.step_s * np.arange(steps + 1), dtype=np.float64)
        self.layout = Layout(
            schedule(gait_named(task.gait), task.robot.foot_names, task.duration_s, settings.step_s),
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
    def torso(self) -> Family:
        """(p̄, θ̄) at all nodes."""
        return Family("torso", self.layout.torso_rows(self.times_s), 6, self.chart.torso_map)

    def torso_at(self, nodes: Rows) -> Port:
        """(p̄, θ̄) at nodes; before the start the robot stands still, and so it does after a still end."""
        return self.torso, np.clip(nodes, 0, self.nodes - 1)

    @cached_property
    def feet_at_nodes(self) -> tuple[FootGroup, ...]:
        """All feet at all nodes, in groups."""
        if self.task.timings == "optimised":
            from .timing import moving_groups

            return moving_groups(self)
        return self._groups(self.times_s)

    def _groups(self, times_s: Array) -> tuple[FootGroup, ...]:
        standing: list[tuple[int, int]] = []
        swinging: list[tuple[int, int]] = []
        rows: dict[bool, list[csr_array]] = {True: [], False: []}
        for foot, entries in enumerate(self.layout.feet):
            stands = entries.phases.stands(times_s)
            places, forces = self.layout.foot_rows(foot, times_s), self.layout.force_rows(foot, times_s)
            for node in range(len(times_s)):
                where = slice(3 * node, 3 * node + 3)
                if stands[node]:
                    standing.append((foot, node))
                    place = places[where]
                    rows[True] += [place[:2] if self.chart.flat else place, forces[where]]
                else:
                    swinging.append((foot, node))
                    rows[False].append(places[where])
        width = 5 if self.chart.flat else 6
        signal = on_ground if self.chart.flat else itself
        found = [self._group("stance", standing, rows[True], width, signal, True)]
        if swinging:
            found.append(self._group("swing", swinging, rows[False], 3, itself, False))
        return tuple(found)

    def _group(
        self, name: str, at: list[tuple[int, int]], rows: list[csr_array], width: int, signal: Signal, pushes: bool
    ) -> FootGroup:
        foot, node = np.array(at).T
        family = Family(name, csr_array(vstack(rows)), width, self.chart.foot_map, signal)
        return FootGroup(family, foot, node, pushes)

    def entries(self, name: str, entries: Index, on_foot: bool = False) -> Family:
        """Entries of the decision vector as signals, shape (K, width); columns that are NOTHING throughout are 0."""
        used = [k for k in range(entries.shape[1]) if np.any(entries[:, k] != NOTHING)]
        width = entries.shape[1]

        def spread(v: cs.SX, constants: cs.SX) -> cs.SX:
            out = cs.SX.zeros(width)
            for at, k in enumerate(used):
                out[k] = v[at]
            return out

        rows = self.layout.entry_rows(entries[:, used])
        return Family(name, rows, len(used), self.chart.foot_map if on_foot else None, spread)


def on_ground(v: cs.SX, constants: cs.SX) -> cs.SX:
    """(p̄, f̄) of a foot that stands on z̄ = 0, from (x̄, ȳ, f̄)."""
    return cs.vertcat(v[:2], 0.0, v[2:5])
