"""Charts: how decision variables become world quantities. Every term of the program is written once, over a chart.

A bar marks a chart's coordinates, as in paper W §IV-C. The torso's are (p̄, θ̄), a foot's p̄_i and f̄_i.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np

from ...errors import InvalidInput
from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ..transcription.taylor import JetMap, Site
from .rotations import euler, shear_rotation, surface_frame, surface_normal

if TYPE_CHECKING:
    from ...warp.spline_map import SplineMap


class Chart(ABC):
    """Coordinates of the torso, of feet and of contact forces.

    flat: the terrain is z̄ = 0. scales: follows the terrain when a homotopy scales its heights. torso_map, foot_map: the
    smooth maps that the kernels need about the torso and about each foot. While a foot stands, a force that is constant
    in the chart keeps its angle to the true normal, so the cone is asked of the force's coefficients.
    """

    name: str
    flat: bool = True
    scales: bool = True
    torso_map: JetMap | None = None
    foot_map: JetMap | None = None

    @abstractmethod
    def torso(self, bar: cs.SX, site: Site | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄), shape (6), to p_WB (3) and R_WB (3, 3)."""

    @abstractmethod
    def foot(self, bar: cs.SX, site: Site | None) -> cs.SX:
        """p̄_i to p_i (3)."""

    @abstractmethod
    def force(self, bar: cs.SX, foot: cs.SX, site: Site | None) -> cs.SX:
        """f̄_i of the foot at p̄_i to f_i in the world (3)."""

    def cone(self, bar: cs.SX, foot: cs.SX, site: Site | None) -> tuple[cs.SX, cs.SX]:
        """Normal and tangential part of f̄_i: by the axes of the chart, which is eq. 9."""
        return bar[2], bar[:2]

    @abstractmethod
    def torso_bar(self, p_WB: Array) -> Array:
        """p̄ of torso positions, shape (K, 3) [m], for an initial guess."""

    @abstractmethod
    def foot_bar(self, p_WF: Array) -> Array:
        """p̄_i of feet, shape (K, 3) [m]."""

    @abstractmethod
    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """f̄_i of forces on feet at p̄_i, shape (K, 3)."""


class Ambient(Chart):
    """World coordinates: paper W's baseline, eqs. 2–5."""

    name = "ambient"
    flat = False

    def __init__(self, terrain: HeightField) -> None:
        self._terrain = terrain
        self.foot_map = JetMap.of_heights(terrain)

    def torso(self, bar: cs.SX, site: Site | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄) to p_WB and R_WB."""
        return bar[:3], euler(bar[3:])

    def foot(self, bar: cs.SX, site: Site | None) -> cs.SX:
        """p̄_i to p_i."""
        return bar

    def force(self, bar: cs.SX, foot: cs.SX, site: Site | None) -> cs.SX:
        """f̄_i to f_i."""
        return bar

    def cone(self, bar: cs.SX, foot: cs.SX, site: Site | None) -> tuple[cs.SX, cs.SX]:
        """Eq. 5: by the true normal at the foot."""
        assert site is not None
        normal = surface_normal(site.here[1].T)
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


class Shear(Chart):
    """(x, y, z + h(x, y)) for feet and torso; forces in the orthonormal frame at the true normal."""

    name = "shear"

    def __init__(self, terrain: HeightField, body: HeightField | None = None) -> None:
        self._terrain, self._body = terrain, body or terrain
        self.foot_map = JetMap.of_heights(terrain)
        self.torso_map = self.foot_map if body is None else JetMap.of_heights(body)

    def torso(self, bar: cs.SX, site: Site | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄) to p_WB and R_WB."""
        assert site is not None
        height, slope = site.at(bar[:2])
        return bar[:3] + cs.vertcat(0.0, 0.0, height), shear_rotation(slope.T) @ euler(bar[3:])

    def foot(self, bar: cs.SX, site: Site | None) -> cs.SX:
        """p̄_i to p_i."""
        assert site is not None
        return bar + cs.vertcat(0.0, 0.0, site.here[0])

    def force(self, bar: cs.SX, foot: cs.SX, site: Site | None) -> cs.SX:
        """f̄_i to f_i."""
        assert site is not None
        return surface_frame(site.here[1].T) @ bar

    def torso_bar(self, p_WB: Array) -> Array:
        """p to p̄."""
        return np.column_stack([p_WB[:, :2], p_WB[:, 2] - self._body.height(p_WB[:, :2])])

    def foot_bar(self, p_WF: Array) -> Array:
        """p_i to p̄_i."""
        return np.column_stack([p_WF[:, :2], p_WF[:, 2] - self._terrain.height(p_WF[:, :2])])

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """f_i to f̄_i."""
        return np.asarray(np.einsum("kji,kj->ki", self._terrain.frame(foot[:, :2]), f_W))


class Decoupled(Shear):
    """Feet as in the shear; the torso over a smoothed terrain, so that it does not feel every stone."""

    name = "decoupled"

    def __init__(self, terrain: HeightField, smoothing_m: float) -> None:
        super().__init__(terrain, terrain.smoothed(smoothing_m))


def make_chart(name: str, terrain: HeightField, smoothing_m: float, warp: SplineMap | None = None) -> Chart:
    """The chart of this name. warp: the terrain's map, for the warped charts. Raises InvalidInput."""
    if name == "ambient":
        return Ambient(terrain)
    if name == "shear":
        return Shear(terrain)
    if name == "decoupled":
        return Decoupled(terrain, smoothing_m)
    if name in ("warped", "warped-exact"):
        from .warped import Warped, WarpedExact

        if warp is None:
            from ...warp.conformal import flatten

            warp = flatten(terrain)
        return (Warped if name == "warped" else WarpedExact)(terrain, warp)
    raise InvalidInput(f"chart: expected ambient, shear, decoupled, warped or warped-exact, got {name!r}")
