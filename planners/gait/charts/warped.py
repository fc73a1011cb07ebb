"""The warped charts (W7, Pan et al. §IV-C): all variables live in the space that the map φ
flattens.

As published, forces are pushed forward by J and held to the cone of W9, which is the true one only
where φ is conformal. The exact chart differs in one line: forces are given in the orthonormal frame
at the true normal.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import casadi as cs
import numpy as np

from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ...warp.pushforward import polar_function
from ...warp.spline_map import SplineMap
from ..transcription.taylor import ExpansionPoint, SnappedMap
from .chart import Chart
from .rotations import euler

POLAR_STEPS = 5
"""Newton steps of P(J); J is near a rotation times a scale, where four give ten digits."""


class Warped(Chart):
    """φ(p̄), 𝒫[J(p̄)] R(θ̄) and f = J f̄, as published (W8, W9, W10, W13)."""

    scales = False

    def __init__(self, terrain: HeightField, warp: SplineMap) -> None:
        super().__init__(terrain)
        warp.check_fits(terrain)
        self._warp = warp
        self.torso_map = self.foot_map = SnappedMap(warp)
        self._polar = polar_function(POLAR_STEPS)

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
