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

from ...arguments import cached_property
from ...files.arrays import Array
from ...terrain.bspline import CubicBasis

if TYPE_CHECKING:
    from ...terrain.heightfield import HeightField
    from ...warp.spline_map import SplineMap


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
        self._control = np.ascontiguousarray(control)
        self._bases = [CubicBasis(line) for line in knots]
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

    def at(self, points: Array, order: int) -> Array:
        """Jets at points, shape (K, d) → (K, size)."""
        first, weights = zip(
            *(
                basis.weights(np.ascontiguousarray(points[:, k]), order)
                for k, basis in enumerate(self._bases)
            ),
            strict=True,
        )
        shape = self._control.shape[1:]
        steps = np.ravel_multi_index(np.indices((4,) * self.inputs), shape)
        flat = np.ravel_multi_index(first, shape)[:, None] + steps.ravel()
        near = self._control.reshape(self.outputs, -1)[:, flat]
        parts: dict[tuple[int, ...], Array] = {(): near.reshape(*near.shape[:2], *steps.shape)}
        for axis in reversed(range(self.inputs)):  # along the last axis first
            for power in {power[axis:] for power in self.powers(order)}:
                rest = parts[power[1:]]
                parts[power] = np.einsum("cn...k,nk->cn...", rest, weights[axis][power[0]])
        return np.concatenate([parts[power] for power in self.powers(order)]).T

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

    def at(self, points: Array, order: int) -> Array:
        """Both jets at points, shape (K, 3) → (K, size)."""
        plain = super().at(points, order)
        if self._snap is None:
            return plain
        return np.concatenate([plain, self._snap.at(plain[:, :2], order)], axis=1)

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


class Jets(cs.Callback):
    """CasADi function from points, shape (d, K), to a map's jets there, (size, K), all ∂^α of all
    outputs, α by α; without derivatives of its own.

    NumPy evaluates it: CasADi's own splines write out of their bounds where a third derivative is
    asked for on a knot.

    Arguments:
        chart_map: the map.
        order: of the jets.
        count: K.
        errors: what is raised in a call, an interrupt, too, is put here, for whoever solves: a
            solver takes it for a place where the function has no value, and goes on elsewhere.
    """

    def __init__(
        self, chart_map: TaylorMap, order: int, count: int, errors: list[BaseException]
    ) -> None:
        super().__init__()
        self._map, self._order, self._count, self._errors = chart_map, order, count, errors
        self.construct("jets", {})

    def get_n_in(self) -> int:
        """The points alone."""
        return 1

    def get_n_out(self) -> int:
        """The jets alone."""
        return 1

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """All dense."""
        return cs.Sparsity.dense(self._map.inputs, self._count)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """All dense."""
        return cs.Sparsity.dense(self._map.size(self._order), self._count)

    def has_eval_buffer(self) -> bool:
        """Numbers are read and written where CasADi has them."""
        return True

    def eval_buffer(self, arguments: Sequence[memoryview], results: Sequence[memoryview]) -> int:
        """CasADi's call; 0 is its word for a success."""
        try:
            points = np.frombuffer(arguments[0]).reshape(self._count, -1)
            jets = self._map.at(points, self._order)
            np.frombuffer(results[0]).reshape(self._count, -1)[:] = jets
        except BaseException as error:
            self._errors.append(error)
            return 1
        return 0


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
