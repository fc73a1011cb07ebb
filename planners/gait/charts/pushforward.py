"""A chart as functions of numbers: decision variables pushed forward to the world (Pan et al.
§IV-C).
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ...arguments import cached_property
from ...files.arrays import Array
from ..transcription.taylor import ExpansionPoint, TaylorMap
from .chart import Chart


class Pushforward:
    """A chart as functions of numbers.

    Arguments:
        height_factor: on the heights of the terrain.
    """

    def __init__(self, chart: Chart, height_factor: float = 1.0) -> None:
        self._chart, self._factor = chart, height_factor

    def torso(self, bar: Array) -> tuple[Array, Array]:
        """(p̄, θ̄), shape (K, 6), to p_WB (K, 3) [m] and R_WB (K, 3, 3)."""
        p, r = self._torso.map(len(bar))(bar.T, self._jets(self._chart.torso_map, bar))
        return np.asarray(p).T, np.asarray(r).T.reshape(-1, 3, 3).swapaxes(1, 2)

    def foot(self, bar: Array, force: Array) -> tuple[Array, Array]:
        """p̄_i and f̄_i, shape (K, 3), to p_i (K, 3) [m] and f_i (K, 3)."""
        jets = self._jets(self._chart.foot_map, bar)
        p, f = self._foot.map(len(bar))(bar.T, force.T, jets)
        return np.asarray(p).T, np.asarray(f).T

    @cached_property
    def _torso(self) -> cs.Function:
        bar = cs.SX.sym("y", 6)
        expansion, jets = self._expansion(self._chart.torso_map, bar)
        p, r = self._chart.torso(bar, expansion)
        return cs.Function("torso", [bar, jets], [cs.densify(p), cs.densify(cs.vec(r))])

    @cached_property
    def _foot(self) -> cs.Function:
        bar, force = cs.SX.sym("p", 3), cs.SX.sym("f", 3)
        expansion, jets = self._expansion(self._chart.foot_map, bar)
        p, f = self._chart.foot(bar, expansion), self._chart.force(force, bar, expansion)
        return cs.Function("foot", [bar, force, jets], [cs.densify(p), cs.densify(f)])

    @staticmethod
    def _expansion(chart_map: TaylorMap | None, bar: cs.SX) -> tuple[ExpansionPoint | None, cs.SX]:
        if chart_map is None:
            return None, cs.SX(0, 1)
        jet, point = cs.SX.sym("j", chart_map.size(1)), bar[: chart_map.inputs]
        return ExpansionPoint(chart_map.polynomial(1), point, point, jet), jet

    def _jets(self, chart_map: TaylorMap | None, bar: Array) -> Array:
        """Jets of order 1 at places, shape (K, …), one a column."""
        if chart_map is None:
            return np.zeros((0, len(bar)))
        jets = chart_map.at(bar[:, : chart_map.inputs], 1).T
        return self._factor * jets if chart_map.homogeneous else jets
