"""The shear: (x, y, z + h(x, y)), a map that flattens a height field and needs no optimisation."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ..transcription.taylor import ExpansionPoint, TaylorMap
from .chart import Chart
from .rotations import euler, shear_rotation, surface_frame


class Shear(Chart):
    """(x, y, z + h(x, y)) for feet and torso; forces in the orthonormal frame at the true normal.

    Arguments:
        body: the terrain over which the torso is, the same one if missing.
    """

    def __init__(self, terrain: HeightField, body: HeightField | None = None) -> None:
        super().__init__(terrain)
        self._body = body or terrain
        self.foot_map = TaylorMap.of_heights(terrain)
        self.torso_map = self.foot_map if body is None else TaylorMap.of_heights(body)

    def torso(self, bar: cs.SX, expansion: ExpansionPoint | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄) to p_WB and R_WB, the latter by the shear's own 𝒫(J) (W12, W13)."""
        assert expansion is not None
        height, slope = expansion.at(bar[:2])
        return bar[:3] + cs.vertcat(0.0, 0.0, height), shear_rotation(slope.T) @ euler(bar[3:])

    def foot(self, bar: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """p̄_i to p_i."""
        assert expansion is not None
        return bar + cs.vertcat(0.0, 0.0, expansion.here[0])

    def force(self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """f̄_i to f_i."""
        assert expansion is not None
        return surface_frame(expansion.here[1].T) @ bar

    def torso_bar(self, p_WB: Array) -> Array:
        """p to p̄."""
        return np.column_stack([p_WB[:, :2], p_WB[:, 2] - self._body.height(p_WB[:, :2])])

    def foot_bar(self, p_WF: Array) -> Array:
        """p_i to p̄_i."""
        return np.column_stack([p_WF[:, :2], p_WF[:, 2] - self._terrain.height(p_WF[:, :2])])

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """f_i to f̄_i."""
        return np.asarray(np.einsum("kji,kj->ki", self._terrain.frame(foot[:, :2]), f_W))
