"""The warped charts (W7, Pan et al. §IV-C): all variables live in the space that the map φ
flattens.

As published, forces are pushed forward by J and held to the cone of W9, which is the true one only
where φ is conformal. The exact chart differs in one line: forces are given in the orthonormal frame
at the true normal.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from typing import Self

import casadi as cs
import numpy as np

from ...arguments import cached_property
from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ...warp.spline_map import SplineMap, polar_function
from ..transcription.taylor import ExpansionPoint, SnappedMap, TaylorMap


class Chart(ABC):
    """Coordinates of the torso, of feet and of contact forces (the pushforward of Pan et al.
    §IV-C).

    A chart of your own is a subclass: the four maps to the world (``torso``, ``foot``, ``force``
    and, where forces are not in the axes of the surface, ``cone``), and their inverses for the
    initial guess (``torso_bar``, ``foot_bar``, ``force_bar``). It is used by its name in
    ``charts.CHARTS``, or as ``FILE.py:NAME``.

    While a foot stands, a force that is constant in the chart keeps its angle to the true normal,
    so the cone is asked of the force's coefficients.

    Arguments:
        flat: the terrain is z̄ = 0.
        scales: follows the terrain when a homotopy scales its heights; False for charts that are
            made of a terrain's map.
        torso_map, foot_map: the smooth maps that the kernels need about the torso and about each
            foot, whose first inputs are the coordinates there; what they are at a point comes as an
            ``ExpansionPoint``, None without a map.
    """

    flat: bool = True
    scales: bool = True
    torso_map: TaylorMap | None = None
    foot_map: TaylorMap | None = None

    def __init__(self, terrain: HeightField) -> None:
        self._terrain = terrain

    @property
    def kind(self) -> Hashable:
        """Equal for charts that differ in their maps' numbers alone; of one of your own, which may
        know its terrain otherwise, the chart itself.
        """
        maps = [one and one.kind for one in (self.torso_map, self.foot_map)]
        return (type(self), *maps) if type(self).__module__ == __name__ else self

    @classmethod
    def of(
        cls, terrain: HeightField, *, smoothing_m: float, flattened: Callable[[], SplineMap]
    ) -> Self:
        """The chart of a terrain: of that alone, unless a chart says otherwise.

        Arguments:
            smoothing_m: deviation of the Gaussian of ``GaitSettings`` [m].
            flattened: gives the map φ that flattens the terrain, for charts that need it.

        Raises:
            PlanningFailed: where no map can be made.
        """
        return cls(terrain)

    @abstractmethod
    def torso(self, bar: cs.SX, expansion: ExpansionPoint | None) -> tuple[cs.SX, cs.SX]:
        """(p̄, θ̄), shape (6), to p_WB (3) [m] and R_WB (3, 3)."""

    @abstractmethod
    def foot(self, bar: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """p̄_i to p_i (3) [m]."""

    @abstractmethod
    def force(self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """f̄_i of the foot at p̄_i to f_i in the world (3) [m·g]."""

    def cone(
        self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None
    ) -> tuple[cs.SX, cs.SX]:
        """Normal and tangential part of f̄_i: by the axes of the chart (W9)."""
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


def euler(angles: cs.SX) -> cs.SX:
    """R = R_z(yaw) R_y(pitch) R_x(roll) of θ = (roll, pitch, yaw) [rad], shape (3, 3) (Pan et al.
    §III-A).
    """
    cr, cp, cy = (cs.cos(angles[k]) for k in range(3))
    sr, sp, sy = (cs.sin(angles[k]) for k in range(3))
    return cs.vertcat(
        cs.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        cs.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        cs.horzcat(-sp, cp * sr, cp * cr),
    )


def shear_rotation(slope: cs.SX) -> cs.SX:
    """P(J) of the shear (x, y, z + h) with ∇h = slope, in closed form, shape (3, 3) (W12).

    J differs from a rotation in the plane of the slope and z only; there the polar factor turns by
    atan(|∇h| / 2), about the axis (h_y, −h_x, 0).
    """
    scale = cs.sqrt(4.0 + cs.sumsqr(slope))
    cosine = 2.0 / scale
    skew = cs.skew(cs.vertcat(slope[1], -slope[0], 0.0) / scale)
    return cs.SX.eye(3) + skew + skew @ skew / (1.0 + cosine)


def _surface_frame(slope: cs.SX) -> cs.SX:
    """R_WC: columns t₁ (over the world's x), t₂ = n × t₁ and the true normal n, shape (3, 3)."""
    first = cs.vertcat(1.0, 0.0, slope[0]) / cs.sqrt(1.0 + slope[0] ** 2)
    normal = _surface_normal(slope)
    return cs.horzcat(first, cs.cross(normal, first), normal)


def _surface_normal(slope: cs.SX) -> cs.SX:
    """(−∇h, 1) / ‖·‖ (Pan et al., after W5), shape (3, 1)."""
    return cs.vertcat(-slope[0], -slope[1], 1.0) / cs.sqrt(1.0 + cs.sumsqr(slope))


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
        normal = _surface_normal(expansion.here[1].T)
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
        return _surface_frame(expansion.here[1].T) @ bar

    def torso_bar(self, p_WB: Array) -> Array:
        """p to p̄."""
        return _over(self._body, p_WB)

    def foot_bar(self, p_WF: Array) -> Array:
        """p_i to p̄_i."""
        return _over(self._terrain, p_WF)

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """f_i to f̄_i."""
        return np.asarray(np.einsum("kji,kj->ki", self._terrain.frame(foot[:, :2]), f_W))


def _over(terrain: HeightField, places: Array) -> Array:
    return np.column_stack([places[:, :2], places[:, 2] - terrain.height(places[:, :2])])


class DecoupledChart(Shear):
    """Feet as in the shear; the torso over the terrain under a Gaussian of deviation smoothing_m
    [m].
    """

    @classmethod
    def of(
        cls, terrain: HeightField, *, smoothing_m: float, flattened: Callable[[], SplineMap]
    ) -> Self:
        """Chart of the terrain and its smoothed self."""
        return cls(terrain, terrain.smoothed(smoothing_m))


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
        p, f = self._foot.map(len(bar))(bar.T, force.T, self._jets(self._chart.foot_map, bar))
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


_POLAR_STEPS = 5
"""Newton steps of P(J); J is near a rotation times a scale, where four give ten digits."""


class Warped(Chart):
    """φ(p̄), 𝒫[J(p̄)] R(θ̄) and f = J f̄, as published (W8, W9, W10, W13)."""

    scales = False

    def __init__(self, terrain: HeightField, warp: SplineMap) -> None:
        super().__init__(terrain)
        warp.check_fits(terrain)
        self._warp = warp
        self.torso_map = self.foot_map = SnappedMap(warp)
        self._polar = polar_function(_POLAR_STEPS)

    @classmethod
    def of(
        cls, terrain: HeightField, *, smoothing_m: float, flattened: Callable[[], SplineMap]
    ) -> Self:
        """Chart of the terrain and its map."""
        return cls(terrain, flattened())

    def torso(self, bar: cs.SX, expansion: ExpansionPoint | None) -> tuple[cs.SX, cs.SX]:
        """φ(p̄) and 𝒫[J(p̄)] R(θ̄) (W13)."""
        assert expansion is not None
        p, jacobian = expansion.at(bar[:3])
        return p, self._polar(jacobian) @ euler(bar[3:])

    def foot(self, bar: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """φ(p̄_i)."""
        assert expansion is not None
        return expansion.here[0]

    def force(self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """J(p̄_i) f̄_i."""
        assert expansion is not None
        return expansion.here[1] @ bar

    def torso_bar(self, p_WB: Array) -> Array:
        """φ⁻¹(p)."""
        return self._warp.inverse(p_WB)

    def foot_bar(self, p_WF: Array) -> Array:
        """φ⁻¹(p_i)."""
        return self._warp.inverse(p_WF)

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """J⁻¹ f."""
        return np.asarray(np.linalg.solve(self._warp.jacobians(foot), f_W[..., None])[..., 0])


class WarpedExact(Warped):
    """The warped chart with forces in the frame of the true normal: as convex, and no error in the
    cone.

    The map matches the terrain at z̄ = 0, so the first two columns of J span the tangent plane
    there.
    """

    def force(self, bar: cs.SX, foot: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        """R_WC f̄_i with the axes of ``_tangent_frame``."""
        assert expansion is not None
        return _tangent_frame(expansion.here[1]) @ bar

    def force_bar(self, f_W: Array, foot: Array) -> Array:
        """R_WCᵀ f."""
        jacobian = self._warp.jacobians(foot)
        first = jacobian[:, :, 0] / np.linalg.norm(jacobian[:, :, 0], axis=1)[:, None]
        normal = np.cross(jacobian[:, :, 0], jacobian[:, :, 1])
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        frame = np.stack([first, np.cross(normal, first), normal], axis=2)
        return np.asarray(np.einsum("kji,kj->ki", frame, f_W))


def _tangent_frame(jacobian: cs.SX) -> cs.SX:
    """R_WC: columns t₁ along J e_x, t₂ = n × t₁ and n along J e_x × J e_y, shape (3, 3)."""
    first, normal = jacobian[:, 0], cs.cross(jacobian[:, 0], jacobian[:, 1])
    first, normal = first / cs.norm_2(first), normal / cs.norm_2(normal)
    return cs.horzcat(first, cs.cross(normal, first), normal)
