"""Ground that is given by heights: solid below, with one friction coefficient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array

if TYPE_CHECKING:
    from .heightfield import HeightField  # splines are slow to import


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights that are solid below.

    Arguments:
        friction: Coulomb coefficient of all of it.
    """

    heights: HeightField
    friction: float = 1.0
    name: ClassVar[str] = "the ground"

    @cached_property
    def _spline(self) -> tuple[Array, tuple[Array, Array]]:
        """Control points and knots of the heights."""
        (control,), knots = self.heights.spline
        return control, knots

    def tops(self, low: Array, high: Array) -> Array:
        """Height above which no part of boxes is in it, corners of shape (S, 3) [m]: a spline is
        below its control points, those about a box alone where the box is not above all; shape (S,).
        """
        control, each = self._spline
        tops = np.full(len(low), control.max())
        near = np.flatnonzero(low[:, 2] < tops)
        (x0, x1), (y0, y1) = (
            [
                np.clip(np.searchsorted(knots, at[near, k], side="right") - 4, 0, len(knots) - 8)
                for at in (low, high)
            ]
            for k, knots in enumerate(each)
        )
        tops[near] = [
            control[a : b + 4, c : d + 4].max()
            for a, b, c, d in zip(*(line.tolist() for line in (x0, x1, y0, y1)), strict=True)
        ]
        return tops

    def depth(self, points: Array) -> Array:
        """Depth of points in it, along the normal where it is even, negative above, shape (…, 3) to
        (…) [m].
        """
        height, slope = self.heights.height_and_gradient(points[..., :2])
        return np.asarray((height - points[..., 2]) / np.sqrt(1.0 + np.vecdot(slope, slope)))

    @cached_property
    def _tops(self) -> Array:
        """The highest of the control points that the spline has over each cell of its knots, shape
        (X, Y) [m].
        """
        control, _ = self._spline
        rows = np.max([control[k : len(control) - 3 + k] for k in range(4)], axis=0)
        return np.asarray(np.max([rows[:, k : rows.shape[1] - 3 + k] for k in range(4)], axis=0))

    def depth_inside(self, points: Array) -> Array:
        """``depth`` of the points that are in it, and −inf of the others, shape (…, 3) to (…) [m].

        What is above all control points about it is above the spline, and is not looked at; the
        slope is that of points that are below it alone.
        """
        flat = points.reshape(-1, 3)
        depths = np.full(len(flat), -np.inf)
        _, knots = self._spline
        cells = [
            np.clip(np.searchsorted(lines, flat[:, k], side="right") - 4, 0, len(lines) - 8)
            for k, lines in enumerate(knots)
        ]
        low = np.flatnonzero(flat[:, 2] < self._tops[cells[0], cells[1]])
        low = low[self.heights.height(flat[low, :2]) > flat[low, 2]]
        if len(low):
            depths[low] = self.depth(flat[low])
        return depths.reshape(points.shape[:-1])

    def distance(self, points: Array) -> Array:
        """Distance of points from it, along the normal where it is even, negative inside, shape (…,
        3) to (…) [m].
        """
        return -self.depth(points)

    def even(self, spacing_m: float) -> tuple[Array, Array, Array]:
        """Heights on even grid lines at most this far apart: x, y and heights, shape (n,), (m,),
        (n, m) [m].
        """
        x, y = (
            np.linspace(a, b, int(np.ceil((b - a) / spacing_m)) + 1)
            for a, b in self.heights.domain_m
        )
        return x, y, self.heights.height(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
