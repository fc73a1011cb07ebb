"""Conic programs written row by row: named groups of rows and index blocks, once a layout; numbers are filled in later.

    minimise  ½ x'P x + q'x  subject to  A x + s = b,  s in a product of zero, non-negative and second-order cones.

The readable formulations of the same programs, in cvxpy, are in ``reference``; a test holds the two equal. Here a block
of A is put once, rows and columns, with a function that gives its values for a problem: compiling is gone, and loading
a new problem is some numpy. Clarabel solves. A program of one frame keeps its solver and has its data updated, without
equilibration; a longer one is set up anew each time, with it. Either way an answer depends on its own problem alone.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import clarabel
import numpy as np
import scipy.sparse as sp

from ..arrays import Array
from .layout import Index

D = TypeVar("D")
Fill = Callable[[D], Array | float]
"""Values of a block for a problem; they are broadcast to the block's shape."""


class ConicStatus(enum.Enum):
    """What the conic solver ended with, after its statuses were mapped."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True, eq=False)
class ConicSolution:
    """One solve, by the names of variables and groups of rows.

    x: primal, shape (n,); z: dual, shape (m,), a Farkas ray where infeasible. objective: of x; bound: of z, the dual
    objective; exact: whether the solver met its own tolerances; seconds: in the solver alone [s].
    """

    status: ConicStatus
    x: Array
    z: Array
    columns: Mapping[str, Index]
    groups: Mapping[str, Index]
    objective: float
    bound: float
    exact: bool
    iterations: int
    seconds: float

    @property
    def solved(self) -> bool:
        """Whether x is a point."""
        return self.status is ConicStatus.SOLVED

    def value(self, name: str) -> Array:
        """Value of the variable of this name, in its own shape."""
        return np.asarray(self.x[self.columns[name]])

    def dual(self, name: str) -> Array:
        """Multipliers of the group of rows of this name, in its shape: L = objective + z'(A x − b)."""
        return np.asarray(self.z[self.groups[name]])


_STATUS = {
    clarabel.SolverStatus.Solved: ConicStatus.SOLVED,
    clarabel.SolverStatus.AlmostSolved: ConicStatus.SOLVED,
    clarabel.SolverStatus.PrimalInfeasible: ConicStatus.INFEASIBLE,
    clarabel.SolverStatus.AlmostPrimalInfeasible: ConicStatus.INFEASIBLE,
}
_EXACT = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.PrimalInfeasible)


class Rows(Generic[D]):
    """A conic program whose numbers come from problems of the type D.

    keep: keep one solver and update its data, without equilibration (see the module).
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self._cones: list[object] = []
        self._blocks: list[tuple[Index, Index, Fill[D] | None, Array]] = []
        self._right: list[tuple[Index, Fill[D]]] = []
        self._squares: list[tuple[Index, Index, Fill[D]]] = []
        self._linear: list[tuple[Index, Fill[D]]] = []
        self._constants: list[Fill[D]] = []
        self._solver: clarabel.DefaultSolver | None = None
        self.columns: dict[str, Index] = {}
        self.groups: dict[str, Index] = {}
        self.shape = (0, 0)

    def variable(self, name: str, *shape: int) -> Index:
        """Columns of a new variable, in its shape."""
        size = int(np.prod(shape, dtype=int))
        self.columns[name] = self.shape[1] + np.arange(size).reshape(shape)
        self.shape = (self.shape[0], self.shape[1] + size)
        return self.columns[name]

    def equal(self, name: str, *shape: int) -> Index:
        """New rows A x = b."""
        return self._group(name, shape, clarabel.ZeroConeT)

    def at_most(self, name: str, *shape: int) -> Index:
        """New rows A x ≤ b."""
        return self._group(name, shape, clarabel.NonnegativeConeT)

    def cones(self, name: str, count: int, size: int) -> Index:
        """New second-order cones, shape (count, size): b − A x = (t, v) with ‖v‖ ≤ t, a row of the group each."""
        rows = self.shape[0] + np.arange(count * size).reshape(count, size)
        self._cones += [clarabel.SecondOrderConeT(size)] * count
        self.groups[name], self.shape = rows, (self.shape[0] + rows.size, self.shape[1])
        return rows

    def put(self, rows: Index, columns: Index, values: float | Fill[D]) -> None:
        """Entries of A at ``rows`` × ``columns``, which are broadcast; no entry twice."""
        rows, columns = np.broadcast_arrays(rows, columns)
        fill = None if isinstance(values, int | float) else values
        start = np.full(rows.shape, values if fill is None else 0.0, dtype=np.float64)
        self._blocks.append((rows, columns, fill, start))

    def right(self, rows: Index, values: float | Fill[D]) -> None:
        """Add to b at these rows."""
        self._right.append((rows, _given(values)))

    def square(self, first: Index, second: Index | None, weight: Fill[D]) -> None:
        """Add weight · Σ (x[first] − x[second])² to the objective, with None weight · Σ x[first]²."""
        pairs = [(first, first, 2.0)]
        if second is not None:
            pairs += [(second, second, 2.0), (np.minimum(first, second), np.maximum(first, second), -2.0)]
        for row, column, factor in pairs:
            self._squares.append((row.ravel(), column.ravel(), _scaled(factor, weight)))

    def linear(self, columns: Index, values: float | Fill[D], constant: Fill[D] | None = None) -> None:
        """Add values · x[columns] and a constant to the objective."""
        self._linear.append((columns, _given(values)))
        self._constants += [] if constant is None else [constant]

    def solve(self, data: D) -> ConicSolution:
        """Solve for this problem."""
        hessian, q, matrix, b = self.load(data)
        begin = time.perf_counter()
        if self._solver is None or not self._keep:
            settings = solver_settings(equilibrate=not self._keep)
            self._solver = clarabel.DefaultSolver(hessian, q, matrix, b, self._cones, settings)
        else:
            self._solver.update(q=q, A=matrix.data, b=b, **({"P": hessian.data} if self._squares else {}))
        answer = self._solver.solve()
        if answer.status not in _STATUS:  # rare: ask again, with refined steps
            careful = solver_settings(equilibrate=True, careful=True)
            answer = clarabel.DefaultSolver(hessian, q, matrix, b, self._cones, careful).solve()
        constant = float(sum(float(np.sum(fill(data))) for fill in self._constants))
        return ConicSolution(
            status=_STATUS.get(answer.status, ConicStatus.FAILED),
            x=np.array(answer.x),
            z=np.array(answer.z),
            columns=self.columns,
            groups=self.groups,
            objective=float(answer.obj_val) + constant,
            bound=min(float(answer.obj_val), float(answer.obj_val_dual)) + constant,
            exact=answer.status in _EXACT,
            iterations=int(answer.iterations),
            seconds=time.perf_counter() - begin,
        )

    def lagrangian(self, data: D, solution: ConicSolution) -> tuple[float, Array]:
        """The Lagrangian  z'(A x − b)  as a function of x: its constant −b'z and its slope A'z, shape (n,).

        No x that satisfies the constraints makes it positive.
        """
        _, _, matrix, b = self.load(data)
        return -float(b @ solution.z), np.asarray(matrix.T @ solution.z)

    def load(self, data: D) -> tuple[sp.csc_matrix, Array, sp.csc_matrix, Array]:
        """(P, q, A, b) for this problem; the arrays of A and b are overwritten by the next call."""
        if not hasattr(self, "_order"):
            self._compile()
        for view, fill in self._views:
            view[...] = fill(data)
        np.take(self._values, self._order, out=self._matrix.data)
        b, q = np.zeros(self.shape[0]), np.zeros(self.shape[1])
        for rows, fill in self._right:
            b[rows] += fill(data)
        for columns, fill in self._linear:
            q[columns] += fill(data)
        return self._hessian(data), q, self._matrix, b

    @property
    def cone_list(self) -> list[object]:
        """The cones in the order of the rows, as Clarabel takes them."""
        return list(self._cones)

    def _group(self, name: str, shape: tuple[int, ...], kind: type) -> Index:
        size = int(np.prod(shape, dtype=int))
        rows = self.shape[0] + np.arange(size).reshape(shape)
        if size:
            self._cones.append(kind(size))
        self.groups[name], self.shape = rows, (self.shape[0] + size, self.shape[1])
        return rows

    def _compile(self) -> None:
        rows = np.concatenate([block[0].ravel() for block in self._blocks])
        columns = np.concatenate([block[1].ravel() for block in self._blocks])
        self._values = np.concatenate([block[3].ravel() for block in self._blocks])
        ends = np.cumsum([block[3].size for block in self._blocks])
        self._views = [
            (self._values[end - start.size : end].reshape(start.shape), fill)
            for end, (_, _, fill, start) in zip(ends, self._blocks, strict=True)
            if fill is not None
        ]
        self._order = np.lexsort((rows, columns))
        indptr = np.searchsorted(columns[self._order], np.arange(self.shape[1] + 1))
        self._matrix = sp.csc_matrix(
            (self._values[self._order], rows[self._order].astype(np.int32), indptr.astype(np.int32)), shape=self.shape
        )
        self._empty = sp.csc_matrix((self.shape[1], self.shape[1]))

    def _hessian(self, data: D) -> sp.csc_matrix:
        if not self._squares:
            return self._empty
        rows, columns, values = zip(
            *((row, column, np.broadcast_to(fill(data), row.shape)) for row, column, fill in self._squares), strict=True
        )
        index = (np.concatenate(rows), np.concatenate(columns))
        return sp.csc_matrix((np.concatenate(values), index), shape=(self.shape[1], self.shape[1]))


def solver_settings(*, equilibrate: bool, careful: bool = False) -> clarabel.DefaultSettings:
    """Clarabel's settings for small programs on one thread; no clock ends a solve, iterations do.

    careful: slower, for the rare problem that the fast settings end on without an answer.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.iterative_refinement_enable = careful
    settings.equilibrate_enable = equilibrate
    settings.equilibrate_max_iter = 10 if careful else 2
    return settings


def _given(values: float | Fill[D]) -> Fill[D]:
    if isinstance(values, int | float):
        return lambda _: values
    return values


def _scaled(factor: float, weight: Fill[D]) -> Fill[D]:
    return lambda d: factor * np.asarray(weight(d))
