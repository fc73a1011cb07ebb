"""Smooth maps inside the program as their Taylor polynomials: exact derivatives at the price of a
look-up.

A kernel (``blocks``) sees the terrain or the warp map about the current point as a polynomial of
order n whose coefficients, the jet, are parameters. At that point it agrees with the map in n
derivatives, so values, Jacobians and Hessians of whatever a kernel makes of the map and of its
Jacobian are exact with jets of order 1, 2 and 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import factorial, prod
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np

from ...cached import cached_property
from ...files.arrays import Array

if TYPE_CHECKING:
    from ...terrain.heightfield import HeightField
    from ...warp.spline_map import SplineMap

DEGREE = 3


class TaylorMap:
    """A map R^d → R^m of tensor-product cubic splines, and its jets.

    Arguments:
        control: coefficients, shape (m, n₁, …, n_d).
        knots: along each axis, shape (n_k + 4,).
        homogeneous: whether the map is a height that may be multiplied by the program's height
            factor.
    """

    def __init__(self, control: Array, knots: Sequence[Array], *, homogeneous: bool) -> None:
        self.homogeneous = homogeneous
        self.outputs, self.inputs = control.shape[0], len(knots)
        self._control, self._knots = control, tuple(np.asarray(line) for line in knots)
        self._derivatives: dict[tuple[int, ...], cs.Function] = {}
        self._jets: dict[int, cs.Function] = {}
        self._polynomials: dict[int, cs.Function] = {}

    @classmethod
    def of_heights(cls, field: HeightField) -> TaylorMap:
        """h(x, y) of a terrain."""
        return cls(*field.spline, homogeneous=True)

    def powers(self, order: int) -> list[tuple[int, ...]]:
        """Multi-indices α with |α| ≤ order, by growing |α|."""
        exponents = []
        for degree in range(order + 1):
            for axes in combinations_with_replacement(range(self.inputs), degree):
                exponents.append(tuple(axes.count(k) for k in range(self.inputs)))
        return exponents

    def size(self, order: int) -> int:
        """Length of a jet of this order."""
        return int(self.outputs * len(self.powers(order)))

    def jet(self, order: int) -> cs.Function:
        """CasADi function from the point (d) to the jet, all ∂^α of all outputs, α by α."""
        if order not in self._jets:
            point = cs.MX.sym("x", self.inputs)
            derivatives = [self._derivative(power)(point) for power in self.powers(order)]
            self._jets[order] = cs.Function("jet", [point], [cs.vertcat(*derivatives)])
        return self._jets[order]

    def _derivative(self, power: tuple[int, ...]) -> cs.Function:
        """∂^α as a spline of its own: differences of the coefficients, one degree less for each."""
        if power not in self._derivatives:
            control, knots, degrees = self._control, list(self._knots), [DEGREE] * self.inputs
            if max(power) > DEGREE:
                self._derivatives[power] = cs.Function(
                    "d", [cs.MX.sym("x", self.inputs)], [cs.DM.zeros(self.outputs)]
                )
                return self._derivatives[power]
            for axis, count in enumerate(power):
                for _ in range(count):
                    line, degree = knots[axis], degrees[axis]
                    size = control.shape[axis + 1]
                    rise = (line[degree + 1 : degree + size] - line[1:size]) / degree
                    shape = [-1 if k == axis + 1 else 1 for k in range(control.ndim)]
                    control = np.diff(control, axis=axis + 1) / rise.reshape(shape)
                    knots[axis], degrees[axis] = line[1:-1], degree - 1
            point = cs.MX.sym("x", self.inputs)
            lines = [line.tolist() for line in knots]
            value = cs.bspline(
                point, cs.DM(control.ravel(order="F")), lines, degrees, self.outputs, {}
            )
            self._derivatives[power] = cs.Function("d", [point], [value])
        return self._derivatives[power]

    def polynomial(self, order: int) -> cs.Function:
        """Function of (point, base, jet) to the Taylor polynomial's value (m) and Jacobian (m,
        d).
        """
        if order not in self._polynomials:
            point, base = cs.SX.sym("x", self.inputs), cs.SX.sym("b", self.inputs)
            jet = cs.SX.sym("j", self.size(order))
            value = self.taylor(point, base, jet, order)
            outputs = [value, cs.jacobian(value, point)]
            self._polynomials[order] = cs.Function("taylor", [point, base, jet], outputs)
        return self._polynomials[order]

    def taylor(self, point: cs.SX, base: cs.SX, jet: cs.SX, order: int) -> cs.SX:
        """The Taylor polynomial about ``base`` at ``point``, shape (m)."""
        away, value = point - base, cs.SX.zeros(self.outputs)
        for index, power in enumerate(self.powers(order)):
            term = prod((away[k] ** n for k, n in enumerate(power) if n), start=cs.SX(1))
            scale = prod(factorial(n) for n in power)
            value = value + jet[index * self.outputs : (index + 1) * self.outputs] * term / scale
        return value


class SnappedMap(TaylorMap):
    """φ of a warp map: splines s(x̄), and a correction fade(z̄) · δ(s_x, s_y) upward that makes the
    ground exact.

    Its jet is that of s and then that of δ.
    """

    def __init__(self, warp: SplineMap) -> None:
        super().__init__(*warp.spline, homogeneous=False)
        self._snap = None if warp.snap is None else TaylorMap.of_heights(warp.snap)
        self._fade_m = warp.fade_m

    def size(self, order: int) -> int:
        """Length of both jets."""
        return super().size(order) + (self._snap.size(order) if self._snap else 0)

    def jet(self, order: int) -> cs.Function:
        """CasADi function from the point to both jets."""
        plain = super().jet(order)
        if self._snap is None:
            return plain
        point = cs.MX.sym("x", 3)
        first = plain(point)
        return cs.Function("jet", [point], [cs.vertcat(first, self._snap.jet(order)(first[:2]))])

    def taylor(self, point: cs.SX, base: cs.SX, jet: cs.SX, order: int) -> cs.SX:
        """The polynomial of s, corrected by that of δ about s_xy(base)."""
        size = super().size(order)
        value = super().taylor(point, base, jet[:size], order)
        if self._snap is None:
            return value
        u = cs.fmin(cs.fmax(point[2] / self._fade_m, 0.0), 1.0)
        fade = 1.0 - u**3 * (10.0 + u * (6.0 * u - 15.0))
        correction = self._snap.taylor(value[:2], jet[:2], jet[size:], order)
        return value + cs.vertcat(0.0, 0.0, fade * correction)


@dataclass(frozen=True, eq=False)
class ExpansionPoint:
    """The map about one point of a kernel: its jet, as symbols, and where the jet was taken."""

    polynomial: cs.Function
    point: cs.SX
    base: cs.SX
    jet: cs.SX

    def at(self, point: cs.SX) -> tuple[cs.SX, cs.SX]:
        """Value (m) and Jacobian (m, d) of the map near the expansion."""
        value, jacobian = self.polynomial(point, self.base, self.jet)
        return value, jacobian

    @cached_property
    def here(self) -> tuple[cs.SX, cs.SX]:
        """Value (m) and Jacobian (m, d) of the map at the expansion."""
        return self.at(self.point)
