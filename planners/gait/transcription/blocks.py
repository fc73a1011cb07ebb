"""A nonlinear program of many small equal pieces: kernels over gathered rows of the decision
vector.

A block evaluates one kernel at K instances: v_k = A_k x, out_k = kernel(v_k), and adds out_k into
rows of the whole. Its Jacobian is that of the kernel times A_k and its Hessian A_kᵀ H_k A_k, so
everything is exact and sparse, and what has to be differentiated is small (SX) and differentiated
once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, vstack

from ...arguments import cached_property
from ...files.arrays import Array
from .taylor import ExpansionPoint, Jets, TaylorMap

Rows = NDArray[np.intp]


Features = Callable[[cs.SX, cs.SX], cs.SX]
Place = Callable[[cs.SX, ExpansionPoint | None], cs.SX]


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
    place: Place | None = None

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
            jet = jets[self.jets(order) - self.map.size(order) :]
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
    """

    kernel: Kernel
    selections: tuple[Selection, ...]
    scatter: Rows
    order: int = 1

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


class Compiled:
    """A block as CasADi functions: value, Jacobian and Hessian of the kernel, and the gathering
    matrix.
    """

    def __init__(self, block: Block) -> None:
        self.block = block
        self.groups = [variables for variables, _ in block.selections]
        self.gather = matrix(_gathered(block))
        self.width = sum(variables.width for variables in self.groups)
        fixed = [
            variables.constants[columns]
            for variables, columns in block.selections
            if variables.fixed
        ]
        self.constants: Array = (
            np.concatenate(fixed, axis=1) if fixed else np.zeros((block.count, 0))
        )

    @cached_property
    def value(self) -> cs.Function:
        """(v, constants, jets) → outputs."""
        return self._function(0)

    @cached_property
    def jacobian(self) -> cs.Function:
        """(v, constants, jets) → ∂ outputs / ∂v, sparse."""
        return self._function(1)

    @cached_property
    def hessian(self) -> cs.Function:
        """(v, constants, jets, multipliers) → Hessian of multipliers · outputs, sparse."""
        return self._function(2)

    def _function(self, derivatives: int) -> cs.Function:
        v, c = cs.SX.sym("v", self.width), cs.SX.sym("c", self.constants.shape[1])
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
        at = constant = jet = 0
        for variables in self.groups:
            features.append(
                variables.features(
                    v[at : at + variables.width], c[constant : constant + variables.fixed]
                )
            )
            expansions = variables.expansions(
                features[-1], order, jets[jet : jet + variables.jets(order)]
            )
            at, constant, jet = (
                at + variables.width,
                constant + variables.fixed,
                jet + variables.jets(order),
            )
            shown += expansions or [None]
            every += expansions
        return self.block.kernel(features, shown), every

    def at(self, x: cs.MX, bank: TaylorBank, derivatives: int) -> list[cs.MX]:
        """Arguments of ``value``, ``jacobian`` or ``hessian`` (but its multipliers) at all
        instances.
        """
        order = self.block.order + derivatives
        v = cs.reshape(self.gather @ x, self.width, self.block.count)
        jets = [
            bank(variables, order)[:, columns.tolist()]
            for variables, columns in self.block.selections
            if variables.jets(order)
        ]
        empty = cs.MX(0, self.block.count)
        return [
            v,
            self._held if self.constants.size else empty,
            cs.vertcat(*jets) if jets else empty,
        ]

    @cached_property
    def _held(self) -> cs.MX:
        """The constants of all instances, shape (c, K)."""
        return cs.MX(cs.DM(self.constants.T))


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
            if variables.inner is not None:
                jets.append(self._jets(variables.inner, points, order))
                if variables.place is not None:
                    points = self._placed(variables, points, self._jets(variables.inner, points, 1))
            elif variables.place is not None:
                points = self._placed(variables, points, cs.MX(0, variables.count))
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
    parts, order = [], []
    width = sum(variables.width for variables, _ in block.selections)
    at = 0
    for variables, columns in block.selections:
        local = np.arange(variables.width)
        parts.append(
            variables.rows[(variables.width * np.asarray(columns)[:, None] + local).ravel()]
        )
        order.append((width * np.arange(block.count)[:, None] + at + local).ravel())
        at += variables.width
    stacked = csr_array(vstack(parts))
    return csr_array(stacked[np.argsort(np.concatenate(order), kind="stable")])


def blocks_of(constraints: Sequence[Constraint]) -> list[Block]:
    """All blocks, their scatter counted over all the constraints' rows."""
    blocks, first = [], 0
    for constraint in constraints:
        for block in constraint.blocks:
            blocks.append(Block(block.kernel, block.selections, block.scatter + first, block.order))
        first += constraint.rows
    return blocks
