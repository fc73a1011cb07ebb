"""Smooth maps inside the program as their Taylor polynomials: exact derivatives at the price of a
look-up.

A kernel (``blocks``) sees the terrain or the warp map about the current point as a polynomial of
order n whose coefficients, the jet, are parameters. At that point it agrees with the map in n
derivatives, so values, Jacobians and Hessians of whatever a kernel makes of the map and of its
Jacobian are exact with jets of order 1, 2 and 3.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import accumulate, combinations_with_replacement
from math import factorial, prod
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, vstack

from ...arguments import cached_property
from ...files.arrays import Array
from ...terrain.heightfield import CubicBasis

if TYPE_CHECKING:
    from ...terrain.heightfield import HeightField
    from ...warp.spline_map import SplineMap


@cache
def powers(inputs: int, order: int) -> tuple[tuple[int, ...], ...]:
    """Multi-indices α of so many variables with |α| ≤ order, by growing |α|."""
    return tuple(
        tuple(axes.count(k) for k in range(inputs))
        for degree in range(order + 1)
        for axes in combinations_with_replacement(range(inputs), degree)
    )


class TaylorMap:
    """A map R^d → R^m of tensor-product cubic splines, and its jets.

    Arguments:
        control: coefficients, shape (m, n₁, …, n_d).
        knots: along each axis, shape (n_k + 4,).
        homogeneous: whether the map is a height that may be multiplied by the program's height
            factor.
        kind: of the map; equal for maps that have the same polynomials but for the jets.
    """

    def __init__(self, control: Array, knots: Sequence[Array], *, homogeneous: bool) -> None:
        self.homogeneous = homogeneous
        self.outputs, self.inputs = control.shape[0], len(knots)
        self.kind: Hashable = self.outputs, self.inputs
        self._control = np.ascontiguousarray(control)
        self._near = np.ravel_multi_index(np.indices((4,) * self.inputs), control.shape[1:])
        self._bases = [CubicBasis(line) for line in knots]
        self._polynomials: dict[int, cs.Function] = {}

    @classmethod
    def of_heights(cls, field: HeightField) -> TaylorMap:
        """h(x, y) of a terrain."""
        return cls(*field.spline, homogeneous=True)

    def size(self, order: int) -> int:
        """Length of a jet of this order."""
        return int(self.outputs * len(powers(self.inputs, order)))

    def at(self, points: Array, order: int) -> Array:
        """Jets at points, shape (K, d) → (K, size)."""
        first, weights = zip(
            *(
                basis.weights(np.ascontiguousarray(points[:, k]), order)
                for k, basis in enumerate(self._bases)
            ),
            strict=True,
        )
        flat = np.ravel_multi_index(first, self._control.shape[1:])[:, None] + self._near.ravel()
        near = self._control.reshape(self.outputs, -1)[:, flat]
        parts: dict[tuple[int, ...], Array] = {(): near.reshape(*near.shape[:2], *self._near.shape)}
        for axis in reversed(range(self.inputs)):  # along the last axis first
            for power in powers(self.inputs - axis, order):
                rest = parts[power[1:]]
                parts[power] = np.einsum("cn...k,nk->cn...", rest, weights[axis][power[0]])
        return np.concatenate([parts[power] for power in powers(self.inputs, order)]).T

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
        for index, power in enumerate(powers(self.inputs, order)):
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
        self.kind = self._snap is None, self._fade_m

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
            jets = self._map.at(np.frombuffer(arguments[0]).reshape(self._count, -1), self._order)
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


Rows = NDArray[np.intp]


Features = Callable[[cs.SX, cs.SX], cs.SX]
_Place = Callable[[cs.SX, ExpansionPoint | None], cs.SX]


def identity(v: cs.SX, constants: cs.SX) -> cs.SX:
    """The feature of a variables whose arguments are what kernels want."""
    return v


@dataclass(frozen=True, eq=False)
class VariableGroup:
    """Signals of one kind at many instances, e.g. the torso at all nodes.

    Arguments:
        rows: shape (K · width, size), the local arguments of each instance; feature: what kernels
            get of (arguments, constants).
        constants: shape (K, c).
        map: the smooth map that kernels see about the point of a feature, which is its first
            entries or ``place`` of it.
        inner: a map that ``place`` needs about the first entries, to find the point.
    """

    name: str
    rows: csr_array
    width: int
    map: TaylorMap | None = None
    features: Features = identity
    constants: Array = field(default_factory=lambda: np.zeros((0, 0)))
    inner: TaylorMap | None = None
    place: _Place | None = None

    @property
    def count(self) -> int:
        """K, the number of instances."""
        return int(self.rows.shape[0]) // self.width

    @property
    def fixed(self) -> int:
        """Number of constants per instance."""
        return int(self.constants.shape[1]) if self.constants.size else 0

    def jets(self, order: int) -> int:
        """Length of all jets of an instance, the inner map's before the outer's."""
        return sum(one.size(order) for one in (self.inner, self.map) if one is not None)

    def expansions(self, feature: cs.SX, order: int, jets: cs.SX) -> list[ExpansionPoint]:
        """The inner and the outer map about their points, as far as the variables has them."""
        points: list[ExpansionPoint] = []
        if self.inner is not None:
            points.append(
                _expansion(
                    self.inner, feature[: self.inner.inputs], order, jets[: self.inner.size(order)]
                )
            )
        if self.map is not None:
            point = (
                feature
                if self.place is None
                else self.place(feature, points[0] if points else None)
            )
            jet = jets[-self.map.size(order) :]
            points.append(_expansion(self.map, point[: self.map.inputs], order, jet))
        return points


def _expansion(chart_map: TaylorMap, point: cs.SX, order: int, jet: cs.SX) -> ExpansionPoint:
    return ExpansionPoint(chart_map.polynomial(order), point, cs.SX.sym("b", chart_map.inputs), jet)


Selection = tuple[VariableGroup, Rows]
"""A variables and, for each instance of a block, which of its instances is meant."""
Kernel = Callable[[list[cs.SX], list[ExpansionPoint | None]], cs.SX]


@dataclass(frozen=True, eq=False)
class Block:
    """One kernel at K instances.

    Arguments:
        selections: its arguments.
        scatter: shape (K, outputs), the row of each output.
        order: how many derivatives of a selection's map the kernel's value needs (1: the map and
            its Jacobian).
        name: its own among the blocks of a program.
    """

    kernel: Kernel
    selections: tuple[Selection, ...]
    scatter: Rows
    order: int = 1
    name: str = ""

    @property
    def count(self) -> int:
        """K, the number of instances."""
        return int(self.scatter.shape[0])


@dataclass(frozen=True, eq=False)
class Constraint:
    """Rows of the program, lower ≤ Σ blocks + linear x ≤ upper.

    Arguments:
        name: what a violation is called.
        lower, upper: shape (rows,).
        blocks: their scatter counts rows from 0.
    """

    name: str
    lower: Array
    upper: Array
    blocks: tuple[Block, ...] = ()
    linear: csr_array | None = None

    @property
    def rows(self) -> int:
        """Number of rows per instance."""
        return len(self.lower)


Kernels = MutableMapping[tuple[str, int], cs.Function]
"""Kernels of programs that differ in their numbers alone, by the block's name and how many
derivatives."""


class Compiled:
    """A block as CasADi functions: value, Jacobian and Hessian of the kernel, and the gathering
    matrix.

    Arguments:
        kernels: where those of programs like this one are, and its own are put; None for none.
    """

    def __init__(self, block: Block, kernels: Kernels | None) -> None:
        self.block, self._kernels = block, {} if kernels is None else kernels
        self.groups = [variables for variables, _ in block.selections]
        self.gather = matrix(_gathered(block))
        self.width = sum(variables.width for variables in self.groups)
        fixed = [
            variables.constants[columns]
            for variables, columns in block.selections
            if variables.fixed
        ]
        constants = np.concatenate([np.zeros((block.count, 0)), *fixed], axis=1)
        self.constants = cs.MX(cs.DM(constants.T))

    def kernel(self, derivatives: int) -> cs.Function:
        """(v, constants, jets) → outputs; → ∂ outputs / ∂v, sparse; and (v, constants, jets,
        multipliers) → Hessian of multipliers · outputs, sparse.
        """
        key = self.block.name, derivatives
        if key not in self._kernels:
            self._kernels[key] = self._written(derivatives)
        return self._kernels[key]

    def _written(self, derivatives: int) -> cs.Function:
        v, c = cs.SX.sym("v", self.width), cs.SX.sym("c", self.constants.shape[0])
        order = self.block.order + derivatives
        jets = cs.SX.sym("j", sum(variables.jets(order) for variables in self.groups))
        output, expansions = self._evaluated(v, c, jets, order)
        inputs = [v, c, jets]
        if derivatives == 1:
            output = cs.jacobian(output, v)
        elif derivatives == 2:
            multipliers = cs.SX.sym("m", self.block.scatter.shape[1])
            output, inputs = cs.hessian(cs.dot(multipliers, output), v)[0], [*inputs, multipliers]
        for expansion in reversed(
            expansions
        ):  # every jet at its own point: powers of the distance to it vanish
            output = cs.substitute(output, expansion.base, expansion.point)
        return cs.Function("kernel", inputs, [output])

    def _evaluated(
        self, v: cs.SX, c: cs.SX, jets: cs.SX, order: int
    ) -> tuple[cs.SX, list[ExpansionPoint]]:
        features: list[cs.SX] = []
        shown: list[ExpansionPoint | None] = []
        every: list[ExpansionPoint] = []
        sizes = zip(*((one.width, one.fixed, one.jets(order)) for one in self.groups), strict=True)
        parts = [
            cs.vertsplit(whole, [0, *accumulate(each)])
            for whole, each in zip((v, c, jets), sizes, strict=True)
        ]
        for variables, own, constants, jet in zip(self.groups, *parts, strict=True):
            features.append(variables.features(own, constants))
            expansions = variables.expansions(features[-1], order, jet)
            shown += expansions or [None]
            every += expansions
        return self.block.kernel(features, shown), every

    def at(self, x: cs.MX, bank: TaylorBank, derivatives: int) -> list[cs.MX]:
        """Arguments of the kernel (but multipliers) at all instances."""
        order = self.block.order + derivatives
        v = cs.reshape(self.gather @ x, self.width, self.block.count)
        jets = [
            bank(variables, order)[:, columns.tolist()]
            for variables, columns in self.block.selections
            if variables.jets(order)
        ]
        return [v, self.constants, cs.vertcat(cs.MX(0, self.block.count), *jets)]


class TaylorBank:
    """Jets of whole groups at one decision vector, each asked for once.

    ``errors`` holds what was raised where they were evaluated.
    """

    def __init__(self, x: cs.MX, height_factor: cs.MX) -> None:
        self.errors: list[BaseException] = []
        self._x, self._factor = x, height_factor
        self._found: dict[tuple[int, int], cs.MX] = {}
        self._functions: dict[tuple[TaylorMap, int, int], Jets] = {}

    def __call__(self, variables: VariableGroup, order: int) -> cs.MX:
        """Jets of all instances, shape (jets, K)."""
        key = (id(variables), order)
        if key not in self._found:
            v = cs.reshape(matrix(variables.rows) @ self._x, variables.width, variables.count)
            constants = (
                cs.MX(cs.DM(variables.constants.T))
                if variables.fixed
                else cs.MX(0, variables.count)
            )
            points = self._mapped(variables, v, constants)
            jets = []
            first = cs.MX(0, variables.count)
            if variables.inner is not None:
                jets.append(self._jets(variables.inner, points, order))
                first = self._jets(variables.inner, points, 1)
            if variables.place is not None:
                points = self._placed(variables, points, first)
            if variables.map is not None:
                jets.append(self._jets(variables.map, points, order))
            self._found[key] = cs.vertcat(*jets)
        return self._found[key]

    def _jets(self, chart_map: TaylorMap, points: cs.MX, order: int) -> cs.MX:
        key = chart_map, order, points.shape[1]
        if key not in self._functions:
            self._functions[key] = Jets(*key, self.errors)
        jets = self._functions[key](points[: chart_map.inputs, :])
        return self._factor * jets if chart_map.homogeneous else jets

    @staticmethod
    def _mapped(variables: VariableGroup, v: cs.MX, constants: cs.MX) -> cs.MX:
        if variables.features is identity:
            return v
        a, c = cs.SX.sym("v", variables.width), cs.SX.sym("c", variables.fixed)
        return cs.Function("feature", [a, c], [cs.densify(variables.features(a, c))]).map(
            variables.count
        )(v, constants)

    @staticmethod
    def _placed(variables: VariableGroup, features: cs.MX, jets: cs.MX) -> cs.MX:
        assert variables.place is not None
        feature, jet = cs.SX.sym("s", features.shape[0]), cs.SX.sym("j", jets.shape[0])
        expansion = None
        if variables.inner is not None:
            point = feature[: variables.inner.inputs]
            expansion = ExpansionPoint(variables.inner.polynomial(1), point, point, jet)
        place = cs.Function(
            "place", [feature, jet], [cs.densify(variables.place(feature, expansion))]
        )
        return place.map(variables.count)(features, jets)


def matrix(rows: Any) -> cs.DM:
    """A SciPy matrix as a sparse CasADi constant."""
    columns = csc_array(rows)
    columns.sort_indices()
    pattern = cs.Sparsity(*columns.shape, columns.indptr.tolist(), columns.indices.tolist())
    return cs.DM(pattern, columns.data)


def scattered(rows: Rows, total: int) -> csr_array:
    """The matrix that adds outputs, instance by instance, into rows, shape (total, rows.size)."""
    flat = rows.ravel()
    return csr_array((np.ones(len(flat)), (flat, np.arange(len(flat)))), shape=(total, len(flat)))


def _gathered(block: Block) -> csr_array:
    """Rows of all arguments, instance by instance, shape (K · width, size)."""
    every = [variables.rows for variables, _ in block.selections]
    firsts = accumulate((int(rows.shape[0]) for rows in every), initial=0)
    index = [
        first + variables.width * np.asarray(columns)[:, None] + np.arange(variables.width)
        for first, (variables, columns) in zip(firsts, block.selections, strict=False)
    ]
    return csr_array(csr_array(vstack(every))[np.concatenate(index, axis=1).ravel()])


def blocks_of(constraints: Sequence[Constraint]) -> list[Block]:
    """All blocks, their scatter counted over all the constraints' rows."""
    firsts = accumulate((constraint.rows for constraint in constraints), initial=0)
    return [
        replace(block, scatter=block.scatter + first, name=f"{constraint.name} {k}")
        for first, constraint in zip(firsts, constraints, strict=False)
        for k, block in enumerate(constraint.blocks)
    ]
