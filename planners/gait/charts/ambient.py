"""The ambient chart: world coordinates, Pan et al.'s baseline (W1–W5)."""

from __future__ import annotations

import casadi as cs

from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ..transcription.taylor import ExpansionPoint, TaylorMap
from .chart import Chart
from .rotations import euler, surface_normal


class Ambient(Chart):
    """World coordinates: Pan et al.'s baseline (W1)."""

    flat = False

    def __init__(self, terrain: HeightField) -> None:
        super().__init__(terrain)
        self.foot_map = TaylorMap.of_heights(terrain)

    def torso(self, bar: cs.SX, expansion: ExpansionPoint | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄) to p_WB and R_WB."""
        return bar[:3], euler(bar[3:])

    def foot(self, bar: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """p̄_i to p_i."""
        return bar

    def force(self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """f̄_i to f_i."""
        return bar

    def cone(
        self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None
    ) -> tuple[cs.SX, cs.SX]:
        """Normal and tangential part by the true normal at the foot (W5)."""
        assert expansion is not None
        normal = surface_normal(expansion.here[1].T)
        pressing = cs.dot(normal, bar)
        return pressing, bar - pressing * normal

    def torso_bar(self, p_WB: Array) -> Array:
        """p to p̄."""
        return p_WB

    def foot_bar(self, p_WF: Array) -> Array:
        """p_i to p̄_i."""
        return p_WF

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """f_i to f̄_i."""
        return f_W
