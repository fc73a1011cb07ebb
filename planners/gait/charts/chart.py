"""Charts: how decision variables become world quantities. Every term of the program is written
once, over a chart.

A bar marks a chart's coordinates, as in Pan et al. §IV-C. The torso's are (p̄, θ̄), a foot's p̄_i
and f̄_i.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Self

import casadi as cs

from ...files.arrays import Array
from ...terrain.heightfield import HeightField
from ...warp.spline_map import SplineMap
from ..transcription.taylor import ExpansionPoint, TaylorMap


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
